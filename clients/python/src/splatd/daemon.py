# SPDX-License-Identifier: Apache-2.0
"""A daemon: its volumes, files, uploads, presets, saved views, camera paths and sessions."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, BinaryIO, cast
from urllib.parse import parse_qs, urlsplit, urlunsplit

import numpy as np

from . import arrays, errors, labelled, memory
from ._http import Http, decode, segment
from .camera_path import Job, Path
from .session import Session
from .view import View
from .volume import Volume

if TYPE_CHECKING:
    from .launch import Process

#: The interface that this package speaks: the number in /api/v1/, and the versions of splatd that have it.
INTERFACE = "v1"
OLDEST_VERSION = (0, 1)
LOST_MAX = 3  # connections in turn, before an upload fails
CHUNK_BYTES = 8 << 20  # of an upload: the progress is told this often


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("-")[0].split(".") if part.isdigit())


class Presets(MutableMapping[str, Mapping[str, Any]]):
    """The presets of the daemon: parts of views by name. Changing one needs a token of the role control."""

    def __init__(self, http: Http) -> None:
        self._http = http

    def __getitem__(self, name: str) -> dict[str, Any]:
        try:
            return self._http.json("GET", f"api/v1/presets/{segment(name)}")
        except errors.NotFound as error:
            raise KeyError(f"{name}: {error.detail}") from error

    def __setitem__(self, name: str, part: Mapping[str, Any] | View) -> None:
        document = part.document if isinstance(part, View) else dict(part)
        self._http.request("PUT", f"api/v1/presets/{segment(name)}", json=document)

    def __delitem__(self, name: str) -> None:
        try:
            self._http.request("DELETE", f"api/v1/presets/{segment(name)}")
        except errors.NotFound as error:
            raise KeyError(f"{name}: {error.detail}") from error

    def __iter__(self) -> Iterator[str]:
        return iter(self._http.json("GET", "api/v1/presets")["presets"])

    def __len__(self) -> int:
        return len(self._http.json("GET", "api/v1/presets")["presets"])


class SavedView:
    """A view that the daemon stores and never changes. Its image has an address that HTTP caches can keep."""

    def __init__(self, daemon: Daemon, id: str) -> None:
        self.daemon = daemon
        self.id = id

    def __repr__(self) -> str:
        return f"<splatd.SavedView {self.id}>"

    @property
    def document(self) -> dict[str, Any]:
        """The view with every member."""
        return self.daemon.http.json("GET", f"api/v1/views/{self.id}")

    @property
    def url(self) -> str:
        """The address of its image. A request for it needs a token."""
        return f"{self.daemon.url}/api/v1/render/{self.id}"

    def view(self) -> View:
        """The view, to change it or to render it."""
        document = self.document
        return View(self.daemon.volume(document.pop("volume")), document)

    def rename(self, name: str | None) -> None:
        """Gives it a name for people, or removes the name."""
        self.daemon.http.request("PATCH", f"api/v1/views/{self.id}", json={"name": name})

    def delete(self) -> None:
        """Removes it; links to it break."""
        self.daemon.http.request("DELETE", f"api/v1/views/{self.id}")


class Daemon:
    """A running splatd. Make one with `splatd.start` or `splatd.connect`.

    The methods may be called by several threads at once. Used in a `with` statement, a daemon that was started ends
    with it.
    """

    def __init__(self, url: str, token: str = "", process: Process | None = None) -> None:
        self.http = Http(url, token)
        self.process = process
        self.socket_path = self.http.socket_path or (process.socket_path if process else "")

    @classmethod
    def connect(cls, url: str, token: str = "") -> Daemon:
        """See `splatd.connect`."""
        token_of_url, address = "", url
        if not url.startswith("unix:"):
            parts = urlsplit(url if "://" in url else f"http://{url}")
            if parts.scheme not in ("http", "https") or not parts.hostname:
                raise ValueError(f"'{url}' is not the address of a daemon, such as http://127.0.0.1:8080")
            token_of_url = parse_qs(parts.query).get("token", [""])[0]
            address = urlunsplit((parts.scheme, parts.netloc, parts.path, "", ""))
        daemon = cls(address, token or token_of_url)
        daemon.check_version()
        return daemon

    def check_version(self) -> str:
        """Asks the daemon for its version.

        Raises
        ------
        ConnectionFailed
            It does not answer.
        IncompatibleVersion
            It is older than this package needs, or not splatd.
        """
        answer = self.http.raw("GET", "readyz")
        about = decode(answer)
        version = about.get("version", "") if isinstance(about, dict) else ""
        if not version:
            raise errors.IncompatibleVersion(f"{self.url} is not a splatd: it does not state a version", answer.status)
        if _numbers(version) < OLDEST_VERSION:
            needed = ".".join(map(str, OLDEST_VERSION))
            raise errors.IncompatibleVersion(
                f"splatd {version} is too old: this package needs {needed} or later. Update the daemon"
            )
        return version

    @property
    def url(self) -> str:
        """The address of the daemon, without a slash at the end."""
        return self.http.url

    @property
    def token(self) -> str:
        """The token that this object sends."""
        return self.http.token

    @property
    def status(self) -> dict[str, Any]:
        """Version, backend, device, instruction set, threads (GET /readyz)."""
        return decode(self.http.raw("GET", "readyz"))

    @property
    def version(self) -> str:
        """The version of splatd."""
        return self.check_version()

    def __repr__(self) -> str:
        return f"<splatd.Daemon {self.url}>"

    def __enter__(self) -> Daemon:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections. A daemon that `splatd.start` started ends; its volumes and sessions end with it."""
        self.http.close()
        if self.process:
            self.process.end()

    # Volumes

    def load(
        self,
        source: str | os.PathLike[str],
        *,
        id: str | None = None,
        name: str | None = None,
        wait: bool = True,
        progress: Callable[[float], object] | None = None,
    ) -> Volume:
        """Loads a volume that the daemon can reach, or finds it if the daemon has it.

        Parameters
        ----------
        source
            A path below `--data` of the daemon, `demo:NAME`, or the address of an OME-Zarr. `PATH?field=NAME` loads
            one field of a file. A file of this computer is sent with `upload`.
        id, name : str
            The id in addresses and the name for people. Default: from the file name.
        wait : bool
            False: return at once; `Volume.wait` waits later.
        progress
            Called with a number in [0, 1] while it loads.

        Examples
        --------
        >>> daemon.load("demo:engine").shape
        (90, 90, 160)
        """
        request: dict[str, Any] = {"source": os.fspath(source)}
        return self._opened({**request, **_named(id, name)}, wait, progress)

    def _opened(self, request: dict[str, Any], wait: bool, progress: Callable[[float], object] | None) -> Volume:
        volume = Volume(self, self.http.json("POST", "api/v1/volumes", json=request))
        return volume.wait(progress=progress) if wait else volume

    def add(
        self,
        array: Any,
        *,
        spacing: Any = None,
        origin: Any = None,
        direction: Any = None,
        coordinates: Mapping[str, Any] | None = None,
        unit: str | None = None,
        value_unit: str | None = None,
        axes: str | None = None,
        times: Any = None,
        time_unit: str | None = None,
        name: str | None = None,
        id: str | None = None,
        progress: Callable[[float], object] | None = None,
    ) -> Volume:
        """Gives an array to the daemon as a volume. The daemon has its own copy: later changes of the array do not
        show.

        Parameters
        ----------
        array
            Numbers of any type but complex, with three axes, or four for vectors: numpy, PyTorch, CuPy, JAX, dask or
            xarray. Masked samples and NaN are holes.
        spacing : float or three floats
            World units between samples, in the order of `axes`. Default: 1.
        origin : float or three floats
            World position of the first sample, in the order of `axes`. Default: 0.
        direction
            3 x 3: its columns are the directions of the axes x, y, z of the array in the world.
        coordinates
            {"z": positions, …}: the position of each sample along an axis, in world units, even or not. Replaces
            spacing and origin of that axis.
        unit : str
            Of the world, such as "mm".
        value_unit : str
            Of the samples, such as "HU".
        axes : str
            The order of the axes of the array: any order of x, y and z, with c for the components of vectors or t for
            the time: "xyz", "zyxc", "tzyx". Default: "zyx" as numpy has images.
        times, time_unit
            Of a time series: the rising times of its steps, and their unit.
        name : str
            For people.

        Raises
        ------
        ValueError, TypeError
            The array cannot be a volume; the text says why.

        Examples
        --------
        >>> import numpy as np
        >>> daemon.add(np.random.rand(32, 64, 64).astype("f4"), spacing=(2, 1, 1), unit="mm").spacing
        (2, 1, 1)
        """
        place: dict[str, Any] = {}
        if labelled.is_labelled(array):
            array, place = labelled.arguments_of(array)
        given = dict(axes=axes, spacing=spacing, origin=origin, direction=direction, coordinates=coordinates)
        given |= dict(unit=unit, value_unit=value_unit, name=name, times=times, time_unit=time_unit)
        place |= {key: value for key, value in given.items() if value is not None}
        label: str = place.pop("name", "array")
        grid = arrays.grid_of(array, **place)
        if self._takes_memory(grid):
            return self._add_memory(grid, label, id)
        return self._add_upload(grid, label, id, progress)

    def _takes_memory(self, grid: arrays.Grid) -> bool:
        is_plain = grid.samples.ndim == 3 and not any(grid.coordinates)
        return bool(self.socket_path) and is_plain and grid.samples.dtype.newbyteorder("=").name in memory.TYPES

    def _add_memory(self, grid: arrays.Grid, label: str, id: str | None) -> Volume:
        request = grid.place() | {"memory": memory.give(self.socket_path, self.token, grid.samples)}
        return self._opened({**request, **_named(id or _id_of(label), label)}, True, None)

    def _add_upload(
        self, grid: arrays.Grid, label: str, id: str | None, progress: Callable[[float], object] | None
    ) -> Volume:
        samples = memoryview(cast(Any, grid.samples.view(np.uint8).reshape(-1)))
        if grid.is_series:
            parts = [("array.nrrd", [memoryview(grid.nrrd_header()), samples])]
        else:
            header = json.dumps(grid.sidecar("array.raw"), allow_nan=False).encode()
            parts = [("array.json", [memoryview(header)]), ("array.raw", [samples])]
        first = ""
        try:
            for file, pieces in parts:
                upload = self._begin_upload(file, sum(piece.nbytes for piece in pieces), first)
                first = first or upload
                self._send(upload, _Joined(pieces), progress if pieces[-1] is samples else None)
            return self._opened({"upload": first, **_named(id or _id_of(label), label)}, True, None)
        except BaseException:
            self._discard(first)
            raise

    def upload(
        self,
        *paths: str | os.PathLike[str],
        id: str | None = None,
        name: str | None = None,
        progress: Callable[[float], object] | None = None,
    ) -> Volume:
        """Sends a file of this computer and loads it.

        Parameters
        ----------
        paths
            One file; or a header and the files with its samples; or the files of one DICOM series, or of a stack of
            images.
        progress
            Called with the part of the bytes that was sent, in [0, 1].

        Raises
        ------
        OverLimit
            The daemon has no space for the file (`--upload-bytes`).
        """
        if not paths:
            raise ValueError("upload: name at least one file")
        files = [FilePath(path) for path in paths]
        sizes = [file.stat().st_size for file in files]
        sent = 0
        head = ""
        try:
            for file, size in zip(files, sizes):
                upload = self._begin_upload(file.name, size, head)
                head = head or upload
                begun = sent

                def told(part: float, size: int = size, begun: int = begun) -> None:
                    if progress:
                        progress((begun + part * size) / max(1, sum(sizes)))

                with file.open("rb") as stream:
                    self._send(upload, _FilePart(stream, size), told)
                sent += size
            return self._opened({"upload": head, **_named(id, name)}, True, None)
        except BaseException:
            self._discard(head)
            raise

    def _begin_upload(self, name: str, size: int, header: str = "") -> str:
        request = {"name": name, "bytes": size} | ({"header": header} if header else {})
        return self.http.json("POST", "api/v1/uploads", json=request)["id"]

    def _send(self, upload: str, data: _Joined | _FilePart, progress: Callable[[float], object] | None = None) -> None:
        """Sends the bytes of an upload, and goes on where a lost connection ended."""
        offset = lost = 0
        while offset < data.size:
            chunk = data.read(offset, CHUNK_BYTES)
            headers = {"Content-Type": "application/offset+octet-stream", "Upload-Offset": str(offset)}
            try:
                self.http.request("PATCH", f"api/v1/uploads/{upload}", body=chunk, headers=headers)
                offset += len(chunk)
                lost = 0
            except errors.ConnectionFailed:
                lost += 1
                if lost > LOST_MAX:
                    raise
                offset = self.http.json("GET", f"api/v1/uploads/{upload}")["offset"]
            if progress:
                progress(offset / data.size)

    def _discard(self, upload: str) -> None:
        if upload:
            try:
                self.http.raw("DELETE", f"api/v1/uploads/{upload}")
            except errors.ConnectionFailed:
                pass  # uploads without a byte end by themselves

    def volumes(self) -> list[Volume]:
        """All volumes of the daemon, in the order in which they were added."""
        return [Volume(self, info) for info in self.http.json("GET", "api/v1/volumes")["volumes"]]

    def volume(self, id: str) -> Volume:
        """The volume with this id."""
        return Volume(self, self.http.json("GET", f"api/v1/volumes/{segment(id)}"))

    def files(self, path: str = "", *, find: str | None = None) -> Iterator[dict[str, Any]]:
        """The folders and files of the data folder that can be loaded (schema FileEntry).

        Parameters
        ----------
        path : str
            A folder below the data folder.
        find : str
            Words that names contain, in this folder and those below.
        """
        key, query = "entries", {"path": path or None, "find": find}
        for page in self._pages("api/v1/files", query):
            yield from page[key]

    def series(self, path: str = "") -> list[dict[str, Any]]:
        """The DICOM series of a folder below the data folder."""
        return self.http.json("GET", "api/v1/files/series", query={"path": path or None})["series"]

    def _pages(self, path: str, query: Mapping[str, Any] | None = None) -> Iterator[dict[str, Any]]:
        after = None
        while True:
            page = self.http.json("GET", path, query={**(query or {}), "after": after})
            yield page
            after = page.get("next")
            if after is None:
                return

    # Views, paths and sessions

    @property
    def presets(self) -> Presets:
        """The stored presets, like a dict: names to parts of views."""
        return Presets(self.http)

    def save(self, view: View, *, name: str | None = None) -> SavedView:
        """Stores a view under a short id. Equal views have one id."""
        saved = SavedView(self, self.http.json("POST", "api/v1/views", json=view.document)["id"])
        if name is not None:
            saved.rename(name)
        return saved

    def saved_views(self) -> Iterator[SavedView]:
        """The views that this token stored; of an admin all."""
        for page in self._pages("api/v1/views"):
            yield from (SavedView(self, entry["id"]) for entry in page["views"])

    def render_path(
        self,
        path: Path,
        *,
        format: str = "png",
        size: tuple[int, int] | None = None,
        quality: int | None = None,
    ) -> Job:
        """Renders a camera path in the daemon.

        Parameters
        ----------
        format : str
            "webm" gives a movie; png, jpeg, webp and exr give one image per frame.
        size : (int, int)
            Width and height in px. Default: the size of the first view.
        quality : int
            1 to 100, of JPEG, WebP and WebM.
        """
        request = {**path.document, "format": format}
        if size is not None:
            request["size"] = list(size)
        if quality is not None:
            request["quality"] = quality
        return Job(self, self.http.json("POST", "api/v1/paths", json=request))

    def jobs(self) -> Iterator[Job]:
        """The camera paths of this token; of an admin all."""
        for page in self._pages("api/v1/paths"):
            yield from (Job(self, state) for state in page["paths"])

    def job(self, id: str) -> Job:
        """The camera path with this id."""
        return Job(self, self.http.json("GET", f"api/v1/paths/{segment(id)}"))

    def share(self, view: View | SavedView) -> Session:
        """A session: one view that several people look at."""
        request = {"from": view.id} if isinstance(view, SavedView) else {"view": view.document}
        return Session(self, self.http.json("POST", "api/v1/sessions", json=request))

    def sessions(self) -> Iterator[dict[str, Any]]:
        """The sessions that this token created; of an admin all (schema SessionSummary)."""
        for page in self._pages("api/v1/sessions"):
            yield from page["sessions"]

    def session(self, id: str) -> Session:
        """The session with this id."""
        return Session(self, self.http.json("GET", f"api/v1/sessions/{segment(id)}"))


class _Joined:
    """The bytes of several pieces of memory, one after the other."""

    def __init__(self, pieces: Sequence[memoryview]) -> None:
        self._pieces = pieces
        self.size = sum(piece.nbytes for piece in pieces)

    def read(self, offset: int, count: int) -> bytes:
        for piece in self._pieces:
            if offset < piece.nbytes:
                return bytes(piece[offset : offset + count])
            offset -= piece.nbytes
        return b""


class _FilePart:
    """The first `size` bytes of a file."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream = stream
        self.size = size

    def read(self, offset: int, count: int) -> bytes:
        self._stream.seek(offset)
        data = self._stream.read(min(count, self.size - offset))
        if not data:
            raise OSError(f"{self._stream.name} has become shorter while it was sent")
        return data


def _named(id: str | None, name: str | None) -> dict[str, str]:
    return {key: value for key, value in (("id", id), ("name", name)) if value is not None}


def _id_of(name: str) -> str | None:
    """An id from a name; None lets the daemon choose. Volumes of one name get ids of their own."""
    letters = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "-" for c in name).strip("-.")[:100]
    return f"{letters}-{os.urandom(3).hex()}" if letters else None


__all__: Sequence[str] = ["Daemon", "Presets", "SavedView"]
