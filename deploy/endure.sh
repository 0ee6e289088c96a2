#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs what takes hours: the fuzz targets, kills of the daemon, and a soak.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

usage() {
    cat <<'TEXT'
Usage: deploy/endure.sh [OPTION...]

Runs, one after the other:

  fuzz    each fuzz target with AddressSanitizer and UBSan, for an equal part of the time.
          Inputs that reach new code are added to the target's corpus in tests/fuzz/corpus, the
          smallest ones that together reach all of it
  kills   a daemon that is killed right after it acknowledged changes, and must lose nothing
  soak    clients that come and go, with mixed work; memory and descriptors are recorded

  --fuzz-hours N    processor hours of all fuzz targets together (default 24)
  --kills N         (default 1000)
  --soak-minutes N  (default 120)
  --only PARTS      fuzz, kills, soak, with commas between
  --target NAME     fuzz this target alone
  --out DIR         where the figures and what fails go (default build/endure)
  --no-install      build with what is already installed
  --help            this text

Writes endure.csv, with a line per target and part. Exits with 1 if anything failed: an input that
fails lies in OUT/fuzz/TARGET and is replayed with `build/asan/tests/fuzz_TARGET FILE`.
TEXT
}

need_value() {
    [[ $# -ge 2 ]] || { usage >&2; exit 2; }
}

install=yes hours=24 kills=1000 minutes=120 only=fuzz,kills,soak target='' out=$root/build/endure
while [[ $# -gt 0 ]]; do
    case $1 in
    --fuzz-hours) need_value "$@"; hours=$2; shift ;;
    --kills) need_value "$@"; kills=$2; shift ;;
    --soak-minutes) need_value "$@"; minutes=$2; shift ;;
    --only) need_value "$@"; only=$2; shift ;;
    --target) need_value "$@"; target=$2; shift ;;
    --out) need_value "$@"; out=$(realpath -m "$2"); shift ;;
    --no-install) install=no ;;
    --help) usage; exit 0 ;;
    *) usage >&2; exit 2 ;;
    esac
    shift
done
for number in "$hours" "$kills" "$minutes"; do
    [[ $number =~ ^[0-9]+(\.[0-9]+)?$ ]] || die "'$number' is not a number"
done
[[ $only =~ ^(fuzz|kills|soak)(,(fuzz|kills|soak))*$ ]] || die "--only takes fuzz, kills and soak, with commas between"
[[ $install == no ]] || install_packages build test
mkdir -p "$out"
echo "part,what,date,seconds,count,corpus,failed,cpu_seconds" >"$out/endure.csv"
failed=()

# cpu_seconds: sets $cpu to the user and system time of all finished child processes. `times` must run in this shell: a
# subshell has no children yet.
cpu_seconds() {
    times >"$out/times"
    cpu=$(awk 'NR == 2 { gsub(/[ms]/, " "); print int($1 * 60 + $2 + $3 * 60 + $4) }' "$out/times")
}

# note PART WHAT SECONDS COUNT CORPUS FAILED CPU-SECONDS: a line of the table.
note() {
    local line
    line=$1,$2,$(date -u +%F),$3,$4,$5,$6,$7
    echo "$line" | tee -a "$out/endure.csv"
    [[ $6 == 0 ]] || failed+=("$1 $2")
}

# fuzz_target NAME SECONDS: mutates the corpus on all cores, then adds the inputs that reach new code to it. The corpus
# of `files` does not change: it holds sound files, and the replay checks that they load.
fuzz_target() {
    local name=$1 seconds=$2 begun=$SECONDS corpus=$root/tests/fuzz/corpus/$1 found=$out/fuzz/$1 program=$root/build/asan/tests/fuzz_$1
    local words=() status=0 runs into=$corpus cpu cpu_begun
    cpu_seconds
    cpu_begun=$cpu
    [[ ! -e $root/tests/fuzz/$name.dict ]] || words=(-dict="$root/tests/fuzz/$name.dict")
    mkdir -p "$found/new"
    [[ $name != files ]] || { into=$found/corpus; cp -r "$corpus" "$into"; }
    (cd "$found" && ASAN_OPTIONS=allocator_may_return_null=1 "$program" -fork="$(nproc)" -ignore_crashes=1 -ignore_timeouts=1 -ignore_ooms=1 \
        -max_total_time="$seconds" -rss_limit_mb=1024 -timeout=20 -artifact_prefix="$found/" "${words[@]}" new "$corpus") >"$found/log" 2>&1 || status=$?
    runs=$(grep -oE '^#[0-9]+' "$found/log" | tail -n 1 | tr -d '#' || true)
    (cd "$found" && ASAN_OPTIONS=allocator_may_return_null=1 "$program" -merge=1 -rss_limit_mb=1024 -timeout=20 "${words[@]}" "$into" new) >>"$found/log" 2>&1 || status=$?
    # Crashes, timeouts and memory are what the fuzzer keeps beside its log. On a busy machine an input may only have waited:
    # it does not count if it passes alone, in 20 seconds of processor time.
    local faults input
    for input in "$found"/{timeout,slow-unit}-*; do
        [[ ! -e $input ]] || ! (ulimit -t 20 && "$program" "$input") >>"$found/log" 2>&1 || rm "$input"
    done
    faults=$(find "$found" -maxdepth 1 -type f ! -name log | wc -l)
    rm -rf "$found/new"
    cpu_seconds
    note fuzz "$name" $((SECONDS - begun)) "${runs:-0}" "$(find "$corpus" -type f | wc -l)" "$faults" $((cpu - cpu_begun))
    [[ $status == 0 || $faults -gt 0 ]] || { tail -n 5 "$found/log" >&2; failed+=("fuzz $name (status $status)"); }
}

fuzz() {
    local names=() seconds
    build asan
    for program in "$root"/build/asan/tests/fuzz_*; do
        names+=("${program##*/fuzz_}")
    done
    [[ -z $target ]] || names=("$target")
    seconds=$(awk -v hours="$hours" -v cores="$(nproc)" -v count=${#names[@]} 'BEGIN { s = int(hours * 3600 / cores / count); print (s > 1 ? s : 1) }')
    say "fuzzing ${#names[@]} targets, $seconds s each on $(nproc) cores"
    for name in "${names[@]}"; do
        [[ -x $root/build/asan/tests/fuzz_$name ]] || die "there is no fuzz target '$name'"
        fuzz_target "$name" "$seconds"
    done
}

kill_daemons() {
    local begun=$SECONDS status=0
    say "killing $kills daemons"
    (cd "$root" && SPLATD_KILLS=$kills SPLATD_BIN_DIR=$root/build/release/bin tests/web/run.sh tests/integration/durable.test.mjs) >"$out/kills.log" 2>&1 || status=$?
    [[ $status == 0 ]] || tail -n 40 "$out/kills.log" >&2
    note kills "changes that were acknowledged" $((SECONDS - begun)) "$kills" '' "$status" ''
}

soak() {
    local begun=$SECONDS status=0
    say "a soak of $minutes minutes"
    (cd "$root" && node tests/bench/serve.mjs --only soak --minutes "$minutes" --out "$out/soak.csv") >"$out/soak.log" 2>&1 || status=$?
    [[ $status == 0 ]] || tail -n 40 "$out/soak.log" >&2
    note soak "clients that come and go" $((SECONDS - begun)) "$minutes" '' "$status" ''
}

if [[ $only == *kills* || $only == *soak* ]]; then
    build release
    [[ -d $root/tests/node_modules ]] || (cd "$root/tests" && npm ci --no-audit --no-fund --silent) || die "npm could not install the modules of tests/package.json"
fi
[[ $only != *fuzz* ]] || fuzz
[[ $only != *kills* ]] || kill_daemons
[[ $only != *soak* ]] || soak
say "figures: $out/endure.csv"
[[ ${#failed[@]} -eq 0 ]] || die "failed: ${failed[*]}"
