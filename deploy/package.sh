#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the Debian package, and tests it in a bare Debian.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

usage() {
    cat <<'TEXT'
Usage: deploy/package.sh [--no-install] [--out DIR] [--check]

Builds splatd with Debian's compiler flags and makes splatd_VERSION_ARCHITECTURE.deb. Install
it with: apt install ./splatd_…deb

  --out DIR      where the package goes (default build/package)
  --check        also looks at the package with lintian, and tests it in a bare Debian 12 that
                 mmdebstrap makes below $TMPDIR or /tmp (as root; 1.5 GB, about 5 minutes,
                 from the mirrors of /etc/apt): install, start, a request over HTTP, upgrade
                 with a changed configuration, remove, purge
  --no-install   use what is already installed
  --help         this text
TEXT
}

install=yes check=no out=$root/build/package
while [[ $# -gt 0 ]]; do
    case $1 in
    --no-install) install=no ;;
    --check) check=yes ;;
    --out) [[ $# -ge 2 ]] || { usage >&2; exit 2; }; out=$2; shift ;;
    --help) usage; exit 0 ;;
    *) usage >&2; exit 2 ;;
    esac
    shift
done

umask 022
if [[ $install == yes ]]; then
    install_packages build package
    [[ $check == no ]] || install_packages check
fi
command -v dpkg-buildflags >/dev/null 2>&1 || die "dpkg-dev is missing: run without --no-install"

folder=$root/build/package
mkdir -p "$folder" "$out"
log=$folder/package.log
flags() {
    DEB_BUILD_MAINT_OPTIONS=hardening=+all DEB_CFLAGS_MAINT_STRIP='-g -O2' DEB_CXXFLAGS_MAINT_STRIP='-g' \
        dpkg-buildflags --get "$1"
}
# make_package: the outputs of all steps go to the log.
make_package() {
    cmake -S "$root" -B "$folder" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX=/usr -DSPLATD_TESTS=OFF \
        -DSPLATD_SHARED=OFF "-DCMAKE_C_FLAGS=$(flags CPPFLAGS) $(flags CFLAGS)" -DCMAKE_C_FLAGS_RELEASE=-O3 \
        "-DCMAKE_CXX_FLAGS=$(flags CPPFLAGS) $(flags CXXFLAGS)" -DCMAKE_CXX_FLAGS_RELEASE=-O2 \
        "-DCMAKE_EXE_LINKER_FLAGS=$(flags LDFLAGS)" "-DCMAKE_MODULE_LINKER_FLAGS=$(flags LDFLAGS)" &&
        cmake --build "$folder" --target all splatd_debian && rm -f "$folder"/splatd_*.deb && (cd "$folder" && cpack)
}
say "building the package"
make_package </dev/null >"$log" 2>&1 || {
    tail -n 40 "$log" >&2
    die "the package could not be built (see above and $log); a stale build folder is cured by removing build/package"
}
package=$(realpath "$folder"/splatd_*.deb)
if [[ ! $out -ef $folder ]]; then
    cp "$package" "$out"
    package=$(realpath "$out")/${package##*/}
fi
say "the package is $package"
[[ $check == no ]] || exec "$root/deploy/package/check.sh" "$package"
