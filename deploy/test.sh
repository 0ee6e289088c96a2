#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what is needed, builds, and runs every test through ctest.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

usage() {
    cat <<'TEXT'
Usage: deploy/test.sh [--no-install] [--quick]

Installs the Debian packages and npm modules that the tests need, builds with warnings as
errors, and runs the tests: with ASan and UBSan, with TSan, the fuzz targets for a short
time, and at last the whole suite on the release build.

  --no-install   use what is already installed
  --quick        the release build's tests alone
  --help         this text

Real volumes are looked for in ../shared/data, or where SPLATD_DATA_DIR points; the tests
that need them are skipped, and say so, when the folder is not there.
TEXT
}

install=yes quick=no
for argument in "$@"; do
    case $argument in
    --no-install) install=no ;;
    --quick) quick=yes ;;
    --help) usage; exit 0 ;;
    *) usage >&2; exit 2 ;;
    esac
done

if [[ $install == yes ]]; then
    install_packages build test
    if [[ ! -e $root/tests/node_modules/.package-lock.json || $root/tests/package-lock.json -nt $root/tests/node_modules/.package-lock.json ]]; then
        say "installing the tests' npm modules"
        (cd "$root/tests" && npm ci --no-audit --no-fund --silent) ||
            die "npm could not install tests/package.json: check the network, then run again"
    fi
    requirements=$root/tests/protocol/requirements.txt
    if ! cmp -s "$requirements" "$root/build/python/requirements.txt"; then
        say "installing schemathesis into build/python"
        if /usr/bin/python3 -m venv --clear "$root/build/python" && "$root/build/python/bin/pip" install -q -r "$requirements"; then
            cp "$requirements" "$root/build/python/requirements.txt"
        else
            say "schemathesis could not be installed: its test will be skipped"
        fi
    fi
fi

data=$(realpath -m "${SPLATD_DATA_DIR:-$root/../shared/data}")
CMAKE_ARGS=(-DSPLATD_WERROR=ON "-DSPLATD_DATA_DIR=$data")
[[ -d $data ]] || say "no real volumes at $data: their tests will be skipped"

failed=()
# run PRESET CTEST-ARGUMENT...: a preset that fails does not keep the next from running. A test a core, but for those
# that want them all (RUN_SERIAL).
run() {
    local preset=$1 begun=$SECONDS
    shift
    say "testing $preset"
    (cd "$root" && ctest --preset "$preset" --parallel "$(nproc)" "$@") || failed+=("$preset")
    say "$preset took $((SECONDS - begun)) s"
}

# Shaders are compiled once, not by each preset again, nor by each run of a test.
export MESA_SHADER_CACHE_DIR=$root/build/shaders
mkdir -p "$MESA_SHADER_CACHE_DIR"

if [[ $quick == no ]]; then
    build asan
    run asan -LE "lint|web"
    build tsan
    run tsan -L "unit|integration"
    build fuzz
    run fuzz
fi
build release
[[ ${#failed[@]} -eq 0 ]] || say "already failed: ${failed[*]}"
run release
[[ ${#failed[@]} -eq 0 ]] || die "failed: ${failed[*]} (see above); one test again: ctest --preset PRESET -R NAME"
