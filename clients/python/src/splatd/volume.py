# SPDX-License-Identifier: Apache-2.0
"""Volumes that the daemon has loaded, and what can be read from them."""

from __future__ import annotations

import copy
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import errors, presets
from ._http import decode, segment
from .image import Image
from .types import Point
from .view import View

if TYPE_CHECKING:
    from .daemon import Daemon
    from .widget import Widget

POLL_SECONDS = (0.005, 0.25)  # between two questions for the progress: the first, the longest
HISTOGRAM_BINS = 256


@dataclass(frozen=True)
class Histogram:
    """How often values occur.

    Attributes
    ----------
    counts : numpy.ndarray
        uint64; (bins,), or with gradients (gradient bins, value bins).
    edges : numpy.ndarray
        Where the bins of the values begin and end: (bins + 1,), in the unit of the data.
    gradient_edges : numpy.ndarray or None
        The same for the gradient magnitudes, in data units per world unit.
    """

    counts: np.ndarray
    edges: np.ndarray
    gradient_edges: np.ndarray | None = None


@dataclass(frozen=True)
class Slice:
    """A plane of samples.

    Attributes
    ----------
    array : numpy.ndarray
        The values, (rows, columns); NaN outside of the volume.
    origin : tuple
        World position (x, y, z) of the first value.
    step_x, step_y : tuple
        From a value to the next one in its row, and to the same place in the next row; world units, x, y, z.
    window : tuple
        Lowest and highest value of the window in which the daemon shows it in grey.
    """

    array: np.ndarray
    origin: tuple[float, float, float]
    step_x: tuple[float, float, float]
    step_y: tuple[float, float, float]
    window: tuple[float, float]


def bounded_delay(attempt: int) -> float:
    """Seconds before the next question, longer from one to the next."""
    first, longest = POLL_SECONDS
    return min(longest, first * 1.5**attempt)


class Volume:
    """A volume of the daemon. Make one with `Daemon.load` or `Daemon.add`.

    `shape`, `spacing` and `origin` are in numpy's order: z, y, x.
    """

    def __init__(self, daemon: Daemon, info: Mapping[str, Any]) -> None:
        self.daemon = daemon
        self._info = dict(info)
        self._default_camera: dict[str, Any] | None = None

    @property
    def id(self) -> str:
        """The id in the daemon."""
        return self._info["id"]

    @property
    def name(self) -> str:
        """The name for people."""
        return self._info["name"]

    @property
    def info(self) -> dict[str, Any]:
        """The whole description of the daemon (schema Volume of openapi.yaml), with axes in its order x, y, z."""
        return dict(self._info)

    @property
    def shape(self) -> tuple[int, ...]:
        """Samples along z, y, x."""
        return tuple(self._loaded("dims")[::-1])

    @property
    def spacing(self) -> tuple[float, ...]:
        """World units between two samples along z, y, x."""
        return tuple(self._loaded("spacing")[::-1])

    @property
    def origin(self) -> tuple[float, ...]:
        """World position z, y, x of the first sample."""
        return tuple(self._loaded("origin")[::-1])

    @property
    def dtype(self) -> np.dtype:
        """The type of the samples in the memory of the daemon."""
        return np.dtype(self._loaded("type"))

    @property
    def range(self) -> tuple[float, float]:
        """The smallest and the largest finite value."""
        low, high = self._loaded("range")
        return low, high

    @property
    def unit(self) -> str:
        """The unit of world coordinates, such as mm. Empty: unknown."""
        return self._info.get("unit", "")

    @property
    def value_unit(self) -> str:
        """The unit of the values, such as HU. Empty: unknown."""
        return (self._info.get("fields") or [{}])[0].get("unit", "")

    @property
    def steps(self) -> int:
        """The number of time steps; 1 without a time series."""
        return self._info.get("steps", {}).get("count", 1)

    @property
    def warnings(self) -> list[str]:
        """What differs from the file, because the daemon left it out or changed it."""
        return list(self._info.get("warnings", []))

    def _loaded(self, member: str) -> Any:
        if member not in self._info:
            self.refresh()
        if member not in self._info:
            raise errors.NotReady(f"volume '{self.id}' is not loaded yet: call wait()", 409)
        return self._info[member]

    def __repr__(self) -> str:
        if "dims" not in self._info:
            return f"<splatd.Volume {self.id!r}, {self._info['state']}>"
        return f"<splatd.Volume {self.id!r}, {self.shape} {self.dtype}>"

    @property
    def _path(self) -> str:
        return f"api/v1/volumes/{segment(self.id)}"

    def refresh(self) -> Volume:
        """Reads the description again, and returns the volume itself."""
        self._info = self.daemon.http.json("GET", self._path)
        return self

    def wait(self, *, progress: Callable[[float], object] | None = None, timeout: float | None = None) -> Volume:
        """Waits until the volume is loaded.

        Parameters
        ----------
        progress
            Called with a number in [0, 1] whenever it has changed.
        timeout : float
            Seconds. Default: no limit.

        Raises
        ------
        LoadFailed
            The text names the file, the place and the remedy.
        TimeoutError
            Loading goes on in the daemon.
        """
        begun = time.monotonic()
        attempt, last = 0, -1.0
        while True:
            self.refresh()
            state, done = self._info["state"], float(self._info["progress"])
            if progress and done != last:
                progress(done)
            if state == "ready":
                return self
            if state == "failed":
                raise errors.LoadFailed(self._info.get("reason") or "loading failed")
            if timeout is not None and time.monotonic() - begun > timeout:
                raise TimeoutError(f"volume '{self.id}' is loaded to {done:.0%} after {timeout} s")
            attempt, last = (0 if done != last else attempt + 1), done
            time.sleep(bounded_delay(attempt))

    def close(self) -> None:
        """Unloads the volume. Sessions that show it change to another one, or end."""
        self.daemon.http.request("DELETE", self._path)

    def view(self, *, size: tuple[int, int] | None = None) -> View:
        """The default view: camera, transfer function and light chosen from the data.

        Parameters
        ----------
        size : (int, int)
            Width and height of its images in px. Default: 512 x 512.
        """
        view = View(self)
        return view if size is None else view.with_size(*size)

    def show(self, **options: Any) -> Widget:
        """A widget with the default view for a notebook: see `View.show`."""
        return self.view().show(**options)

    def default_document(self) -> dict[str, Any]:
        """The default view with every member (view.schema.json)."""
        return self.daemon.http.json("GET", f"{self._path}/view")

    def default_camera(self) -> dict[str, Any]:
        """The default camera: position, target, up, fov_y, … It is asked for once."""
        camera = self._default_camera or self.default_document()["camera"]
        self._default_camera = camera
        return copy.deepcopy(camera)

    def histogram(self, bins: int = HISTOGRAM_BINS, *, gradient: bool = False, step: int | None = None) -> Histogram:
        """How often values occur, of all finite samples.

        Parameters
        ----------
        bins : int
            A divisor of 256.
        gradient : bool
            Count values and gradient magnitudes together, in 128 x 64 bins, from at most 262144 samples.
        step : int
            The time step. Default: that with which the volume was opened.
        """
        if not gradient and (bins < 1 or HISTOGRAM_BINS % bins):
            raise ValueError(f"bins: {bins} is not a divisor of {HISTOGRAM_BINS}")
        answer = self.daemon.http.json(
            "GET", f"{self._path}/histogram", query={"axis": "value,gradient" if gradient else "value", "step": step}
        )
        counts = np.array(answer["counts"], dtype=np.uint64)
        edges = [np.linspace(axis["range"][0], axis["range"][1], axis["bins"] + 1) for axis in answer["axes"]]
        if gradient:
            return Histogram(counts.reshape(len(edges[1]) - 1, -1), edges[0], edges[1])
        return Histogram(counts.reshape(bins, -1).sum(axis=1), edges[0][:: HISTOGRAM_BINS // bins])

    def preset_points(self, kind: str) -> list[Point]:
        """The points of the transfer function for a kind of data: see `View.with_transfer`."""
        answer = self.daemon.http.json("GET", f"{self._path}/histogram")
        low, high = answer["axes"][0]["range"]
        meaning = self._info.get("meaning", "")
        return presets.preset_points(kind, low, high, np.array(answer["counts"]), self.value_unit, meaning)

    def slice(
        self,
        axis: str | None = None,
        *,
        index: int | None = None,
        position: float | None = None,
        origin: Sequence[float] | None = None,
        normal: Sequence[float] | None = None,
        up: Sequence[float] | None = None,
        size: tuple[int, int] | None = None,
        spacing: float | None = None,
        step: int | None = None,
        level: int | None = None,
    ) -> Slice:
        """A plane of values.

        Parameters
        ----------
        axis : str
            Across this axis of the grid, "z", "y" or "x": all samples with `index`, or those next to the `position`
            along the axis, in world units from the first sample. Default: the middle.
        origin, normal
            Instead: the plane through `origin` (x, y, z in the world; default: the middle of the volume) across
            `normal`, with values between the samples. `size` (width, height) in samples, default 512 x 512; `spacing`
            in world units, default the smallest spacing of the volume; `up` points up in the image.
        step : int
            The time step.
        level : int
            Of a volume that is larger than memory: the level, 0 = all voxels.
        """
        query = (
            self._oblique(origin, normal, up, size, spacing)
            if axis is None
            else self._orthogonal(axis, index, position, level)
        )
        answer = self.daemon.http.request("GET", f"{self._path}/slice", query={**query, "step": step, "format": "raw"})
        about = json.loads(answer.headers["X-Slice"])
        width, height = about["shape"]
        values = np.frombuffer(answer.data, np.dtype(about["type"]).newbyteorder("<")).reshape(height, width)
        low, high = about["window"][0] - about["window"][1] / 2, about["window"][0] + about["window"][1] / 2
        return Slice(values, tuple(about["origin"]), tuple(about["step_x"]), tuple(about["step_y"]), (low, high))

    def slice_image(
        self, axis: str, index: int, *, window: tuple[float, float] | None = None, format: str = "png"
    ) -> Image:
        """A plane of samples as an image in grey; `window`: its centre and width."""
        query = self._orthogonal(axis, index, None, None)
        query["window"] = None if window is None else f"{window[0]:.12g},{window[1]:.12g}"
        answer = self.daemon.http.request("GET", f"{self._path}/slice", query={**query, "format": format})
        return Image.of_answer(answer.data, answer.headers)

    def _orthogonal(self, axis: str, index: int | None, position: float | None, level: int | None) -> dict[str, Any]:
        if axis not in ("x", "y", "z"):
            raise ValueError(f"axis: {axis!r} is not z, y or x")
        number = "xyz".index(axis)
        count = self._loaded("dims")[number]
        if index is not None and position is not None:
            raise ValueError("slice: give one of index and position")
        if position is not None:
            places = (self._info.get("coordinates") or [None] * 3)[number]
            even = round(position / self._loaded("spacing")[number])
            index = int(np.argmin(np.abs(np.subtract(places, position)))) if places else even
        if index is None:
            index = count // 2
        if level is None and not -count <= index < count:
            raise IndexError(f"index: {index} is out of range: the axis {axis} has {count} samples")
        return {"axis": number, "index": index % count if level is None else index, "level": level}

    def _oblique(self, origin, normal, up, size, spacing) -> dict[str, Any]:
        if normal is None:
            raise ValueError("slice: give an axis, or a normal")

        def text(values: Sequence[float]) -> str:
            return ",".join(f"{float(value):.12g}" for value in values)

        width, height = size or (512, 512)
        return {
            "origin": text(self._middle() if origin is None else origin),
            "normal": text(normal),
            "up": None if up is None else text(up),
            "size": f"{width},{height}",
            "spacing": None if spacing is None else f"{spacing:.12g}",
        }

    def _middle(self) -> list[float]:
        dims, spacing = np.array(self._loaded("dims")), np.array(self._loaded("spacing"))
        columns = np.array(self._loaded("direction"))
        return list(np.array(self._loaded("origin")) + columns @ ((dims - 1) / 2 * spacing))

    def measure(self, kind: str, points: Sequence[Sequence[float]], **members: Any) -> dict[str, Any]:
        """Measures in the volume; nothing is stored.

        Parameters
        ----------
        kind : str
            distance, angle, profile, rectangle, ellipse, marker, part or path.
        points
            World positions (x, y, z): see `POST /measure` of openapi.yaml for each kind.
        members
            `range` of a part or a path, `samples` of a profile.

        Returns
        -------
        dict
            value, unit, data_unit, statistics, … (schema Measurement)

        Examples
        --------
        >>> demo.measure("distance", [(0, 0, 0), (3, 4, 0)])["value"]
        5
        """
        request = {
            "volume": self.id,
            "kind": kind,
            "points": [[float(part) for part in point] for point in points],
            **members,
        }
        return decode(self.daemon.http.request("POST", "api/v1/measure", json=request))
