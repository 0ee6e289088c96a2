# SPDX-License-Identifier: Apache-2.0
"""The layers of a view, for `View.with_layers`. Members that are left out have their defaults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from . import transfer
from .transfer import Color, PointLike
from .types import Channel, Gaussians, Geometry, Points, Shell, Surface, Vectors, VolumeLayer

if TYPE_CHECKING:
    from .volume import Volume

Layer: TypeAlias = "VolumeLayer | Surface | Shell | Vectors | Points | Gaussians | Geometry | Channel"


def _id(volume: Volume | str) -> str:
    return volume if isinstance(volume, str) else volume.id


def _layer(type: str, members: dict[str, Any], colors: Sequence[str] = ("color",)) -> Any:
    layer = {"type": type} | {name: value for name, value in members.items() if value is not None}
    for name in colors:
        if name in layer:
            layer[name] = transfer.color_of(layer[name])
    return layer


def volume(*, visible: bool | None = None) -> VolumeLayer:
    """The whole volume, through the transfer function."""
    return _layer("volume", {"visible": visible})


def surface(
    value: float, *, color: Color | None = None, opacity: float | None = None, flatness: float | None = None
) -> Surface:
    """The surface on which the volume has one value.

    Parameters
    ----------
    value : float
        In the unit of the data.
    opacity : float
        0 to 1, default 1.
    flatness : float
        How many times narrower kernels are along the gradient than across it. Default: discs.
    """
    return _layer("surface", {"value": float(value), "color": color, "opacity": opacity, "flatness": flatness})


def shell(*, low: float | None = None, high: float | None = None, detail: str | None = None) -> Shell:
    """The voxels at borders of opacity: from `low` on, with a neighbour below `high`. `detail`: "high" or "fast"."""
    return _layer("shell", {"low": low, "high": high, "detail": detail})


def vectors(*, color: Color | None = None, color_by: Volume | str | None = None, **members: Any) -> Vectors:
    """Streaks along the vectors of the volume. `members`: style, phase, stretch, density, color_low, color_high."""
    by = None if color_by is None else _id(color_by)
    return _layer("vectors", {"color": color, "color_by": by, **members})


def points(
    of: Volume | str | None = None, *, size: float | None = None, color_by: Volume | str | None = None, **members: Any
) -> Points:
    """The points of the volume, or of another one. `members`: transform, color_low, color_high."""
    by = None if color_by is None else _id(color_by)
    return _layer("points", {"id": None if of is None else _id(of), "size": size, "color_by": by, **members})


def gaussians(of: Volume | str | None = None, *, opacity: float | None = None, **members: Any) -> Gaussians:
    """The Gaussians of the volume, or of another one. `members`: transform, convention."""
    return _layer("gaussians", {"id": None if of is None else _id(of), "opacity": opacity, **members})


def geometry(
    of: Volume | str | None = None, *, color: Color | None = None, opacity: float | None = None, **members: Any
) -> Geometry:
    """The triangles of the volume, or of another one. `members`: transform, colors."""
    return _layer("geometry", {"id": None if of is None else _id(of), "color": color, "opacity": opacity, **members})


def channel(of: Volume | str, *, color: Color | None = None, points: Sequence[PointLike] | None = None) -> Channel:
    """Another volume on the same grid, mixed with the volume of the view: in shades of a colour, or by own points."""
    own = None if points is None else transfer.points_of(points)
    return _layer("channel", {"id": _id(of), "color": color, "points": own})
