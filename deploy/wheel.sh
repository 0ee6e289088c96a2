#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the Python wheels, and tests them where Debian's libraries are hidden.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

usage() {
    cat <<'TEXT'
Usage: deploy/wheel.sh [--no-install] [--check]

Builds splatd (pure Python) and splatd-server (the daemon and its libraries, for Linux on
x86_64 with glibc 2.36 or later) in build/wheels. Install them with:
pip install build/wheels/*.whl

  --check        also installs them in an empty environment and renders an image there; then
                 again below a root folder that has Python, glibc and GCC's libraries alone
                 (as root, or where unshare may create user namespaces; 500 MB below $TMPDIR)
  --no-install   use what is already installed
  --help         this text
TEXT
}

install=yes check=no out=$root/build/wheels
while [[ $# -gt 0 ]]; do
    case $1 in
    --no-install) install=no ;;
    --check) check=yes ;;
    --help) usage; exit 0 ;;
    *) usage >&2; exit 2 ;;
    esac
    shift
done

umask 022
[[ $install == no ]] || install_packages build python
tools=$root/build/wheel-tools
mkdir -p "$out" "$root/build/server-wheel"
log=$root/build/server-wheel/wheel.log
# make_wheels: the outputs of all steps go to the log.
make_wheels() {
    local server=$root/clients/python/server made
    [[ -x $tools/bin/python ]] || /usr/bin/python3 -m venv "$tools" || return
    "$tools/bin/pip" install -q -r "$server/requirements.txt" || return
    made=$(mktemp -d) || return
    rm -f "$out"/*.whl
    PATH=$tools/bin:$PATH
    pip wheel --no-deps --no-build-isolation -w "$out" "$root/clients/python" &&
        pip wheel --no-deps --no-build-isolation -w "$made" "$server" &&
        python "$server/bundle.py" "$made"/*.whl "$out"
    local status=$?
    rm -rf "$made"
    return $status
}
say "building the wheels"
make_wheels </dev/null >"$log" 2>&1 || {
    tail -n 40 "$log" >&2
    die "the wheels could not be built (see above and $log)"
}
say "the wheels are" "$out"/*.whl
[[ $check == no ]] || exec "$root/clients/python/server/check.sh" "$out"
