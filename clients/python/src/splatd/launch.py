# SPDX-License-Identifier: Apache-2.0
"""Starts a daemon and ends it with this process."""

from __future__ import annotations

import collections
import os
import re
import shutil
import subprocess
import tempfile
import threading
import weakref
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .errors import StartFailed

START_SECONDS = 60.0
END_SECONDS = 10.0
LOG_LINES = 50
_ADDRESS = re.compile(r"^splatd: listening on (\S+?)/\?token=(\w+)")


def find_program() -> str:
    """The path of `splatd`: of `$SPLATD_BIN` (a file or a folder), of the package `splatd-server`, or in `$PATH`.

    Raises
    ------
    StartFailed
        There is none. The text says how to get one.
    """
    named = os.environ.get("SPLATD_BIN", "")
    if named:
        path = Path(named)
        path = path / "splatd" if path.is_dir() else path
        if not os.access(path, os.X_OK):
            raise StartFailed(f"SPLATD_BIN: {path} is not a program")
        return str(path)
    if find_spec("splatd_server"):
        import splatd_server  # type: ignore[import-not-found]

        return str(splatd_server.program())
    found = shutil.which("splatd")
    if not found:
        raise StartFailed(
            "no splatd is installed: `pip install splatd-server` brings it (Linux, x86_64), or name the program or "
            "its folder in SPLATD_BIN. For a daemon that runs elsewhere use splatd.connect(url, token=...)"
        )
    return found


def arguments_of(options: dict[str, Any]) -> list[str]:
    """Options of the daemon: `memory="8G"` is `--memory 8G`, `require_gpu=True` is `--require-gpu`, lists repeat.

    >>> arguments_of({"frame_size": "64M", "require_gpu": True, "volume": ["a", "b"]})
    ['--frame-size', '64M', '--require-gpu', '--volume', 'a', '--volume', 'b']
    """
    arguments: list[str] = []
    for name, value in options.items():
        flag = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        for one in value if isinstance(value, (list, tuple)) else [value]:
            arguments += [flag] if one is True else [flag, os.path.expanduser(str(one))]
    return arguments


class Process:
    """A daemon that this process started. It ends with `end`, at exit, or when this process dies: its standard input
    closes then."""

    def __init__(self, options: dict[str, Any]) -> None:
        program = find_program()
        self._folder = tempfile.mkdtemp(prefix="splatd-")
        self.socket_path = os.path.join(self._folder, "socket")
        listen = options.get("listen", "127.0.0.1:0")
        addresses = list(listen) if isinstance(listen, (list, tuple)) else str(listen).split(",")
        named = [address.removeprefix("unix:") for address in addresses if address.startswith("unix:")]
        if named:
            self.socket_path = os.path.abspath(named[0])
        else:
            addresses.append(f"unix:{self.socket_path}")
        options = {**options, "listen": ",".join(addresses)}
        command = [program, "--end-with-input", "--log-format", "text", *arguments_of(options)]
        environment = {
            name: value
            for name, value in os.environ.items()
            if name not in ("NOTIFY_SOCKET", "LISTEN_FDS", "LISTEN_PID")
        }
        try:
            self._child = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=environment,
                start_new_session=True,  # Ctrl-C in a terminal is for Python alone
            )
        except OSError as error:
            raise StartFailed(f"{program}: {error.strerror}") from error
        self.log: collections.deque[str] = collections.deque(maxlen=LOG_LINES)
        # Neither this thread nor the finalizer refers to this object: it can be collected, which ends the daemon.
        self._reader = threading.Thread(target=_read_log, args=(self._child, self.log), name="splatd-log", daemon=True)
        self._reader.start()
        self._finalizer = weakref.finalize(self, _end, self._child, self._folder, os.getpid())
        self.url, self.token = self._wait_for_address()

    def _wait_for_address(self) -> tuple[str, str]:
        """The line in which the daemon says that it is ready."""
        found: list[re.Match[str]] = []

        def read() -> None:
            assert self._child.stdout
            for line in self._child.stdout:
                match = _ADDRESS.match(line.decode(errors="replace"))
                if match:
                    found.append(match)
                    return

        reader = threading.Thread(target=read, name="splatd-start", daemon=True)
        reader.start()
        reader.join(START_SECONDS)
        if not found:
            is_running = self._child.poll() is None
            self.end()
            self._reader.join(1)
            why = (
                f"did not start within {START_SECONDS:.0f} s"
                if is_running
                else f"ended with the status {self._child.returncode}"
            )
            last = "\n".join(list(self.log)[-5:])
            raise StartFailed(f"splatd {why}" + (f":\n{last}" if last else ""))
        return found[0][1], found[0][2]

    @property
    def pid(self) -> int:
        """The process id of the daemon."""
        return self._child.pid

    @property
    def is_running(self) -> bool:
        """False once the daemon has ended."""
        return self._child.poll() is None

    def end(self) -> None:
        """Ends the daemon and waits for it. A second call does nothing."""
        self._finalizer()


def _read_log(child: subprocess.Popen[bytes], log: collections.deque[str]) -> None:
    assert child.stderr
    with child.stderr as lines:
        for line in lines:
            log.append(line.decode(errors="replace").rstrip())


def _end(child: subprocess.Popen[bytes], folder: str, owner: int) -> None:
    if os.getpid() != owner:
        return  # a forked process does not end the daemon of its parent
    if child.poll() is None:
        child.terminate()
        try:
            child.wait(END_SECONDS)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
    for pipe in (child.stdin, child.stdout):
        if pipe:
            pipe.close()
    shutil.rmtree(folder, ignore_errors=True)
