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
import threading
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from . import errors, labelled, layers, notebook, types
from .camera_path import Job, Path
from .daemon import Daemon, SavedView
from .errors import Error
from .image import Image
from .launch import Process
from .memory import empty
from .session import Session
from .stream import Frame, Stream
from .view import View
from .volume import Histogram, Slice, Volume

if TYPE_CHECKING:
    from .widget import Widget

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
    "default_daemon",
    "empty",
    "errors",
    "layers",
    "plot",
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
        `volume=["a.nrrd", "demo:engine"]`, `require_gpu=True`. In a notebook, `allow_origin` is by default the
        address of its Jupyter server, so that its pages show widgets of this daemon.

    Raises
    ------
    StartFailed
        No `splatd` is installed, or it does not start; the text has its last messages.
    """
    origins = ",".join(notebook.server_origins()) or None
    process = Process({"allow_origin": origins, **options})
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


_default: Daemon | None = None
_default_lock = threading.Lock()


def default_daemon() -> Daemon:
    """The daemon of `plot`: that of `$SPLATD_URL`, or one that starts at the first call and ends with this process."""
    global _default
    with _default_lock:
        if _default and _default.process and not _default.process.is_running:
            _default = None
        if _default is None:
            _default = connect() if os.environ.get("SPLATD_URL") else start()
        return _default


def plot(what: Any, **options: Any) -> Session | Widget:
    """Shows an array, a volume or a view: in the notebook, else in a browser.

    Parameters
    ----------
    what
        Anything that `Daemon.add` takes, a `Volume`, or a `View`.
    options
        Of `Daemon.add`, for an array.

    Returns
    -------
    Session or Widget
        Without a notebook the shared view, which lasts as long as the daemon, or until `delete`. In a notebook the
        widget, if it is installed (`pip install 'splatd[jupyter]'`).
    """
    view = what
    if isinstance(view, Volume):
        view = view.view()
    if not isinstance(view, View):
        view = default_daemon().add(what, **options).view()
    if notebook.is_kernel() and find_spec("anywidget"):
        return view.show()
    session = view.share()
    session.open()
    return session


labelled.register()
