# SPDX-License-Identifier: Apache-2.0
"""Camera paths: keyframes, and the frames that the daemon renders between them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from . import errors
from ._http import TRANSPORT_ERRORS, error_of, events, segment
from .image import Image
from .view import View

if TYPE_CHECKING:
    from .daemon import Daemon

COPY_BYTES = 1 << 20
TURN_MAX = 90.0  # degrees between two keyframes: the daemon turns the shorter way
SILENCE_SECONDS = 30.0  # without an event, the state is asked for


def _difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """The merge patch that makes `new` of `old`. Members that `new` lacks return to their defaults."""
    patch: dict[str, Any] = {}
    for key in [*new, *(key for key in old if key not in new)]:
        a, b = old.get(key), new.get(key)
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            if inner := _difference(a, b):
                patch[key] = inner
        elif a != b or (key in old) != (key in new):
            patch[key] = b
    return patch


class Path:
    """Keyframes of a camera path. `key` returns a path with one more keyframe.

    Parameters
    ----------
    fps : float
        Frames per second, 1 to 240.

    Examples
    --------
    >>> v = demo.view(size=(64, 48))
    >>> path = splatd.Path(fps=10).key(0, v).key(1, v.with_camera(azimuth=360))
    >>> path.frames
    11
    """

    def __init__(self, fps: float = 30, keys: tuple[tuple[float, View, str], ...] = ()) -> None:
        self.fps = fps
        self._keys = keys

    def key(self, time: float, view: View, *, ease: str = "linear") -> Path:
        """The path with a keyframe.

        Parameters
        ----------
        time : float
            Seconds from the start. The first keyframe is at 0; times rise.
        view : View
            Of the same volume as the others. Azimuths may differ by any number of turns.
        ease : str
            How to come here from the keyframe before: "linear"; "smooth", from rest to rest; "step", a jump.
        """
        if not self._keys and time != 0:
            raise ValueError(f"the first keyframe is at 0 s, not at {time} s")
        if self._keys and not time > self._keys[-1][0]:
            raise ValueError(f"the times of keyframes rise: {time} s is not after {self._keys[-1][0]} s")
        if self._keys and view.volume.id != self._keys[0][1].volume.id:
            raise ValueError("all keyframes of a path show one volume")
        return Path(self.fps, (*self._keys, (float(time), view, ease)))

    @property
    def frames(self) -> int:
        """The number of frames, with the first and the last one."""
        return math.floor(self._keys[-1][0] * self.fps + 0.5) + 1 if self._keys else 0

    @property
    def document(self) -> dict[str, Any]:
        """The path as `POST /paths` takes it."""
        if len(self._keys) < 2:
            raise ValueError("a path has at least two keyframes")
        start = self._keys[0][1]
        keyframes = [key for a, b in zip(self._keys, self._keys[1:]) for key in self._between(a, b)]
        return {"view": start.document, "fps": self.fps, "frames": self.frames, "keyframes": keyframes}

    @staticmethod
    def _between(a: tuple[float, View, str], b: tuple[float, View, str]) -> Iterator[dict[str, Any]]:
        """The keyframes that lead from one key to the next: several if the camera turns far."""
        (begin, first, _), (end, last, ease) = a, b
        turn = _turn(first, last) if ease != "step" else 0.0
        parts = max(1, math.ceil(abs(turn) / TURN_MAX))
        before = first
        for part in range(1, parts + 1):
            u = part / parts
            # With smooth, the parts are keyframes at equal steps of the angle, at the times at which the eased motion
            # reaches them.
            moved = _time_of(u) if ease == "smooth" and parts > 1 else u
            view = last if part == parts else _blended(first, last, u)
            change = _difference(before.document, view.document)
            change.pop("volume", None)
            if "size" in change:
                raise ValueError("all keyframes of a path have one size")
            eased = "linear" if parts > 1 and ease == "smooth" else ease
            yield {"time": begin + (end - begin) * moved, "ease": eased, "view": change}
            before = view


def _time_of(u: float) -> float:
    """The time at which 3t^2 - 2t^3 is u (0 to 1)."""
    return 0.5 - math.sin(math.asin(1 - 2 * u) / 3)


def _turn(first: View, last: View) -> float:
    """Degrees by which the azimuth grows between the views. 0 if the last view sets no azimuth."""
    azimuth = (last._patch.get("camera") or {}).get("azimuth")
    return 0.0 if azimuth is None else azimuth - first.angles()["azimuth"]


def _blended(first: View, last: View, u: float) -> View:
    """The first view with a camera a part of the way to the last one."""
    a, b = first.angles(), last.angles()
    azimuth, elevation, roll = (a[name] * (1 - u) + b[name] * u for name in ("azimuth", "elevation", "roll"))
    distance = math.exp(math.log(a["distance"]) * (1 - u) + math.log(b["distance"]) * u)
    return first.with_camera(azimuth=azimuth, elevation=elevation, roll=roll, distance=distance)


class Job:
    """A camera path that the daemon renders, also while this program does not wait for it. See `Daemon.render_path`.

    In a `with` statement, an error or an interrupt (Ctrl-C) anywhere in it deletes the path.
    """

    def __init__(self, daemon: Daemon, state: Mapping[str, Any]) -> None:
        self.daemon = daemon
        self._state = dict(state)

    @property
    def id(self) -> str:
        """The id in the daemon."""
        return self._state["id"]

    @property
    def frames(self) -> int:
        """The number of frames."""
        return self._state["frames"]

    @property
    def _path(self) -> str:
        return f"api/v1/paths/{segment(self.id)}"

    def status(self) -> dict[str, Any]:
        """Asks for the state: `state` (waiting, running, done, failed), `done` frames, `reason`, … (schema Path)."""
        self._state = self.daemon.http.json("GET", self._path)
        return dict(self._state)

    def __repr__(self) -> str:
        return f"<splatd.Job {self.id}, {self._state['state']}, {self._state['done']} of {self.frames} frames>"

    def __enter__(self) -> Job:
        return self

    def __exit__(self, kind: object, *exception: object) -> None:
        if kind is not None:
            self.cancel()

    def __len__(self) -> int:
        return self.frames

    def progress(self) -> Iterator[tuple[int, int]]:
        """Waits until all frames are rendered, and yields (frames that are done, all frames) whenever the first has
        changed.

        An interrupt (Ctrl-C) while it waits deletes the path in the daemon, so that nothing is left running.

        Raises
        ------
        PathFailed
            The text is the reason of the daemon.
        """
        last = -1
        try:
            while True:
                for state in self._watched():
                    self._state = state
                    if state["done"] != last:
                        last = state["done"]
                        yield last, self.frames
                    if state["state"] == "failed":
                        raise errors.PathFailed(state.get("reason") or "the path failed")
                    if state["state"] == "done":
                        return
        except KeyboardInterrupt:
            self.cancel()
            raise

    def _watched(self) -> Iterator[dict[str, Any]]:
        """The states as the daemon tells them; ends if the connection ends, or after a long silence."""
        yield self.status()
        if self._state["state"] in ("done", "failed"):
            return
        answer = self.daemon.http.raw("GET", f"{self._path}/events", stream=True, read_seconds=SILENCE_SECONDS)
        try:
            if answer.status >= 400:
                raise error_of(answer)
            for name, data in events(answer):
                if name == "removed":
                    raise errors.PathFailed("the path was deleted")
                yield json.loads(data)
        except TRANSPORT_ERRORS:
            pass  # the next status() tells whether the daemon still runs
        finally:
            answer.close()

    def wait(self) -> Job:
        """Waits until all frames are rendered. An interrupt deletes the path."""
        for _ in self.progress():
            pass
        return self

    def frame(self, number: int) -> Image:
        """One frame, from 0, as soon as it is rendered.

        Raises
        ------
        NotReady
            It is not rendered yet.
        """
        answer = self.daemon.http.request("GET", f"{self._path}/frames/{number}")
        return Image.of_answer(answer.data, answer.headers)

    def __iter__(self) -> Iterator[Image]:
        """The frames in their order, each as soon as it is rendered."""
        sent = 0
        for done, _ in self.progress():
            for number in range(sent, done):
                yield self.frame(number)
            sent = max(sent, done)

    def save(self, path: str | os.PathLike[str]) -> FilePath:
        """Waits, and writes the movie (`.webm`), all frames as one archive (`.tar`), or the frames into a folder.

        Returns
        -------
        pathlib.Path
            The file or the folder. An existing file is replaced once the new one is complete.
        """
        path = FilePath(path)
        is_movie = self._state["format"] == "webm"
        if is_movie != (path.suffix == ".webm"):
            raise ValueError("a movie is saved as .webm" if is_movie else "images are saved into a folder or as .tar")
        if not is_movie and path.suffix != ".tar":
            path.mkdir(parents=True, exist_ok=True)
            for number, image in enumerate(self):
                image.save(path / f"{number:06}.{'jpg' if image.format == 'jpeg' else image.format}")
            return path
        self.wait()
        answer = self.daemon.http.raw("GET", f"{self._path}/{'movie' if is_movie else 'archive'}", stream=True)
        part = path.with_name(path.name + ".part")
        try:
            if answer.status >= 400:
                answer.read()
                raise error_of(answer)
            with part.open("wb") as out:
                for chunk in answer.stream(COPY_BYTES):
                    out.write(chunk)
            part.replace(path)
        finally:
            answer.close()
            part.unlink(missing_ok=True)
        return path

    def cancel(self) -> None:
        """Stops rendering and deletes the frames in the daemon."""
        try:
            self.daemon.http.request("DELETE", self._path)
        except errors.NotFound:
            pass
