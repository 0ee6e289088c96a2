# SPDX-License-Identifier: Apache-2.0
# Shared by run.sh, test.sh and bench.sh; sourced, never run. Needs bash.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

die() {
    echo "${0##*/}: $*" >&2
    exit 1
}

say() {
    echo "== $*" >&2
}

# install_packages KIND...: installs what is missing of those kinds in packages.txt.
install_packages() {
    command -v apt-get >/dev/null 2>&1 ||
        die "this is not Debian (no apt-get): install what deploy/packages.txt lists by your own means, then run again with --no-install"
    local kinds=" $* " wanted=() missing=() kind name
    while read -r kind name; do
        [[ $kind == \#* || -z $kind ]] && continue
        [[ $kinds == *" $kind "* ]] && wanted+=("$name")
    done <"$root/deploy/packages.txt"
    for name in "${wanted[@]}"; do
        # A node or npm that did not come from Debian serves as well.
        case $name in nodejs) command -v node >/dev/null 2>&1 && continue ;; npm) command -v npm >/dev/null 2>&1 && continue ;; esac
        [[ $(dpkg-query -W -f='${Status}' "$name" 2>/dev/null) == "install ok installed" ]] || missing+=("$name")
    done
    [[ ${#missing[@]} -eq 0 ]] && return 0
    local as_root=()
    if [[ $(id -u) -ne 0 ]]; then
        command -v sudo >/dev/null 2>&1 ||
            die "installing ${missing[*]} needs root: run this as root, or install sudo, or install them yourself and use --no-install"
        as_root=(sudo)
    fi
    say "installing ${missing[*]}"
    local log
    log=$(mktemp)
    if ! { "${as_root[@]}" apt-get update -qq &&
        "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"; } </dev/null >"$log" 2>&1; then
        tail -n 20 "$log" >&2
        rm -f "$log"
        die "apt-get could not install them (see above): check /etc/apt/sources.list and the network, then run again"
    fi
    rm -f "$log"
}

# build PRESET [TARGET...]: configures and builds; CMAKE_ARGS is handed to the configuration.
build() {
    local preset=$1 log
    shift
    command -v cmake >/dev/null 2>&1 || die "cmake is missing: run without --no-install, or install what deploy/packages.txt lists"
    say "building $preset"
    log=$(mktemp)
    if ! (cd "$root" && cmake --preset "$preset" ${CMAKE_ARGS[@]+"${CMAKE_ARGS[@]}"} &&
        cmake --build --preset "$preset" ${@:+--target "$@"}) </dev/null >"$log" 2>&1; then
        tail -n 60 "$log" >&2
        rm -f "$log"
        die "the $preset build failed (see above): if a package is missing, run without --no-install; a stale build folder is cured by removing build/$preset"
    fi
    rm -f "$log"
}
