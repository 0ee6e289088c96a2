# SPDX-License-Identifier: Apache-2.0
"""Arrays as the daemon takes them: contiguous, in numpy's order, of a type that it knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

#: numpy's names of the types that the daemon reads; it keeps uint8 to int32 and floats, and converts the others
#: exactly where it can.
TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float16", "float32", "float64")
COMPONENTS = 3


@dataclass
class Grid:
    """Samples and their place in the world. Axes of `spacing`, `origin` and `coordinates` are in the order x, y, z.

    Attributes
    ----------
    samples : numpy.ndarray
        C-contiguous, (z, y, x); of vectors (z, y, x, 3); of a time series (time, z, y, x).
    coordinates
        For each axis its uneven positions in world units, or None.
    is_series : bool
        The first axis is the time.
    times
        The times of the steps, rising; None: not known.
    """

    samples: np.ndarray
    spacing: list[float]
    origin: list[float]
    direction: Sequence[Sequence[float]] | None = None
    coordinates: list[list[float] | None] = field(default_factory=lambda: [None, None, None])
    unit: str = ""
    value_unit: str = ""
    is_series: bool = False
    times: list[float] | None = None
    time_unit: str = ""

    @property
    def components(self) -> int:
        """Numbers per sample: 3 for vectors."""
        return self.samples.shape[3] if self.samples.ndim == 4 and not self.is_series else 1

    @property
    def dims(self) -> list[int]:
        """Samples along x, y, z."""
        return list(self.samples.shape[self.is_series : self.is_series + 3][::-1])

    def place(self) -> dict[str, Any]:
        """Size, type and place, in the words that the sidecar and `POST /volumes` have in common."""
        place: dict[str, Any] = {
            "dims": self.dims,
            "type": self.samples.dtype.name,
            "spacing": self.spacing,
            "origin": self.origin,
            "unit": self.unit,
            "value_unit": self.value_unit,
        }
        if self.direction is not None:
            place["direction"] = np.transpose(self.direction).tolist()
        return place

    def sidecar(self, file: str) -> dict[str, Any]:
        """The JSON beside the raw samples (renderer/data/import/sidecar.md)."""
        samples = self.samples
        header = self.place() | {
            "components": self.components,
            "file": file,
            "endian": "big" if samples.dtype.newbyteorder("=") != samples.dtype else "little",
        }
        if any(axis is not None for axis in self.coordinates):
            header["coordinates"] = self.coordinates
        return header

    def nrrd_header(self) -> bytes:
        """The header of an NRRD file of a time series, in front of its samples."""
        samples = self.samples
        kind = samples.dtype.newbyteorder("=").name
        columns = np.eye(3) if self.direction is None else np.transpose(self.direction)

        def vector(values: Any) -> str:
            return "({})".format(",".join(f"{float(value):.17g}" for value in values))

        fields = {
            "type": {"float32": "float", "float64": "double"}.get(kind, kind),
            "dimension": 4,
            "space dimension": 3,
            "sizes": " ".join(map(str, [*self.dims, samples.shape[0]])),
            "space directions": " ".join([*(vector(c * s) for c, s in zip(columns, self.spacing)), "none"]),
            "space origin": vector(self.origin),
            "kinds": "domain domain domain time",
            "endian": "big" if samples.dtype.newbyteorder("=") != samples.dtype else "little",
            "encoding": "raw",
        }
        if self.unit:
            fields["space units"] = " ".join([f'"{_plain(self.unit)}"'] * 3)
        if self.value_unit:
            fields["sample units"] = f'"{_plain(self.value_unit)}"'
        lines = ["NRRD0005", *(f"{name}: {value}" for name, value in fields.items())]
        if self.times:
            lines.append("axis 3 index values:=" + " ".join(f"{time:.17g}" for time in self.times))
            lines.append(f"axis 3 index unit:={_plain(self.time_unit)}")
        return "\n".join([*lines, "", ""]).encode()


def _plain(text: str) -> str:
    """A unit without what a field of NRRD cannot have."""
    return text.replace("\n", " ").replace('"', "'").strip()


def to_numpy(array: Any) -> np.ndarray:
    """The array for numpy: from PyTorch, CuPy and JAX by DLPack or a copy from the device; masked samples are NaN."""
    if isinstance(array, np.ma.MaskedArray):
        is_float = np.issubdtype(array.dtype, np.floating)
        return np.ma.filled(
            array if is_float else array.astype(np.float32 if array.dtype.itemsize <= 2 else np.float64), np.nan
        )
    if isinstance(array, np.ndarray):
        return array
    for name in ("detach", "cpu"):  # PyTorch
        if hasattr(array, "__dlpack__") and hasattr(array, name):
            array = getattr(array, name)()
    if hasattr(array, "get") and hasattr(array, "__cuda_array_interface__"):  # CuPy
        return array.get()
    return np.asarray(array)


def _with_axes(samples: np.ndarray, axes: str) -> np.ndarray:
    """The samples in the order (time,) z, y, x (, component)."""
    if sorted(axes) not in (["x", "y", "z"], ["c", "x", "y", "z"], ["t", "x", "y", "z"]):
        raise ValueError(f"axes: {axes!r} has not x, y and z once each, and c for vectors or t for time")
    if samples.ndim != len(axes):
        raise ValueError(
            f"an array with the axes {axes!r} has {len(axes)} dimensions, this one has {samples.ndim}: {samples.shape}"
        )
    wanted = "zyxc" if "c" in axes else "tzyx" if "t" in axes else "zyx"
    samples = samples.transpose([axes.index(axis) for axis in wanted])
    if "c" in axes and samples.shape[3] != COMPONENTS:
        raise ValueError(
            f"the axis c has {samples.shape[3]} components; vectors have {COMPONENTS}. "
            "Add channels one by one: d.add(array[..., 0])"
        )
    if 0 in samples.shape:
        raise ValueError(f"the array is empty: its shape is {samples.shape}")
    return samples


def _checked_type(samples: np.ndarray) -> np.ndarray:
    if samples.dtype == np.bool_:
        return samples.view(np.uint8)
    if np.issubdtype(samples.dtype, np.complexfloating):
        raise TypeError("the samples are complex: add numpy.abs(array), numpy.angle(array), or array.real")
    if samples.dtype.newbyteorder("=").name not in TYPES:
        if np.issubdtype(samples.dtype, np.floating):  # longdouble
            return samples.astype(np.float64)
        raise TypeError(f"the type {samples.dtype} cannot be rendered; known types: {', '.join(TYPES)}")
    return samples


def _ordered(values: Any, axes: str, name: str) -> list[float]:
    """Three numbers in the order of the axes, as x, y, z."""
    numbers = [float(value) for value in np.broadcast_to(values, 3)]
    if not np.all(np.isfinite(numbers)):
        raise ValueError(f"{name}: {values} is not finite")
    spatial = axes.replace("c", "").replace("t", "")
    return [numbers[spatial.index(axis)] for axis in "xyz"]


def _even(positions: Any, name: str) -> tuple[float, float, list[float] | None]:
    """First position, mean gap, and the positions if they are uneven."""
    at = np.asarray(positions, dtype=np.float64)
    if at.ndim != 1 or not np.all(np.isfinite(at)):
        raise ValueError(f"coordinates: {name} is not a list of finite numbers")
    if at.size == 1:
        return float(at[0]), 1.0, None
    gaps = np.diff(at)
    if not (np.all(gaps > 0) or np.all(gaps < 0)):
        raise ValueError(f"coordinates: {name} neither rises nor falls throughout: sort the array along {name}")
    gap = float((at[-1] - at[0]) / (at.size - 1))
    is_even = gap > 0 and bool(np.allclose(gaps, gap, rtol=1e-3, atol=0))
    return float(at[0]), abs(gap), None if is_even else [float(value) for value in at]


def grid_of(
    array: Any,
    *,
    axes: str = "zyx",
    spacing: Any = 1.0,
    origin: Any = 0.0,
    direction: Any = None,
    coordinates: Mapping[str, Any] | None = None,
    unit: str = "",
    value_unit: str = "",
    times: Any = None,
    time_unit: str = "",
) -> Grid:
    """Checks an array and its place (arguments as of `Daemon.add`), without a copy where memory and type allow it."""
    samples = _checked_type(_with_axes(to_numpy(array), axes))
    grid = Grid(
        samples,
        _ordered(spacing, axes, "spacing"),
        _ordered(origin, axes, "origin"),
        None if direction is None else np.asarray(direction, dtype=float).reshape(3, 3).tolist(),
        unit=unit,
        value_unit=value_unit,
    )
    if "t" in axes:
        grid.is_series = True
        if grid.samples.dtype.newbyteorder("=") == np.float16:
            grid.samples = grid.samples.astype(np.float32)
        if grid.samples.shape[0] == 1:
            raise ValueError("a time series has at least two steps: add array[0] of this one")
        if times is not None:
            grid.times = [float(time) for time in times]
            grid.time_unit = time_unit
            if len(grid.times) != grid.samples.shape[0]:
                raise ValueError(f"times: {len(grid.times)} times for {grid.samples.shape[0]} steps")
            if any(b <= a for a, b in zip(grid.times, grid.times[1:])):
                raise ValueError("times: they do not rise: sort the array along the time")
    if min(grid.spacing) <= 0:
        raise ValueError(f"spacing: {spacing} is not above 0")
    for name, positions in (coordinates or {}).items():
        if name not in ("x", "y", "z"):
            raise ValueError(f"coordinates: {name!r} is not x, y or z")
        axis = "xyz".index(name)
        length = grid.dims[axis]
        if np.size(positions) != length:
            raise ValueError(f"coordinates: {name} has {np.size(positions)} positions for {length} samples")
        first, gap, uneven = _even(positions, name)
        grid.origin[axis] = 0.0 if uneven else first
        grid.spacing[axis] = gap
        grid.coordinates[axis] = uneven
    if grid.is_series and any(grid.coordinates):
        raise ValueError("coordinates: a time series needs even coordinates: interpolate the array to even ones")
    grid.samples = np.ascontiguousarray(grid.samples)
    return grid
