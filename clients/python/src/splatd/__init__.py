# SPDX-License-Identifier: Apache-2.0
"""splatd renders volumes next to the data: from an array to an interactive image in five lines.

>>> import splatd
>>> image = demo.view(size=(64, 48)).with_camera(azimuth=90).render()
>>> image.shape
(48, 64, 4)

`start` runs a daemon on this computer, `connect` uses one that runs. Arrays are in numpy's order (z, y, x); positions
in the world are x, y, z. All errors are subclasses of `Error`.
"""

from __future__ import annotations

import os
from typing import Any

from . import errors, layers, types
from .camera_path import Job, Path
from .daemon import Daemon, SavedView
from .errors import Error
from .image import Image
from .launch import Process
from .session import Session
from .stream import Frame, Stream
from .view import View
from .volume import Histogram, Slice, Volume

__version__ = "0.1.0"
__all__ = [
    "Daemon",
    "Error",
    "Frame",
    "Histogram",
    "Image",
    "Job",
    "Path",
    "SavedView",
    "Session",
    "Slice",
    "Stream",
    "View",
    "Volume",
    "connect",
    "errors",
    "layers",
    "start",
    "types",
]


def start(**options: Any) -> Daemon:
    """Starts a daemon on this computer, on a free port of 127.0.0.1, with a random token.

    It ends with `close`, at the end of a `with` statement, or with this process, however that ends.

    Parameters
    ----------
    options
        The options of `splatd --help`, with underscores for hyphens: `memory="8G"`, `data="scans"`, `backend="cpu"`,
        `volume=["a.nrrd", "demo:engine"]`, `require_gpu=True`.

    Raises
    ------
    StartFailed
        No `splatd` is installed, or it does not start; the text has its last messages.
    """
    process = Process({"listen": "127.0.0.1:0", **options})
    return Daemon(process.url, process.token, process)


def connect(url: str | None = None, *, token: str | None = None) -> Daemon:
    """Uses a daemon that runs here or elsewhere.

    Parameters
    ----------
    url : str
        Its address: `http://127.0.0.1:8080`, also with `?token=…` as the daemon prints it, or `unix:PATH`. Default:
        `$SPLATD_URL`.
    token : str
        Default: the token of the address, or `$SPLATD_TOKEN`.

    Raises
    ------
    ConnectionFailed, IncompatibleVersion
    """
    url = url or os.environ.get("SPLATD_URL")
    if not url:
        raise ValueError(
            "connect: give the address of the daemon, or set SPLATD_URL. splatd.start() runs one on this computer"
        )
    return Daemon.connect(url, os.environ.get("SPLATD_TOKEN", "") if token is None else token)
