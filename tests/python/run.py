# SPDX-License-Identifier: Apache-2.0
"""Runs the tests of the Python package and the examples of its docstrings with pytest.

Usage: run.py PYTHON FOLDER      an interpreter with the packages of requirements.txt; the folder of splatd
"""

import os
import subprocess
import sys
from pathlib import Path

SKIPPED = 77
HERE = Path(__file__).parent
SOURCE = HERE.parents[1] / "clients/python/src"

python, programs = sys.argv[1:]
needed = "import numpy, PIL, urllib3, websockets, xarray, pytest"
if not os.access(python, os.X_OK) or subprocess.run([python, "-c", needed], stderr=subprocess.DEVNULL).returncode:
    print(f"skipped: {python} lacks a package of {HERE / 'requirements.txt'}; deploy/test.sh installs them")
    sys.exit(SKIPPED)
environment = {**os.environ, "PYTHONPATH": str(SOURCE), "SPLATD_BIN": programs, "PYTHONDONTWRITEBYTECODE": "1"}
environment.pop("SPLATD_URL", None)
tests = [str(path) for path in sorted(HERE.glob("*_test.py"))]
command = [
    python,
    "-m",
    "pytest",
    "-q",
    "-p",
    "no:cacheprovider",
    "-W",
    "error",
    "--rootdir",
    str(HERE),
    "-c",
    os.devnull,
]
command += [
    "--confcutdir",
    str(HERE),
    "-p",
    "conftest",
    "--doctest-modules",
    "--doctest-ignore-import-errors",
    *tests,
    str(SOURCE / "splatd"),
]
environment["PYTHONPATH"] += os.pathsep + str(HERE)
sys.exit(subprocess.run(command, env=environment).returncode)
