#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what is needed, builds, and starts the daemon with a built-in volume.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

usage() {
    cat <<'TEXT'
Usage: deploy/run.sh [--no-install] [DAEMON ARGUMENT...]

Installs the Debian packages that splatd needs (as root or with sudo), builds it into
build/release, and starts it on 127.0.0.1:8080 with a built-in volume. It prints the
address to open; Ctrl-C stops it.

  --no-install   build and start with what is already installed
  --help         this text

Every other argument goes to the daemon; a --volume among them replaces the built-in one:
  deploy/run.sh --volume ~/ct/head.nrrd
  deploy/run.sh --listen 127.0.0.1:0 --data ~/ct
  deploy/run.sh -- --help          the daemon's own help
TEXT
}

install=yes arguments=() volume=(--volume demo:engine)
while [[ $# -gt 0 ]]; do
    case $1 in
    --no-install) install=no ;;
    --help) usage; exit 0 ;;
    --) shift; arguments+=("$@"); break ;;
    --volume | --volume=*) volume=() arguments+=("$1") ;;
    *) arguments+=("$1") ;;
    esac
    shift
done

[[ $install == no ]] || install_packages build
build release splatd splatctl splat-bench splat-import splat-exr
exec "$root/build/release/bin/splatd" ${volume[@]+"${volume[@]}"} ${arguments[@]+"${arguments[@]}"}
