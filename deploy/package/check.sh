#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# check.sh PACKAGE: looks at the package with lintian and tests it in a bare Debian 12: install, start, requests over HTTP, upgrade,
# remove, purge. deploy/package.sh --check runs it. systemd does not run there: the test starts the line ExecStart of the unit as the
# unit's user, with the folders that systemd would create. Exit status 77: skipped, and the output says why.
source "$(dirname "${BASH_SOURCE[0]}")/../common.sh"

skip() {
    say "skipped: $*"
    exit 77
}

# same WHAT EXPECTED FOUND
same() {
    [[ $2 == "$3" ]] || die "$1: expected \"$2\", found \"$3\""
}

# here COMMAND...: runs it in the bare Debian.
here() {
    chroot "$debian" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
        "http_proxy=${http_proxy:-}" "https_proxy=${https_proxy:-}" "$@"
}

# apt ARGUMENT...: apt-get, with its output only if it fails.
apt() {
    here apt-get -y -q -o Dpkg::Options::=--force-confold "$@" >"$debian/apt.log" 2>&1 || {
        tail -n 30 "$debian/apt.log" >&2
        die "apt-get $* failed"
    }
}

# start: runs the service as its unit says, and sets $pid, $url and $token.
start() {
    local line
    line=$(sed -n 's/^ExecStart=//p' "$debian"/usr/lib/systemd/system/splatd.service)
    user=$(sed -n 's/^User=//p' "$debian"/usr/lib/systemd/system/splatd.service)
    here install -d -o "$user" -g "$user" -m 0700 /var/lib/splatd /var/cache/splatd
    chroot --userspec="$user:$user" "$debian" /usr/bin/env -i PATH=/usr/bin:/bin $line >"$debian/tmp/out" 2>"$debian/tmp/log" &
    pid=$!
    until grep -q '^splatd: listening on' "$debian/tmp/out"; do
        kill -0 "$pid" 2>/dev/null || { cat "$debian/tmp/log" >&2; die "the service ended"; }
        sleep 0.1
    done
    url=$(sed -n 's/^splatd: listening on //p' "$debian/tmp/out")
    token=$(sed -n '1s/ .*//p' "$debian"/etc/splatd/tokens)
    same "the daemon prints no token of the file" "" "$(grep -F "$token" "$debian/tmp/out" "$debian/tmp/log" || true)"
}

stop() {
    local status=0
    kill -TERM "$pid"
    wait "$pid" || status=$?
    same "exit status of the service" 0 "$status"
}

control() {
    here env SPLATD_URL="$url" SPLATD_TOKEN="$token" splatctl "$@"
}

# is_image FILE TYPE
is_image() {
    same "type of $1" "$2" "$(head -c 4 "$debian/$1" | od -An -tx1 | tr -d ' \n')"
}

# leftovers: what has the name of the package or belongs to a user that is gone.
leftovers() {
    find "$debian" -xdev \( -path "$debian/proc" -o -path "$debian/dev" -o -path "$debian/tmp" -o -path "$debian/var/log" -o -path "$debian/var/cache/apt" \
        -o -path "$debian/srv" -o -path "$debian/packages" \) -prune -o \( -iname '*splat*' -o -nouser -o -nogroup \) -print
    grep -H splatd "$debian"/etc/{passwd,group,shadow,gshadow} || true
}

# The part that runs inside of namespaces of its own: mounts and processes end with it.
inside() {
    debian=$1
    mount --make-rprivate /
    mount -t proc proc "$debian/proc"
    mount --rbind /dev "$debian/dev"
    cp /etc/resolv.conf "$debian/etc/resolv.conf"
    chmod 1777 "$debian/tmp"
    printf '#!/bin/sh\nexit 101\n' >"$debian/usr/sbin/policy-rc.d"
    chmod 755 "$debian/usr/sbin/policy-rc.d"
    same "nothing of splatd before" "" "$(leftovers)"

    say "installing"
    apt update
    apt install --no-install-recommends /packages/1.deb
    say "$(grep -c '^Setting up' "$debian/apt.log") packages installed"
    same "tokens" "640 root splatd" "$(here stat -c '%a %U %G' /etc/splatd/tokens)"
    same "the service is enabled" /lib/systemd/system/splatd.service "$(readlink "$debian"/etc/systemd/system/multi-user.target.wants/splatd.service)"
    same "missing libraries" "" "$(here sh -c 'ldd /usr/bin/splat* /usr/lib/splatd/* | grep "not found"' || true)"
    same "address without a change" "listen = 127.0.0.1:8080" "$(here splatd --config /etc/splatd/splatd.conf --print-config | grep '^listen')"
    here splatctl --version

    say "starting with a changed configuration"
    printf 'listen = 127.0.0.1:0\ndata = /srv/volumes\n' >>"$debian/etc/splatd/splatd.conf"
    local config
    config=$(cat "$debian/etc/splatd/splatd.conf")
    mkdir "$debian/srv/volumes"
    { printf 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: raw\n\n'; head -c 4096 /dev/urandom; } >"$debian/srv/volumes/noise.nrrd"
    here splatctl render --local --volume demo:engine?size=64 --size 64x64 --out /srv/volumes/slice.png
    start
    control render --volume demo:engine --size 128x128 --out /tmp/demo.png
    is_image tmp/demo.png 89504e47
    control render --volume noise.nrrd --size 128x128 --out /tmp/noise.exr
    is_image tmp/noise.exr 762f3101
    control render --volume slice.png --size 64x64 --format webp --out /tmp/slice.webp
    is_image tmp/slice.webp 52494646
    if here env SPLATD_URL="$url" splatctl volumes >/dev/null 2>&1; then
        die "the service answers without a token"
    fi
    local view
    view=$(control save --volume demo:engine)
    local tokens
    tokens=$(cat "$debian/etc/splatd/tokens")
    stop

    say "upgrading"
    apt install --no-install-recommends /packages/2.deb
    same "version" "$(here dpkg-deb -f /packages/2.deb Version)" "$(here dpkg-query -W -f '${Version}' splatd)"
    same "configuration after the upgrade" "$config" "$(cat "$debian/etc/splatd/splatd.conf")"
    same "tokens after the upgrade" "$tokens" "$(cat "$debian/etc/splatd/tokens")"
    [[ -e $debian/etc/splatd/splatd.conf.dpkg-dist ]] || die "the new configuration is not beside the changed one"
    start
    control saved "$view" >/dev/null
    stop

    say "removing, installing again"
    apt remove splatd
    [[ ! -e $debian/usr/bin/splatd && ! -e $debian/usr/lib/splatd ]] || die "programs are left after remove"
    same "configuration after remove" "$config" "$(cat "$debian/etc/splatd/splatd.conf")"
    same "tokens after remove" "$tokens" "$(cat "$debian/etc/splatd/tokens")"
    [[ -e $debian/var/lib/splatd/splatd.db ]] || die "the state is gone after remove"
    apt install --no-install-recommends /packages/2.deb
    start
    control saved "$view" >/dev/null
    stop

    say "purging"
    apt purge splatd
    same "left after purge" "" "$(leftovers)"
    say "the package passed"
}

if [[ ${1:-} == --inside ]]; then
    inside "$2"
    exit
fi
[[ $# -eq 1 && -f $1 ]] || die "usage: check.sh PACKAGE"
package=$(realpath "$1")
if command -v lintian >/dev/null 2>&1; then
    say "lintian"
    lintian --allow-root --fail-on error "$package" || die "lintian found errors"
else
    say "skipped: lintian is not installed"
fi
[[ $(id -u) -eq 0 ]] || skip "a bare Debian needs root"
command -v mmdebstrap >/dev/null 2>&1 || skip "mmdebstrap is not installed"
unshare --mount --pid --fork true 2>/dev/null || skip "this container allows no namespaces"

work=$(mktemp -d)
trap 'rm -rf --one-file-system "$work"' EXIT
# A higher version whose configuration changed.
dpkg-deb -R "$package" "$work/next"
sed -i 's/^Version: .*/&+next/' "$work/next/DEBIAN/control"
echo '# a new setting' >>"$work/next/etc/splatd/splatd.conf"
(cd "$work/next" && find . -type f ! -path './DEBIAN/*' -printf '%P\0' | sort -z | xargs -0 md5sum >DEBIAN/md5sums)
mkdir "$work/packages"
dpkg-deb --root-owner-group -b "$work/next" "$work/packages/2.deb" >/dev/null
cp "$package" "$work/packages/1.deb"

say "making a bare Debian 12"
mapfile -t mirrors < <(apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' 'Origin: Debian' 2>/dev/null)
mmdebstrap --quiet --mode=root --variant=minbase bookworm "$work/debian" ${mirrors[@]+"${mirrors[@]}"} ||
    die "mmdebstrap failed (see above): check /etc/apt/sources.list and the network, then run again"
mv "$work/packages" "$work/debian/packages"
unshare --mount --pid --fork --kill-child -- "$0" --inside "$work/debian"
