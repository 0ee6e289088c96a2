# SPDX-License-Identifier: Apache-2.0
"""Requests to the daemon: JSON, errors, repeated attempts, and Unix sockets."""

from __future__ import annotations

import json as jsonlib
import os
import socket
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

import numpy as np
import urllib3
from urllib3.connection import HTTPConnection

from . import errors

CONNECT_SECONDS = 10.0
ANSWER_SECONDS = 600.0  # a frame of a large volume may wait for others
TRANSPORT_ERRORS = (OSError, urllib3.exceptions.HTTPError, errors.ConnectionFailed)  # while an answer is being read
IDLE_CONNECTIONS = 64  # that are kept for the next requests
ATTEMPTS = 6  # at a full daemon, which answers with Retry-After


class _UnixConnection(HTTPConnection):
    """HTTP over a Unix socket: the host is the path of the socket."""

    socket_path = ""

    def _new_conn(self) -> socket.socket:
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            sock.settimeout(CONNECT_SECONDS)
            sock.connect(self.socket_path)
        except OSError as error:
            sock.close()
            raise urllib3.exceptions.NewConnectionError(self, f"{self.socket_path}: {error}") from error
        return sock


class _UnixPool(urllib3.HTTPConnectionPool):
    def __init__(self, path: str, **options: Any) -> None:
        self.ConnectionCls: Any = type("_BoundUnixConnection", (_UnixConnection,), {"socket_path": path})
        super().__init__("localhost", **options)


def _is_closed_by_peer(error: BaseException) -> bool:
    """True if the daemon closed the connection before it answered."""
    return isinstance(error, (urllib3.exceptions.ProtocolError, ConnectionError))


class Http:
    """Sends requests to one daemon. Objects may be used by several threads at once.

    Parameters
    ----------
    url : str
        The address of the daemon, with the path below which a proxy serves it, or `unix:PATH`.
    token : str
        Token of the daemon or of a session. An empty text sends no token.
    """

    def __init__(self, url: str, token: str = "") -> None:
        self.url = url.rstrip("/")
        self.token = token
        self.socket_path = url[len("unix:") :] if url.startswith("unix:") else ""
        retry = urllib3.Retry(
            total=ATTEMPTS,
            connect=0,
            read=0,
            other=0,
            redirect=0,
            allowed_methods=None,  # 429 and 503 mean that nothing has happened
            raise_on_status=False,
            respect_retry_after_header=True,
        )
        options: dict[str, Any] = {
            "maxsize": IDLE_CONNECTIONS,
            "retries": retry,
            "timeout": urllib3.Timeout(connect=CONNECT_SECONDS, read=ANSWER_SECONDS),
        }
        self._prefix = "" if self.socket_path else urlsplit(self.url).path
        self._options = options
        self._pool, self._pid = self._new_pool(), os.getpid()

    def _new_pool(self) -> urllib3.HTTPConnectionPool:
        if self.socket_path:
            return _UnixPool(self.socket_path, **self._options)
        return urllib3.connection_from_url(self.url, **self._options)

    def _own_pool(self) -> urllib3.HTTPConnectionPool:
        """The connections of this process. A forked process makes its own: shared ones would mix up answers."""
        if self._pid != os.getpid():
            self._pool, self._pid = self._new_pool(), os.getpid()
        return self._pool

    def close(self) -> None:
        """Closes idle connections."""
        self._pool.close()

    def raw(
        self,
        method: str,
        path: str,
        *,
        query: Mapping[str, Any] | None = None,
        json: Any = None,
        body: Any = None,
        headers: Mapping[str, str] | None = None,
        stream: bool = False,
        read_seconds: float | None = None,
    ) -> urllib3.BaseHTTPResponse:
        """Sends one request and returns the answer, which may be an error.

        Parameters
        ----------
        path : str
            Relative to the address of the daemon, without a leading slash; already quoted.
        query
            Members that are None are left out.
        body
            Bytes, a file, or an iterable of bytes; `json` is encoded instead.
        stream
            The caller reads the body of the answer, and releases the connection.
        """
        sent = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        sent |= dict(headers or {})
        if json is not None:
            body = encode(json)
            sent.setdefault("Content-Type", "application/json")
        wanted = {name: value for name, value in (query or {}).items() if value is not None}
        target = f"{self._prefix}/{path}" + (f"?{urlencode(wanted)}" if wanted else "")
        options: dict[str, Any] = {}
        if read_seconds is not None:
            options["timeout"] = urllib3.Timeout(connect=CONNECT_SECONDS, read=read_seconds)
        # The daemon closes idle connections: a request that meets this moment has not been read, and is sent once more.
        for is_last in (False, True):
            try:
                return self._own_pool().urlopen(
                    method, target, body=body, headers=sent, preload_content=not stream, decode_content=True, **options
                )
            except urllib3.exceptions.HTTPError as error:
                cause = error.reason if isinstance(error, urllib3.exceptions.MaxRetryError) else error
                is_repeatable = method in ("GET", "HEAD") and (body is None or isinstance(body, bytes))
                if is_last or not is_repeatable or cause is None or not _is_closed_by_peer(cause):
                    raise self._unreachable(cause or error) from error
        raise AssertionError("the loop above returns or raises")

    def _unreachable(self, cause: BaseException) -> errors.ConnectionFailed:
        where = self.url or "the daemon"
        return errors.ConnectionFailed(
            f"{where} does not answer: {cause}. Is splatd running, and is the address right?"
        )

    def request(self, method: str, path: str, **options: Any) -> urllib3.BaseHTTPResponse:
        """Like `raw`, but raises the exception of an answer that is an error."""
        answer = self.raw(method, path, **options)
        if answer.status >= 400:
            raise error_of(answer)
        return answer

    def json(self, method: str, path: str, **options: Any) -> Any:
        """Sends one request and decodes the JSON of the answer. None if it has no body."""
        answer = self.request(method, path, **options)
        return decode(answer) if answer.data else None


def plain(value: Any) -> Any:
    """What numpy's numbers and arrays are in JSON."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"{value!r} of the type {type(value).__name__} cannot be sent as JSON")


def encode(value: Any) -> bytes:
    """A value as JSON, also with numbers and arrays of numpy. Numbers that are not finite are a ValueError."""
    return jsonlib.dumps(value, allow_nan=False, default=plain).encode()


def decode(answer: urllib3.BaseHTTPResponse) -> Any:
    """The JSON of an answer.

    Raises
    ------
    IncompatibleVersion
        The answer is not JSON: another program or a proxy answered.
    """
    try:
        return jsonlib.loads(answer.data)
    except ValueError:
        kind = answer.headers.get("Content-Type", "no Content-Type")
        raise errors.IncompatibleVersion(
            f"the answer is not JSON but {kind}: is there a splatd at this address?", answer.status
        ) from None


def error_of(answer: urllib3.BaseHTTPResponse) -> errors.Error:
    """The exception for an answer with a status of 400 or more (RFC 9457)."""
    try:
        problem = jsonlib.loads(answer.data)
        detail, pointer = str(problem["detail"]), str(problem.get("pointer", ""))
    except (ValueError, KeyError, TypeError, AttributeError):
        detail, pointer = f"HTTP {answer.status} {answer.reason or ''}".strip(), ""
    return errors.of_status(answer.status, detail, pointer)


def segment(text: str) -> str:
    """Quotes a text as one segment of a path."""
    return quote(text, safe="")


def events(answer: urllib3.BaseHTTPResponse) -> Iterator[tuple[str, str]]:
    """The server-sent events of a streamed answer: (name, data)."""
    name, data, rest = "", "", b""
    for chunk in answer.stream(4096):
        *lines, rest = (rest + chunk).split(b"\n")
        for line in lines:
            field, _, value = line.decode().rstrip("\r").partition(":")
            if field == "event":
                name = value.strip()
            elif field == "data":
                data += value.strip()
            elif not field and data:
                yield name, data
                name, data = "", ""
