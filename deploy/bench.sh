#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds, measures everything and writes the tables.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

usage() {
    cat <<'TEXT'
Usage: deploy/bench.sh [OPTION...]

Builds the release preset, measures every scene of the bench beside VTK and the scalar
reference, the GPU backend on a GPU or else on software GL, the daemon with its clients, the
codecs and TLS, and writes CSV files and a page made from them. About 75 minutes on two idle
cores; each step prints what runs and how long it took.

  --quick         a few minutes: 4 views, 512 px, two threads, small volumes; not for the page
  --data DIR      folder of the real volumes (default ../shared/data, or $SPLATD_DATA_DIR)
  --scenes DIR    folder of their scenes (default ../shared/bench/scenes)
  --out DIR       where the tables go (default tests/bench/results; with --quick build/bench-quick)
  --vtk           measure VTK too, and install it if it is missing (python3-vtk9, xvfb)
  --no-vtk        do not; without either, VTK is measured where it is installed
  --only PARTS    measure some alone and keep the other files, with commas between: limit, scenes,
                  pixels, exact, scans, adaptive, detail, edits, layers, elements, cancel, scaling, gl, serve,
                  latency, network, browser, motion, bricks, memory, codecs, tls, soak. soak is left out unless named:
                  20 minutes of clients that come and go. bricks makes volumes of up to 4096³ samples
                  (64 GiB, almost empty) below $TMPDIR or /tmp: 4 minutes, and 12 GB of disk until its
                  end. On software GL the part gl draws two views of a scene and leaves out, saying
                  so, what takes longer than --software-limit; serve to soak, except codecs, need
                  node, and all of these but tls what deploy/test.sh installs in tests/node_modules
  --software-limit S  seconds (default 30): with more of them heavier scenes are drawn as well
  --memory-sides LIST  sides in px of the images of the part memory, at most 4096, with commas between
                  (default 1024; 4096 takes sixteen times as long: an hour or more)
  --gpu-peak G,T  what the GPU can do, for the page to compare with: memory in GB/s, arithmetic in TFLOP/s
  --views N       cameras of each orbit, 2 to 24 (default 24)
  --full          24 cameras for VTK at 1024 px as well, where 8 are taken (10 minutes more)
  --no-install    build with what is already installed
  --help          this text

What is not there (scenes, volumes, VTK, node) is skipped, and the output says so; of VTK and a GPU
the page, too.
TEXT
}

# vtk_works: both the module and a virtual display, which needs xauth.
vtk_works() {
    command -v xvfb-run >/dev/null 2>&1 && command -v xauth >/dev/null 2>&1 && /usr/bin/python3 -c 'import vtk, numpy' >/dev/null 2>&1
}

need_value() {
    [[ $# -ge 2 ]] || { usage >&2; exit 2; }
}

install=yes quick=no vtk=auto views='' full=no out='' only='' peak='' memory_sides=''
software_limit='' data=${SPLATD_DATA_DIR:-$root/../shared/data} scenes=$root/../shared/bench/scenes
while [[ $# -gt 0 ]]; do
    case $1 in
    --quick) quick=yes ;;
    --vtk) vtk=yes ;;
    --no-vtk) vtk=no ;;
    --full) full=yes ;;
    --no-install) install=no ;;
    --data) need_value "$@"; data=$2; shift ;;
    --scenes) need_value "$@"; scenes=$2; shift ;;
    --out) need_value "$@"; out=$2; shift ;;
    --only) need_value "$@"; only=$2; shift ;;
    --memory-sides) need_value "$@"; memory_sides=$2; shift ;;
    --gpu-peak) need_value "$@"; peak=$2; shift ;;
    --views) need_value "$@"; views=$2; shift ;;
    --software-limit) need_value "$@"; software_limit=$2; shift ;;
    --help) usage; exit 0 ;;
    *) usage >&2; exit 2 ;;
    esac
    shift
done
if [[ $quick == yes ]]; then
    out=${out:-$root/build/bench-quick} views=${views:-4}
else
    out=${out:-$root/tests/bench/results} views=${views:-24}
fi
[[ $views =~ ^[0-9]+$ && $views -ge 2 && $views -le 24 ]] || die "--views takes a number from 2 to 24"
[[ $software_limit =~ ^([1-9][0-9]{0,4})?$ ]] || die "--software-limit takes seconds, from 1 to 99999"

side='[1-9][0-9]{1,3}'
[[ $memory_sides =~ ^($side(,$side)*)?$ ]] || die "--memory-sides takes sides from 10 to 9999 px with commas between, not $memory_sides"

data=$(realpath -m "$data") scenes=$(realpath -m "$scenes")
peer=$scenes/../vtk_bench.py why=''
[[ $install == no ]] || install_packages build
if [[ $vtk == yes ]] && ! vtk_works; then
    [[ $install == yes ]] || die "--vtk needs python3-vtk9, python3-numpy, xauth and xvfb: install them, or drop --no-install"
    install_packages peer
fi
if [[ $vtk == no ]]; then
    peer='' why='--no-vtk was given'
elif [[ ! -f $peer ]]; then
    why="there is no vtk_bench.py beside $(basename "$scenes") (--scenes DIR)" peer=''
elif ! vtk_works; then
    why='python3-vtk9 or xvfb is not installed (--vtk installs them)' peer=''
fi
[[ -n $peer ]] || say "skipped: VTK; $why"
[[ $vtk != yes || -n $peer ]] || die "VTK was asked for: $why"

build release splatd splat-bench splat-march splat-limit splat-codecs splat-tls-echo splat-import splat-exr
load=$(cut -d' ' -f1 /proc/loadavg)
[[ ${load%%.*} -eq 0 ]] || say "the machine is not idle (load $load): times will be noisy"

arguments=(--bin "$root/build/release/bin" --data "$data" --scenes "$scenes" --out "$out" --views "$views")
[[ $quick == no ]] || arguments+=(--quick)
[[ -z $only ]] || arguments+=(--only "$only")
[[ -z $memory_sides ]] || arguments+=(--memory-sides "$memory_sides")
[[ -z $peak ]] || arguments+=(--gpu-peak "$peak")
[[ -z $software_limit ]] || arguments+=(--software-limit "$software_limit")
[[ $full == no ]] || arguments+=(--peer-views 24)
say "measuring into $out"
status=0
python3 "$root/tests/bench/run_all.py" "${arguments[@]}" --vtk-bench "$peer" --no-vtk-because "$why" || status=$?
[[ $status -ne 2 ]] || exit 2
python3 "$root/tests/bench/report.py" "$out" || die "the tables could not be made (see above); the CSV files are in $out"
say "the page is $out/README.md"
[[ $status -eq 0 ]] || die "some measurements failed (see above); a broken build is cured by removing build/release"
