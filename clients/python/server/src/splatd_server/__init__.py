# SPDX-License-Identifier: Apache-2.0
"""The daemon splatd and its programs. `splatd.start()` of the package `splatd` starts it."""

import os
import sys
from pathlib import Path

__all__ = ["folder", "program", "run_splatctl", "run_splatd"]


def folder() -> Path:
    """The folder of `splatd` and `splatctl`."""
    return Path(__file__).resolve().parent / "bin"


def program(name: str = "splatd") -> Path:
    """The path of a program: `splatd` or `splatctl`."""
    return folder() / name


def run_splatd() -> None:
    """Replaces this process by the daemon, with the same arguments."""
    os.execv(program("splatd"), ["splatd", *sys.argv[1:]])


def run_splatctl() -> None:
    """Replaces this process by `splatctl`, with the same arguments."""
    os.execv(program("splatctl"), ["splatctl", *sys.argv[1:]])
