#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Tests the notebook widget of the Python package in JupyterLab.
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

usage() {
    cat <<'TEXT'
Usage: deploy/notebook-test.sh [--no-install]

Builds the release preset, installs JupyterLab and the Python package into build/notebook (370 MB),
and runs the tests of tests/notebook in Chromium. deploy/test.sh must have installed
tests/node_modules.

  --no-install    test with what is already installed
  --help          this text

With SPLATD_SHOTS_DIR=FOLDER the tests write screenshots.
TEXT
}

install=yes
for argument in "$@"; do
    case $argument in
    --no-install) install=no ;;
    --help) usage; exit 0 ;;
    *) usage >&2; exit 2 ;;
    esac
done

[[ $install == no ]] || install_packages build test python
build release splatd splatd_widget
requirements=$root/tests/notebook/requirements.txt
venv=$root/build/notebook
if [[ $install == yes ]] && ! cmp -s "$requirements" "$venv/requirements.txt"; then
    say "installing JupyterLab into build/notebook"
    if ! { /usr/bin/python3 -m venv --clear "$venv" && "$venv/bin/pip" install -q -r "$requirements" -e "$root/clients/python" &&
        cp "$requirements" "$venv"; }; then
        die "JupyterLab could not be installed: check the network, then run again"
    fi
fi
export SPLATD_BIN_DIR=$root/build/release/bin
exec "$root/tests/web/run.sh" --chromium "$root"/tests/notebook/*.test.mjs
