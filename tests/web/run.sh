#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Runs Node tests: run.sh [--data] [--chromium | --firefox | --proxies] FILE... Exits with status 77 and a message if a dependency is missing.
here=$(dirname "$0")

skip() {
    echo "skipped: $1"
    exit 77
}

command -v node >/dev/null 2>&1 || skip "no node (Debian package nodejs)"
[ "$(node -p 'Number(process.versions.node.split(".")[0]) >= 18')" = true ] || skip "node is older than 18"
[ -d "$here/../node_modules/ws" ] || skip "no tests/node_modules: run npm ci in tests/"
if [ "$1" = --data ]; then
    shift
    [ -d "$SPLATD_DATA_DIR/volumes" ] || skip "no real volumes in $SPLATD_DATA_DIR/volumes (SPLATD_DATA_DIR)"
fi
if [ "$1" = --chromium ]; then
    shift
    [ -x "${SPLATD_CHROMIUM:-/usr/bin/chromium}" ] || skip "no /usr/bin/chromium (Debian package chromium)"
    [ -d "$here/../node_modules/playwright-core" ] || skip "no tests/node_modules/playwright-core: run npm ci in tests/"
fi
if [ "$1" = --firefox ]; then
    shift
    [ -x "${SPLATD_FIREFOX:-/usr/bin/firefox-esr}" ] || skip "no /usr/bin/firefox-esr (Debian package firefox-esr)"
fi
if [ "$1" = --proxies ]; then
    shift
    [ -x /usr/sbin/nginx ] || skip "no /usr/sbin/nginx (Debian package nginx-light)"
    [ -x /usr/sbin/haproxy ] || skip "no /usr/sbin/haproxy (Debian package haproxy)"
fi
exec node --test "$@"
