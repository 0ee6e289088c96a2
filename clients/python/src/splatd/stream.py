# SPDX-License-Identifier: Apache-2.0
"""The stream of a session: frames while the view changes, over a WebSocket (protocol/stream.md)."""

from __future__ import annotations

import functools
import itertools
import json
import logging
import queue
import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect, unix_connect

from . import errors
from ._http import Http, encode, segment
from .image import Image

PROTOCOL = "splatd.v1"
CODECS = {1: "jpeg", 2: "png", 3: "webp"}
FLAG_FINAL = 2
HEADER = struct.Struct("<4sBBHIIHHIIII")
FRAMES_MAX = 3  # that wait for the consumer; then acknowledgements wait as well, and the daemon sends no more
MESSAGE_BYTES_MAX = 256 << 20
OPEN_SECONDS = 10.0
ANSWER_SECONDS = 60.0


@dataclass(frozen=True)
class Frame:
    """A frame of a stream.

    Attributes
    ----------
    image : Image
        Its pixels are decoded when they are asked for.
    number : int
        From 1, rising by 1 per frame of this stream.
    seq : int
        The newest `Stream.update` that it shows; 0: none.
    is_final : bool
        It has full size and quality, and no better one of this view follows.
    render_ms, encode_ms, queue_ms : float
        Times in the daemon.
    """

    image: Image
    number: int
    seq: int
    is_final: bool
    render_ms: float
    encode_ms: float
    queue_ms: float


@dataclass(frozen=True)
class _Refused:
    """An update that the daemon refused, among the frames."""

    seq: int
    error: BaseException


def decode_frame(message: bytes) -> Frame:
    """A binary message as a frame.

    Raises
    ------
    IncompatibleVersion
        The message has another layout, or a codec that was not asked for.
    """
    if len(message) < HEADER.size:
        raise errors.IncompatibleVersion(f"a frame has {len(message)} bytes, which is less than its header")
    magic, codec, flags, header, number, seq, _, _, render, encode, size, waited = HEADER.unpack_from(message)
    if magic != b"SPF1" or codec not in CODECS or not HEADER.size <= header <= len(message) - size:
        raise errors.IncompatibleVersion(
            f"a frame begins with {message[:8]!r}, which this package does not know: update it"
        )
    image = Image(message[len(message) - size :], CODECS[codec])
    return Frame(image, number, seq, bool(flags & FLAG_FINAL), render / 1e3, encode / 1e3, waited / 1e3)


class Stream:
    """The frames of a session, as an iterator. Any thread may change the view meanwhile. Make one with
    `Session.stream`.

    The daemon draws as fast as frames are taken: a slow loop gets fewer frames, each of the newest view.

    Parameters
    ----------
    settings
        Of `stream.configure`: format ("jpeg", "webp", "png"), quality, max_fps, size, progressive, lossless, name, …

    Examples
    --------
    >>> with demo.view(size=(64, 48)).share() as session, session.stream() as stream:
    ...     seq = stream.update({"camera": {"azimuth": 30}})
    ...     frame = stream.wait(seq)
    >>> frame.image.shape, frame.is_final
    ((48, 64, 4), True)
    """

    def __init__(self, http: Http, session: str, *, owner: object = None, **settings: Any) -> None:
        self._owner = owner  # a daemon that was started ends when no object refers to it
        self._ids = itertools.count(1)
        self._seq = itertools.count(1)
        self._answers: dict[int, Future[Any]] = {}
        self._frames: queue.SimpleQueue[Frame | _Refused | None] = queue.SimpleQueue()
        self._waiting = 0
        self._is_closing = False
        self._lock = threading.Lock()
        self._reason: errors.Error | None = None
        self._listeners: list[Callable[[str, Mapping[str, Any]], object]] = []
        self._context = self._open(http, session)
        self._socket: ClientConnection = self._context.__enter__()
        self._thread = threading.Thread(target=self._receive, name=f"splatd-stream-{session}", daemon=True)
        self._thread.start()
        try:
            self.settings = self.call("stream.configure", **{"format": "jpeg", **settings})
        except BaseException:
            self.close()
            raise

    @staticmethod
    def _open(http: Http, session: str) -> Any:
        path = f"/api/v1/sessions/{segment(session)}/stream"
        options: dict[str, Any] = {
            "subprotocols": [PROTOCOL],
            "additional_headers": {"Authorization": f"Bearer {http.token}"},
            "max_size": MESSAGE_BYTES_MAX,
            "compression": None,
            "open_timeout": OPEN_SECONDS,
            "close_timeout": 1,
        }
        try:
            if http.socket_path:
                return unix_connect(http.socket_path, f"ws://localhost{path}", **options)
            return connect("ws" + http.url.removeprefix("http") + path, proxy=None, **options)
        except InvalidStatus as error:
            status = error.response.status_code
            try:
                detail = json.loads(error.response.body or b"")["detail"]
            except (ValueError, KeyError, TypeError):
                detail = f"HTTP {status}"
            raise errors.of_status(status, detail) from error
        except (OSError, WebSocketException, TimeoutError) as error:
            raise errors.ConnectionFailed(f"the stream of {http.url} does not open: {error}") from error

    # Receiving, in a thread of its own

    def _receive(self) -> None:
        reason: errors.Error
        try:
            while True:
                message = self._socket.recv()
                if isinstance(message, bytes):
                    self._take(decode_frame(message))
                else:
                    self._understand(json.loads(message))
        except ConnectionClosed as error:
            code, text = (error.rcvd.code, error.rcvd.reason) if error.rcvd else (0, "the connection is lost")
            reason = errors.ConnectionFailed(text or f"the daemon closed the stream with the code {code}", code)
        except errors.Error as error:
            reason = error
        except (OSError, ValueError) as error:
            reason = errors.ConnectionFailed(f"the stream ended: {error}")
        with self._lock:
            self._reason = reason
            waiting = list(self._answers.values())
            self._answers.clear()
        for answer in waiting:
            answer.set_exception(reason)
        self._frames.put(None)
        self._socket.close()

    def _take(self, frame: Frame) -> None:
        with self._lock:
            self._waiting += 1
            is_late = self._waiting > FRAMES_MAX
        self._frames.put(frame)
        if not is_late:
            self._notify("stream.ack", {"frame": frame.number})

    def _understand(self, message: Mapping[str, Any]) -> None:
        with self._lock:
            answer = self._answers.pop(message.get("id", 0), None)
        if answer and "error" in message:
            error = message["error"]
            answer.set_exception(
                errors.of_rpc_code(error["code"], error["message"], (error.get("data") or {}).get("pointer", ""))
            )
        elif answer:
            answer.set_result(message.get("result"))
        elif "method" in message:
            for listener in list(self._listeners):
                try:
                    listener(message["method"], message.get("params", {}))
                except Exception:  # its fault must not end the stream
                    logging.getLogger(__name__).exception("a listener of the stream failed")

    # Sending

    def _send(self, message: Mapping[str, Any]) -> None:
        try:
            self._socket.send(encode({"jsonrpc": "2.0", **message}).decode())
        except (ConnectionClosed, OSError) as error:
            raise self._reason or errors.ConnectionFailed(f"the stream is closed: {error}") from error

    def _notify(self, method: str, params: Mapping[str, Any]) -> None:
        try:
            self._send({"method": method, "params": params})
        except errors.ConnectionFailed:
            pass  # the receiving thread tells it

    def call(self, method: str, **params: Any) -> Any:
        """Calls a method of the stream (protocol/stream.md) and waits for its result."""
        return self._request(method, params).result(ANSWER_SECONDS)

    def _request(self, method: str, params: Mapping[str, Any]) -> Future[Any]:
        answer: Future[Any] = Future()
        id = next(self._ids)
        with self._lock:
            if self._reason:
                raise self._reason
            self._answers[id] = answer
        self._send({"id": id, "method": method, "params": params})
        return answer

    def update(self, patch: Mapping[str, Any], *, wait: bool = False) -> int:
        """Changes the view for all participants.

        Parameters
        ----------
        patch
            A merge patch of the view (view.schema.json).
        wait : bool
            True: wait until the daemon has made the change, and raise its error.

        Returns
        -------
        int
            A number, `seq`, for `wait` and `Frame.seq`.
        """
        seq = next(self._seq)
        answer = self._request("view.update", {"seq": seq, "patch": patch})
        if wait:
            answer.result(ANSWER_SECONDS)
        else:
            answer.add_done_callback(functools.partial(self._refuse, seq))
        return seq

    def _refuse(self, seq: int, answer: Future[Any]) -> None:
        error = answer.exception()
        if error and not self._reason:
            self._frames.put(_Refused(seq, error))

    def pick(self, x: float, y: float) -> dict[str, Any]:
        """What the visible layers show at a pixel: world position, value, opacity."""
        return self.call("pick", at=[x, y])

    def listen(self, listener: Callable[[str, Mapping[str, Any]], object]) -> None:
        """Calls `listener(method, params)` for each notification, in the receiving thread: it must return at once."""
        self._listeners.append(listener)

    # Frames

    def _next(self, timeout: float | None = None) -> Frame | _Refused | None:
        frame = self._frames.get(timeout=timeout)
        if frame is None:
            self._frames.put(None)  # for the next one that asks
            return None
        if isinstance(frame, _Refused):
            return frame
        with self._lock:
            was_late = self._waiting > FRAMES_MAX
            self._waiting -= 1
        if was_late:
            self._notify("stream.ack", {"frame": frame.number})
        return frame

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        frame = self._next()
        while isinstance(frame, _Refused):
            frame = self._next()
        if frame is None:
            if self._reason and self._reason.code != 1000 and not self._is_closing:
                raise self._reason
            raise StopIteration
        return frame

    def wait(self, seq: int = 0, *, is_final: bool = True, timeout: float = ANSWER_SECONDS) -> Frame:
        """Takes frames until one shows the change `seq`; by default one of final quality.

        Raises
        ------
        InvalidRequest
            The daemon refused this change.
        TimeoutError
            No such frame came within `timeout` seconds after the one before it.
        ConnectionFailed
            The stream ended.
        """
        while True:
            try:
                frame = self._next(timeout)
            except queue.Empty:
                raise TimeoutError(f"no frame of the change {seq} within {timeout} s") from None
            if frame is None:
                raise self._reason or errors.ConnectionFailed("the stream is closed")
            if isinstance(frame, _Refused):
                if frame.seq == seq:
                    raise frame.error
                continue
            if frame.seq >= seq and (frame.is_final or not is_final):
                return frame

    def close(self) -> None:
        """Leaves the session."""
        self._is_closing = True
        self._socket.close()
        if threading.current_thread() is not self._thread:
            self._thread.join(OPEN_SECONDS)

    def __enter__(self) -> Stream:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
