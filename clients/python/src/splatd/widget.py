# SPDX-License-Identifier: Apache-2.0
"""The picture in notebooks: JupyterLab and other hosts of anywidget."""

from __future__ import annotations

import hashlib
import threading
import weakref
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

try:
    import anywidget
    import traitlets
except ImportError as error:
    raise ImportError("the widget needs anywidget: pip install 'splatd[jupyter]'") from error

from . import errors
from ._channel import Channel, answer
from .image import Image
from .session import Session
from .view import View

if TYPE_CHECKING:
    from .daemon import Daemon

TRANSPORTS = ("auto", "websocket", "kernel")
REQUEST_THREADS = 2  # of one widget, for requests that pass through the kernel
SCRIPT = Path(__file__).parent / "static" / "widget.js"


def _script() -> str:
    try:
        return SCRIPT.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ImportError(
            f"{SCRIPT} is missing. In a clone of the repository, `cmake --build --preset release --target "
            "splatd_widget` makes it"
        ) from None


def _port(url: str) -> int | None:
    """The port of a daemon that jupyter-server-proxy reaches: on the computer of the kernel, without a path."""
    parts = urlsplit(url)
    is_local = parts.hostname in ("localhost", "127.0.0.1", "::1") and not parts.path.strip("/")
    return parts.port if is_local and parts.scheme == "http" else None


class _Life:
    """The session of a widget and the threads that serve its views. It refers to no widget, so that one that is
    collected ends them."""

    def __init__(self, view: View) -> None:
        self.daemon: Daemon = view.volume.daemon
        self.lock = threading.RLock()
        self.channels: dict[tuple[str, int], Channel] = {}
        self.session: Session | None = None
        self._view = view
        self._pool: ThreadPoolExecutor | None = None

    def begin(self) -> Session:
        """The session; a new one with the last view if it has ended."""
        with self.lock:
            if self.session is None:
                self.session = self.daemon.share(self._view)
            return self.session

    def refresh(self) -> Session:
        """The session if the daemon still has it, else a new one."""
        with self.lock:
            try:
                self.begin().refresh()
            except errors.NotFound:
                self.session = None
            return self.begin()

    def view(self) -> View:
        """The present view, or the last one of a session that has ended."""
        with self.lock:
            if self.session:
                try:
                    self._view = self.session.view
                except errors.Error:
                    pass  # the session or the daemon has ended
            return self._view

    def submit(self, *call: Any) -> None:
        """Calls a function in a thread."""
        with self.lock:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(REQUEST_THREADS, "splatd-widget-requests")
            self._pool.submit(*call)

    def leave(self, view: str) -> None:
        """Ends the streams of one view of the page."""
        with self.lock:
            leaving = [key for key in self.channels if key[0] == view]
            channels = [self.channels.pop(key) for key in leaving]
        for channel in channels:
            channel.close()

    def end(self, keeps_view: bool = True) -> None:
        """Ends session and threads. A second call does nothing."""
        with self.lock:
            if keeps_view:
                self.view()
            session, self.session = self.session, None
            pool, self._pool = self._pool, None
            channels = list(self.channels.values())
            self.channels.clear()
        for channel in channels:
            channel.close()
        if pool:
            pool.shutdown(wait=False)
        if session:
            try:
                session.delete()
            except errors.Error:
                pass  # the daemon has ended it, or has ended itself


class Widget(anywidget.AnyWidget):
    """A view in a notebook that the mouse turns. Make one with `View.show`.

    Its session begins at once and ends when the last of its outputs is closed, and with `close`. Another display of the
    widget begins one with the last view. A notebook that keeps the state of its widgets shows the last picture without
    a kernel.

    Attributes
    ----------
    document : dict
        The view in the browser with every member (view.schema.json), soon after each change: for
        `widget.observe(function, "document")`.
    transport_used : str
        How the browser reaches the daemon, and why: "websocket: …", "kernel: …", or "none: …". Empty until it is known.
    controls : bool
        True if mouse, touch and keys move the camera.
    width, height : str
        CSS lengths. An empty height follows the shape of the view.
    """

    _esm = traitlets.Unicode().tag(sync=True)
    _build = traitlets.Unicode().tag(sync=True)
    _aspect = traitlets.Unicode("1").tag(sync=True)
    _picture = traitlets.CBytes(b"").tag(sync=True, echo_update=False)
    controls = traitlets.Bool(True).tag(sync=True)
    width = traitlets.Unicode("100%").tag(sync=True)
    height = traitlets.Unicode("").tag(sync=True)
    document = traitlets.Dict(read_only=True)
    transport_used = traitlets.Unicode("", read_only=True)

    def __init__(
        self, view: View, *, transport: str = "auto", controls: bool = True, width: str = "", height: str = ""
    ) -> None:
        if transport not in TRANSPORTS:
            raise ValueError(f"transport: {transport!r} is not auto, websocket or kernel")
        script = _script()
        self._transport = transport
        self._life = _Life(view)
        self._shown: set[str] = set()
        document = self._life.begin().document
        image_width, image_height = document["size"]
        super().__init__(
            _esm=script,
            _build=hashlib.sha256(script.encode()).hexdigest()[:12],
            _aspect=f"{image_width} / {image_height}",
            controls=controls,
            width=width or f"{image_width}px",
            height=height,
        )
        self.set_trait("document", document)
        weakref.finalize(self, self._life.end, False)  # also when this process ends
        self.on_msg(_hear)

    # What programs do with it

    @property
    def session(self) -> Session:
        """The session that the browser shows; others join it by its links."""
        return self._life.begin()

    @property
    def view(self) -> View:
        """The view that the browser shows now."""
        return self._life.view()

    def change(self, **patch: Any) -> dict[str, Any]:
        """Changes the view, and returns all of it: `w.change(camera={"azimuth": 30})`."""
        document = self.session.change(**patch)
        self.set_trait("document", document)
        return document

    def snapshot(self, **options: Any) -> Image:
        """An image of the present view in any size: see `Session.snapshot`."""
        return self.session.snapshot(**options)

    def close(self) -> None:
        """Removes the picture from the notebook, and ends its session. A second call does nothing."""
        if hasattr(self, "_life"):  # else the constructor failed
            self._life.end()
        super().close()

    def __repr__(self) -> str:
        session = self._life.session
        return f"<splatd.Widget of session {session.id}>" if session else "<splatd.Widget without a session>"

    # Messages of the page: see kernel.js. Kernels may hand over several at once, in threads of their own.

    def _reply(self, view: str, content: Mapping[str, Any], buffers: list[bytes] | None = None) -> None:
        try:
            self.send({**content, "of": view}, buffers)
        except Exception:  # each host has its own errors for a page that is gone
            pass

    def _take(self, view: str, type: str, content: Mapping[str, Any]) -> None:
        life = self._life
        if type == "hello":
            life.submit(self._welcome, view)
        elif type == "bye":
            self._leave(view)
        elif type == "request":
            life.submit(self._answer, view, content)
        elif type == "open":
            self._open(view, int(content["id"]))
        elif type in ("send", "close"):
            with life.lock:
                key = (view, int(content["id"]))
                channel = life.channels.pop(key, None) if type == "close" else life.channels.get(key)
            if channel and type == "close":
                channel.close()
            elif channel:
                channel.send(content["text"])
        elif type == "view":
            self.set_trait("document", dict(content["view"]))
        elif type == "used":
            self.set_trait("transport_used", str(content["transport"]))

    def _welcome(self, view: str) -> None:
        life = self._life
        try:
            with life.lock:
                session = life.refresh()
                self._shown.add(view)
            url = life.daemon.url
            is_http = url.startswith("http")
            welcome = {
                "session": session.id,
                "token": session.tokens["control"],
                "url": f"{url}/" if is_http else "",
                "port": _port(url) if is_http else None,
                "transport": self._transport,
            }
        except errors.Error as error:
            welcome = {"error": error.detail}
        self._reply(view, {"type": "welcome", **welcome})

    def _answer(self, view: str, request: Mapping[str, Any]) -> None:
        session = self._life.session
        about, body = (
            answer(self._life.daemon.http, session.id, request)
            if session
            else ({"status": 404, "headers": {}}, b'{"detail": "the session of this widget has ended"}')
        )
        self._reply(view, {"type": "answer", "id": request.get("id"), **about}, [body])

    def _open(self, view: str, id: int) -> None:
        life = self._life
        # A channel outlives its widget for a moment only: the finalizer ends it.
        widget = weakref.ref(self)

        def send(content: Mapping[str, Any], buffers: list[bytes] | None) -> None:
            living = widget()
            if living:
                living._reply(view, content, buffers)

        with life.lock:
            for key in [key for key, channel in life.channels.items() if not channel.is_alive]:
                del life.channels[key]
            if life.session:
                life.channels[view, id] = Channel(life.daemon.http, life.session.id, id, send)
                return
        self._reply(view, {"type": "closed", "id": id, "code": 1000, "reason": "the session of this widget has ended"})

    def _leave(self, view: str) -> None:
        life = self._life
        life.leave(view)
        with life.lock:
            self._shown.discard(view)
            is_last = not self._shown
        if is_last:
            life.end()


def _hear(widget: Widget, content: Any, buffers: Any) -> None:
    """Takes a message of the page. Messages of other packages are ignored."""
    if isinstance(content, dict) and isinstance(content.get("of"), str):
        widget._take(content["of"], str(content.get("type")), content)
