#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Usage: check.sh FOLDER      tests the wheels in FOLDER; deploy/wheel.sh --check calls it.
source "$(dirname "${BASH_SOURCE[0]}")/../../../deploy/common.sh"

here=$root/clients/python/server
wheels=$(realpath "$1")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python=/usr/bin/python3

say "looking at the files of the wheel"
"$python" "$here/check_files.py" "$wheels"/splatd_server-*.whl "$here/README.md"

say "rendering in an empty environment"
"$python" -m venv "$work/venv"
"$work/venv/bin/pip" install -q "$wheels"/*.whl
(cd "$work" && env -u SPLATD_BIN -u SPLATD_URL PATH=/usr/bin:/bin "$work/venv/bin/python" "$here/check_use.py" a.png)
cp "$work/a.png" "$wheels/a.png"

say "rendering where Debian's libraries are hidden"
bare=$work/bare
version=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
mkdir -p "$bare"/{proc,dev/shm,tmp,bin,lib64,usr/lib,site,libraries}
cp -L "$(command -v "/usr/bin/$version")" "$bare/bin/python3"
cp -r "/usr/lib/$version" "$bare/usr/lib/"
cp -r "$work/venv/lib/$version/site-packages/." "$bare/site"
cp "$here/check_use.py" "$bare/"
cp -L /lib64/ld-linux-x86-64.so.2 "$bare/lib64/"
# What Python and its modules need; the programs of the wheel need files of other names (check_files.py).
{
    ldd "$bare/bin/python3" "/usr/lib/$version"/lib-dynload/*.so | awk '/=> \//{print $3}'
    ls /lib/x86_64-linux-gnu/{libc,libm,libdl,libpthread,librt,libresolv,libnss_files,libnss_dns,libgcc_s,libstdc++}.so.[0-9]
} | sort -u | xargs -I{} cp -L {} "$bare/libraries/"
touch "$bare"/dev/{null,urandom,zero}
as_root=()
[[ $(id -u) -eq 0 ]] || as_root=(--map-root-user)
# The new mounts end with the process.
unshare "${as_root[@]}" --mount bash -euc '
    cd "$1"
    mount --rbind /proc proc
    for name in null urandom zero; do mount --bind /dev/$name dev/$name; done
    exec env -i LD_LIBRARY_PATH=/libraries PYTHONHOME=/usr PYTHONPATH=/site TMPDIR=/tmp PATH=/bin \
        /usr/sbin/chroot . /bin/python3 /check_use.py /tmp/a.png' bash "$bare"
cmp "$work/a.png" "$bare/tmp/a.png" || die "the two images differ"
say "the wheels work; the image is $wheels/a.png"
