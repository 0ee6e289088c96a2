#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the dependencies, builds, and runs the tests through ctest.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

usage() {
    cat <<'TEXT'
Usage: deploy/test.sh [--no-install] [--quick]

Installs the Debian packages and npm modules that the tests need, builds with warnings as
errors, and runs the tests in three stages:

  release   all tests, with the web page and lint
  asan      AddressSanitizer and UBSan: unit, kernel, conformance, protocol, integration and
            bench tests, and each fuzz target for a second
  tsan      ThreadSanitizer: unit and integration tests of code that has threads

A test that checks a sample under a sanitizer says so in its output; this script lists the
tests that run in the release stage only. At the end it prints the slowest 20 tests, the
time of each stage, and the summary of the release stage.

  --no-install   use what is already installed
  --quick        only lint, the fast unit and protocol tests and a few integration tests, on
                 the release build: a verdict within 3 minutes after the build
  --help         print this text

SPLATD_DATA_DIR names the folder of the real volumes (default ../shared/data). Without it,
the tests that need real volumes are skipped and say so.
TEXT
}

install=yes mode=full
for argument in "$@"; do
    case $argument in
    --no-install) install=no ;;
    --quick) mode=quick ;;
    --help) usage; exit 0 ;;
    *) usage >&2; exit 2 ;;
    esac
done

if [[ $install == yes ]]; then
    install_packages build test python
    (install_packages faster) || say "the tests of the page run in the whole Chromium, which takes longer"
    if [[ ! -e $root/tests/node_modules/.package-lock.json || $root/tests/package-lock.json -nt $root/tests/node_modules/.package-lock.json ]]; then
        say "installing the npm modules of the tests"
        (cd "$root/tests" && npm ci --no-audit --no-fund --silent) ||
            die "npm could not install the modules of tests/package.json: check the network, then run again"
    fi
    requirements=$(cat "$root"/tests/{protocol,formats,python}/requirements.txt)
    if [[ $requirements != "$(cat "$root/build/python/requirements.txt" 2>/dev/null)" ]]; then
        say "installing schemathesis, the readers that formats are compared with, and what the Python package needs into build/python"
        if /usr/bin/python3 -m venv --clear "$root/build/python" &&
            "$root/build/python/bin/pip" install -q -r "$root/tests/protocol/requirements.txt" -r "$root/tests/formats/requirements.txt" \
                -r "$root/tests/python/requirements.txt"; then
            printf '%s\n' "$requirements" >"$root/build/python/requirements.txt"
        else
            say "they could not be installed: their tests will be skipped"
        fi
    fi
fi

data=$(realpath -m "${SPLATD_DATA_DIR:-$root/../shared/data}")
CMAKE_ARGS=(-DSPLATD_WERROR=ON "-DSPLATD_DATA_DIR=$data")
[[ -d $data ]] || say "no real volumes in $data: their tests are skipped"

# All stages share one cache of compiled shaders. The release stage fills it: under AddressSanitizer, software GL needs almost
# three times as long for that.
export MESA_SHADER_CACHE_DIR=$root/build/shaders
mkdir -p "$MESA_SHADER_CACHE_DIR"
# Software GL draws in the thread of its caller: more tests than cores run at a time, and its own threads take a quarter of
# the time to wait for one another.
export LP_NUM_THREADS=0

failed=() stages=()
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT

# cpu_seconds: sets $cpu to the user and system time of all finished child processes. `times` must run in this shell:
# a subshell has no children yet.
cpu_seconds() {
    times >"$logs/times"
    cpu=$(awk 'NR == 2 { gsub(/[ms]/, " "); print int($1 * 60 + $2 + $3 * 60 + $4) }' "$logs/times")
}

# timed NAME COMMAND...: runs the command and records its wall-clock and CPU time. Returns the status of the command.
timed() {
    local name=$1 begun=$SECONDS cpu cpu_begun status=0
    shift
    cpu_seconds
    cpu_begun=$cpu
    "$@" || status=$?
    cpu_seconds
    stages+=("$(printf '%-16s %5d s wall  %5d s CPU' "$name" $((SECONDS - begun)) $((cpu - cpu_begun)))")
    return $status
}

# run PRESET CTEST-ARGUMENT...: runs the tests, longest first. More than there are cores run at a time, because some tests
# wait: two more in the release stage, which has the tests of the page, else one. A failure does not stop the next stage. The summary of ctest goes to $logs/PRESET.summary and is printed by
# the caller.
run() {
    local preset=$1 more=1
    shift
    [[ $preset != release ]] || more=2
    rm -f "$logs/$preset.summary"
    (cd "$root" && ctest --preset "$preset" --parallel $(($(nproc) + more)) "$@" 2>&1) |
        tee "$logs/$preset.log" |
        sed -uE "/^[0-9]+% tests passed/,\$ { w $logs/$preset.summary
            d }" ||
        failed+=("$preset")
}

# stage PRESET CTEST-ARGUMENT...: builds and tests a preset.
stage() {
    local preset=$1
    timed "build $preset" build "$preset"
    say "testing $preset"
    timed "test $preset" run "$@"
}

# left_out PRESET LABELS: says which tests run only in the release stage.
left_out() {
    say "$1 leaves to the release stage:" $(ctest --test-dir "$root/build/$1" -N -L "$2" | sed -n 's/^ *Test *#[0-9]*: //p')
}

# report: what failed, the slowest 20 tests, and the time of each stage.
report() {
    local log
    for log in "$logs"/*.log; do
        awk -v preset="$(basename "$log" .log)" '
            / Test +#[0-9]+: / { left = 0 }
            /\*\*\*(Failed|Timeout|Exception|Not Run)/ { sub(/^ *[0-9]+\/[0-9]+ +/, ""); print "== failed: " preset "  " $0; left = 12; next }
            /error: \|-/ { text = 4 } # lines of the text that follows
            left > 0 && (text-- > 0 || /[Ee]rror|not ok|FAILED|LINE|Sanitizer/) { print "   " substr($0, 1, 300); left-- }' "$log" >&2
    done
    say "slowest 20 tests"
    for log in "$logs"/*.log; do
        sed -nE "s|^ *[0-9]+/[0-9]+ +Test +#[0-9]+: +([^ ]+) .* ([0-9.]+) sec *\$|\2 s  $(basename "$log" .log)  \1|p" "$log"
    done | sort -rn | sed -n 1,20p >&2 # head would end sort by SIGPIPE
    say "time of each stage"
    printf '%s\n' "${stages[@]}" "$(printf '%-16s %5d s wall' total $SECONDS)" >&2
}

if [[ $mode == quick ]]; then
    stage release -L "lint|unit|protocol|quick" -LE slow
else
    stage release
    [[ ${#failed[@]} -eq 0 ]] || say "already failed: ${failed[*]}"
    stage asan
    left_out asan "lint|web|unsanitized"
    cat "$logs/asan.summary"
    stage tsan
    left_out tsan one_thread
    cat "$logs/tsan.summary"
fi
report
cat "$logs/release.summary"
[[ ${#failed[@]} -eq 0 ]] || die "failed: ${failed[*]} (see above); one test again: ctest --preset PRESET -R NAME"
