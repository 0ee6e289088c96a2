#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Measures line coverage with gcov.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

if [[ $# -gt 0 ]]; then
    [[ $1 == --help ]] || exec >&2
    echo "Usage: deploy/coverage.sh"
    echo "Builds the preset \"coverage\" in build/coverage, runs the unit, kernel, protocol and"
    echo "integration tests, and prints the line coverage of each folder."
    [[ $1 == --help ]] && exit 0
    exit 2
fi

CMAKE_ARGS=("-DSPLATD_DATA_DIR=$(realpath -m "${SPLATD_DATA_DIR:-$root/../shared/data}")")
build coverage
find "$root/build/coverage" -name '*.gcda' -delete # of earlier runs
(cd "$root" && ctest --preset coverage --parallel "$(nproc)") >&2 || say "some tests failed; their coverage counts all the same"
python3 "$root/deploy/coverage.py" "$root/build/coverage"
