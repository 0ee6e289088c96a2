# SPDX-License-Identifier: Apache-2.0
"""The same interface for asyncio: methods that talk to the daemon are coroutines, the others are as they are.

Each request runs in a thread of asyncio's pool; an object may have several requests in progress at once.

>>> import asyncio
>>> from splatd import aio
>>> async def main():
...     async with await aio.connect(daemon.url, token=daemon.token) as d:
...         volume = await d.load("demo:engine")
...         view = volume.view(size=(32, 32))
...         images = await asyncio.gather(view.render(), view.with_camera(azimuth=90).render())
...         return [image.shape for image in images]
>>> asyncio.run(main())
[(32, 32, 4), (32, 32, 4)]
"""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, cast

import splatd

from . import camera_path, daemon, session, stream, view, volume

P = ParamSpec("P")
S = TypeVar("S")
R = TypeVar("R")
W = TypeVar("W", bound="Twin[Any]")
_END = object()


class Twin(Generic[S]):
    """An object and its asynchronous methods. `sync` is the object itself."""

    def __init__(self, sync: S) -> None:
        self.sync = sync

    def __repr__(self) -> str:
        return f"<aio {self.sync!r}>"

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and cast("Twin[S]", other).sync == self.sync

    def __hash__(self) -> int:
        return hash(self.sync)

    def __getattr__(self, name: str) -> Any:
        # Only properties that need no request are passed on: the classes below name the others.
        if name.startswith("_") or name not in self._plain:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return getattr(self.sync, name)

    _plain: frozenset[str] = frozenset()


def _bare(value: Any) -> Any:
    """The object of a twin; other values as they are."""
    return value.sync if isinstance(value, Twin) else value


def _call(method: Callable[..., R]) -> Callable[..., Awaitable[R]]:
    @functools.wraps(method)
    async def call(self: Twin[Any], *arguments: Any, **named: Any) -> R:
        bare = [_bare(argument) for argument in arguments]
        return await asyncio.to_thread(method, self.sync, *bare, **{key: _bare(value) for key, value in named.items()})

    return call


def _twin(method: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[Any, P], Awaitable[R]]:
    """A method whose result is a plain value."""
    return cast("Callable[Concatenate[Any, P], Awaitable[R]]", _call(method))


def _into(
    made: Callable[[], type[W]], method: Callable[Concatenate[S, P], Any]
) -> Callable[Concatenate[Any, P], Awaitable[W]]:
    """A method whose result becomes a twin."""
    call = _call(method)

    @functools.wraps(method)
    async def wrapped(self: Any, *arguments: Any, **named: Any) -> W:
        return made()(await call(self, *arguments, **named))

    return cast("Callable[Concatenate[Any, P], Awaitable[W]]", wrapped)


def _pure(made: Callable[[], type[W]], method: Callable[Concatenate[S, P], Any]) -> Callable[Concatenate[Any, P], W]:
    """A method without a request, whose result becomes a twin."""

    @functools.wraps(method)
    def wrapped(self: Twin[Any], *arguments: Any, **named: Any) -> W:
        bare = [_bare(argument) for argument in arguments]
        result: Any = cast("Any", method)(self.sync, *bare, **{key: _bare(value) for key, value in named.items()})
        return made()(result)

    return cast("Callable[Concatenate[Any, P], W]", wrapped)


async def _each(items: Iterator[R]) -> AsyncIterator[R]:
    """The items of an iterator that waits for the daemon."""
    while True:
        item = await asyncio.to_thread(next, items, _END)
        if item is _END:
            return
        yield cast("R", item)


class View(Twin[view.View]):
    """See `splatd.View`."""

    _plain = frozenset({"document"})
    patch = _pure(lambda: View, view.View.patch)
    with_size = _pure(lambda: View, view.View.with_size)
    with_background = _pure(lambda: View, view.View.with_background)
    with_layers = _pure(lambda: View, view.View.with_layers)
    with_clip = _pure(lambda: View, view.View.with_clip)
    with_shading = _pure(lambda: View, view.View.with_shading)
    with_compositing = _pure(lambda: View, view.View.with_compositing)
    with_filter = _pure(lambda: View, view.View.with_filter)
    with_step = _pure(lambda: View, view.View.with_step)
    with_camera = _pure(lambda: View, view.View.with_camera)
    with_transfer = _pure(lambda: View, view.View.with_transfer)
    angles = _twin(view.View.angles)
    render = _twin(view.View.render)
    full = _twin(view.View.full)
    share = _into(lambda: Session, view.View.share)


class Volume(Twin[volume.Volume]):
    """See `splatd.Volume`."""

    _plain = frozenset(
        {
            "id",
            "name",
            "info",
            "shape",
            "spacing",
            "origin",
            "dtype",
            "range",
            "unit",
            "value_unit",
            "steps",
            "warnings",
        }
    )
    view = _pure(lambda: View, volume.Volume.view)
    wait = _into(lambda: Volume, volume.Volume.wait)
    refresh = _into(lambda: Volume, volume.Volume.refresh)
    close = _twin(volume.Volume.close)
    default_document = _twin(volume.Volume.default_document)
    default_camera = _twin(volume.Volume.default_camera)
    histogram = _twin(volume.Volume.histogram)
    preset_points = _twin(volume.Volume.preset_points)
    slice = _twin(volume.Volume.slice)
    slice_image = _twin(volume.Volume.slice_image)
    measure = _twin(volume.Volume.measure)


class SavedView(Twin[daemon.SavedView]):
    """See `splatd.SavedView`."""

    _plain = frozenset({"id", "url"})
    view = _into(lambda: View, daemon.SavedView.view)
    rename = _twin(daemon.SavedView.rename)
    delete = _twin(daemon.SavedView.delete)

    async def document(self) -> dict[str, Any]:
        """The view with every member."""
        return await asyncio.to_thread(lambda: self.sync.document)


class Stream(Twin[stream.Stream]):
    """See `splatd.Stream`: an asynchronous iterator of frames."""

    _plain = frozenset({"settings"})
    call = _twin(stream.Stream.call)
    update = _twin(stream.Stream.update)
    pick = _twin(stream.Stream.pick)
    wait = _twin(stream.Stream.wait)
    close = _twin(stream.Stream.close)

    def __aiter__(self) -> AsyncIterator[stream.Frame]:
        return _each(iter(self.sync))

    async def __aenter__(self) -> Stream:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()


class Session(Twin[session.Session]):
    """See `splatd.Session`."""

    _plain = frozenset({"id", "link", "tokens"})
    refresh = _into(lambda: Session, session.Session.refresh)
    change = _twin(session.Session.change)
    show = _twin(session.Session.show)
    snapshot = _twin(session.Session.snapshot)
    fork = _into(lambda: Session, session.Session.fork)
    stream = _into(lambda: Stream, session.Session.stream)
    delete = _twin(session.Session.delete)

    async def document(self) -> dict[str, Any]:
        """The view of all participants with every member."""
        return await asyncio.to_thread(lambda: self.sync.document)

    async def view(self) -> View:
        """The view of all participants."""
        return View(await asyncio.to_thread(lambda: self.sync.view))

    async def participants(self) -> list[dict[str, Any]]:
        """Who looks at it now."""
        return await asyncio.to_thread(lambda: self.sync.participants)

    async def __aenter__(self) -> Session:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await asyncio.to_thread(self.sync.__exit__)


class Job(Twin[camera_path.Job]):
    """See `splatd.Job`: an asynchronous iterator of images."""

    _plain = frozenset({"id", "frames"})
    status = _twin(camera_path.Job.status)
    frame = _twin(camera_path.Job.frame)
    save = _twin(camera_path.Job.save)
    cancel = _twin(camera_path.Job.cancel)
    wait = _into(lambda: Job, camera_path.Job.wait)

    def __aiter__(self) -> AsyncIterator[splatd.Image]:
        return _each(iter(self.sync))

    async def progress(self) -> AsyncIterator[tuple[int, int]]:
        """Yields (frames that are done, all frames). Cancelling the task deletes the path, as an interrupt does."""
        try:
            async for state in _each(self.sync.progress()):
                yield state
        except asyncio.CancelledError:
            await self.cancel()
            raise


class Daemon(Twin[daemon.Daemon]):
    """See `splatd.Daemon`."""

    _plain = frozenset({"url", "token", "process"})
    load = _into(lambda: Volume, daemon.Daemon.load)
    add = _into(lambda: Volume, daemon.Daemon.add)
    upload = _into(lambda: Volume, daemon.Daemon.upload)
    volume = _into(lambda: Volume, daemon.Daemon.volume)
    series = _twin(daemon.Daemon.series)
    save = _into(lambda: SavedView, daemon.Daemon.save)
    render_path = _into(lambda: Job, daemon.Daemon.render_path)
    job = _into(lambda: Job, daemon.Daemon.job)
    share = _into(lambda: Session, daemon.Daemon.share)
    session = _into(lambda: Session, daemon.Daemon.session)
    check_version = _twin(daemon.Daemon.check_version)
    close = _twin(daemon.Daemon.close)

    async def status(self) -> dict[str, Any]:
        """Version, backend, device, instruction set, threads."""
        return await asyncio.to_thread(lambda: self.sync.status)

    async def volumes(self) -> list[Volume]:
        """All volumes of the daemon."""
        return [Volume(one) for one in await asyncio.to_thread(self.sync.volumes)]

    def files(self, path: str = "", *, find: str | None = None) -> AsyncIterator[dict[str, Any]]:
        """The folders and files of the data folder that can be loaded."""
        return _each(self.sync.files(path, find=find))

    def sessions(self) -> AsyncIterator[dict[str, Any]]:
        """The sessions that this token created."""
        return _each(self.sync.sessions())

    async def __aenter__(self) -> Daemon:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()


async def start(**options: Any) -> Daemon:
    """Starts a daemon on this computer: see `splatd.start`."""
    return Daemon(await asyncio.to_thread(functools.partial(splatd.start, **options)))


async def connect(url: str | None = None, *, token: str | None = None) -> Daemon:
    """Uses a daemon that runs here or elsewhere: see `splatd.connect`."""
    return Daemon(await asyncio.to_thread(functools.partial(splatd.connect, url, token=token)))
