#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the Python package and its tests with ruff and pyright, whose settings are in clients/python/pyproject.toml.

  lint_python.py SOURCE      the folder of the repository; exits with 77 if a checker is not installed
"""

import shutil
import subprocess
import sys
from pathlib import Path

SKIPPED = 77


def main():
    source = Path(sys.argv[1])
    interpreter = source / 'build/python/bin/python'
    pyright = source / 'tests/node_modules/pyright/index.js'
    settings = source / 'clients/python'
    ruff = [interpreter, '-m', 'ruff']
    has_ruff = interpreter.exists() and subprocess.run([*ruff, '--version'], capture_output=True, check=False).returncode == 0
    if not has_ruff or not pyright.exists() or not shutil.which('node'):
        print('skipped: no ruff in build/python, or no pyright in tests/node_modules; deploy/test.sh installs both')
        return SKIPPED
    options = ['--no-cache', '--config', settings / 'pyproject.toml']
    folders = [settings, source / 'tests/python']
    commands = ([*ruff, 'check', *options, '--output-format', 'concise', *folders], [*ruff, 'format', '--check', *options, *folders],
                ['node', pyright, '-p', settings, '--pythonpath', interpreter])
    return 1 if any([subprocess.run(command, cwd=source, check=False).returncode for command in commands]) else 0


if __name__ == '__main__':
    sys.exit(main())
