# SPDX-License-Identifier: Apache-2.0
"""What this process knows of the notebook that it computes for."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from urllib.parse import urlsplit

LOOPBACK = ("localhost", "127.0.0.1")


def is_kernel() -> bool:
    """True if a notebook shows what this process returns."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if shell is not None:
        return hasattr(shell, "kernel")
    marimo = sys.modules.get("marimo")
    return bool(marimo and marimo.running_in_notebook())


def origins_of(url: str) -> list[str]:
    """The origins under which a browser of this computer opens the server at a URL.

    >>> origins_of("http://localhost:8888/lab/")
    ['http://localhost:8888', 'http://127.0.0.1:8888']
    """
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        return []
    hosts = LOOPBACK if parts.hostname in LOOPBACK else (parts.hostname,)
    port = f":{parts.port}" if parts.port else ""
    return [f"{parts.scheme}://{host}{port}" for host in hosts]


def server_origins() -> list[str]:
    """The origins of the Jupyter server that started this kernel, from the file in which it describes itself. Empty
    without one."""
    pid = os.environ.get("JPY_PARENT_PID", "")
    if not pid.isdigit():
        return []
    try:
        from jupyter_core.paths import jupyter_runtime_dir  # pyright: ignore[reportMissingImports]

        about = json.loads((Path(jupyter_runtime_dir()) / f"jpserver-{pid}.json").read_text(encoding="utf-8"))
        return origins_of(str(about["url"]))
    except (ImportError, OSError, ValueError, KeyError, TypeError):
        return []
