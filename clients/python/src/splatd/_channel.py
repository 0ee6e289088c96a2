# SPDX-License-Identifier: Apache-2.0
"""Streams and requests of a notebook's page that pass through the kernel (clients/web/widget/kernel.js).

Frames pass undecoded. The page acknowledges them through the kernel, so the daemon sends no more than arrives there.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from websockets.exceptions import ConnectionClosed

from . import errors
from ._http import TRANSPORT_ERRORS, Http, segment
from .stream import Stream

IDLE_SECONDS = 180.0  # without a message of the page, which sends one every 5 s, or once per minute in a hidden tab
LOOK_SECONDS = 15.0  # between two looks at that time
LOST = 1006  # a stream that ended without a reason of the daemon
REQUEST_BYTES_MAX = 1 << 20
READ_SECONDS = 60.0

Send = Callable[[Mapping[str, Any], "list[bytes] | None"], None]
"""Sends a message and its buffers to the page."""

_READS = ("", "/visible", "/histogram", "/slice", "/snapshot", "/measures")


class Channel:
    """One stream of the session for one view of the page, in a thread of its own."""

    def __init__(self, http: Http, session: str, id: int, send: Send) -> None:
        self._http = http
        self._session = session
        self._id = id
        self._send_to_page = send
        self._socket: Any = None
        self._is_closed = False
        self._heard = time.monotonic()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name=f"splatd-widget-{session}", daemon=True)
        self._thread.start()

    def _tell(self, type: str, buffers: list[bytes] | None = None, **content: Any) -> None:
        self._send_to_page({"type": type, "id": self._id, **content}, buffers)

    def _run(self) -> None:
        code, reason = LOST, ""
        try:
            with Stream._open(self._http, self._session) as socket:
                with self._lock:
                    self._socket = socket
                    is_closed = self._is_closed
                if not is_closed:
                    self._tell("opened")
                    code, reason = self._pass_on(socket)
        except errors.Error as error:
            reason = error.detail
        except (OSError, ValueError) as error:
            reason = str(error)
        if not self._is_closed:
            self._tell("closed", code=code, reason=reason)

    def _pass_on(self, socket: Any) -> tuple[int, str]:
        """Passes messages to the page until the stream ends; why it ended."""
        while not self._is_closed:
            try:
                message = socket.recv(timeout=LOOK_SECONDS)
            except TimeoutError:
                if time.monotonic() - self._heard > IDLE_SECONDS:
                    return LOST, "the page is gone"
                continue
            except ConnectionClosed as error:
                return (error.rcvd.code, error.rcvd.reason) if error.rcvd else (LOST, "")
            if isinstance(message, bytes):
                self._tell("frame", [message])
            else:
                self._tell("text", text=message)
        return LOST, ""

    def send(self, text: str) -> None:
        """Passes a message of the page to the daemon. Does nothing unless the stream is open."""
        self._heard = time.monotonic()
        with self._lock:
            socket = self._socket
        if socket:
            try:
                socket.send(text)
            except (ConnectionClosed, OSError):
                pass  # the thread tells it

    def close(self) -> None:
        """Leaves the session. The thread ends at once."""
        with self._lock:
            self._is_closed = True
            socket = self._socket
        if socket:
            socket.close()

    @property
    def is_alive(self) -> bool:
        """True until the thread has ended."""
        return self._thread.is_alive()


def is_allowed(method: str, path: str, session: str) -> bool:
    """True for what a view needs of its session; the page gets nothing else of the daemon.

    >>> is_allowed("GET", "api/v1/sessions/s1/histogram?axis=value", "s1")
    True
    >>> is_allowed("DELETE", "api/v1/sessions/s1", "s1"), is_allowed("GET", "api/v1/sessions/s1/../s2", "s1")
    (False, False)
    """
    route, _, _ = path.partition("?")
    own = f"api/v1/sessions/{segment(session)}"
    if not route.startswith(own) or not re.fullmatch(r"[A-Za-z0-9._~%/-]*", route) or ".." in route:
        return False
    rest = route[len(own) :]
    if method == "POST":
        return rest == "/measure"
    return method == "GET" and (rest in _READS or rest == "/volumes" or rest.startswith("/volumes/"))


def answer(http: Http, session: str, request: Mapping[str, Any]) -> tuple[dict[str, Any], bytes]:
    """Sends a request of the page to the daemon: the status and the headers of its answer, and the body."""
    method, path, body = str(request.get("method")), str(request.get("path")), request.get("body")
    if not is_allowed(method, path, session) or (body is not None and len(body) > REQUEST_BYTES_MAX):
        return {"status": 403, "headers": {}}, b'{"detail": "the kernel passes only requests of this session"}'
    headers = {"Content-Type": "application/json"} if body else None
    try:
        got = http.raw(method, path, body=body.encode() if body else None, headers=headers, read_seconds=READ_SECONDS)
    except TRANSPORT_ERRORS:
        return {"status": 502, "headers": {}}, b'{"detail": "the daemon does not answer"}'
    kept = {name: got.headers[name] for name in ("Content-Type", "X-Slice", "Retry-After") if name in got.headers}
    return {"status": got.status, "headers": kept}, got.data
