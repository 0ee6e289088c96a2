# SPDX-License-Identifier: Apache-2.0
"""Transfer functions: points, windows, presets by kind of data, and colour maps."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, TypeAlias

import numpy as np

from .types import Point

#: A colour: a name of CSS or "#rgb" or "#rrggbb", or three numbers in [0, 1].
Color: TypeAlias = "str | Sequence[float]"
#: (value, opacity) or (value, opacity, colour); or a point of the view.
PointLike: TypeAlias = "tuple[float, float] | tuple[float, float, Color] | Point"

OPACITY_MAX = 0.999  # the protocol wants opacities below 1
POINTS_MAX = 256
MAP_STOPS = 33  # samples of a Matplotlib colour map; as many as the maps of the page have
WHITE = (1.0, 1.0, 1.0)


def color_of(color: Color) -> list[float]:
    """Three numbers in [0, 1] for a colour.

    >>> color_of("#c88"), color_of("white")
    ([0.8, 0.533333, 0.533333], [1.0, 1.0, 1.0])
    """
    if isinstance(color, str):
        from PIL import ImageColor

        red, green, blue = ImageColor.getrgb(color)[:3]
        return [round(part / 255, 6) for part in (red, green, blue)]
    parts = [float(part) for part in color]
    if len(parts) not in (3, 4) or not all(0 <= part <= 1 for part in parts):
        raise ValueError(f"color: {color!r} is not a name, #rrggbb, or three numbers in [0, 1]")
    return parts[:3]


def points_of(points: Sequence[PointLike]) -> list[Point]:
    """Points of the protocol. Points without a colour take it from their neighbours, linear between them; white
    without any.

    >>> points_of([(0, 0, "black"), (1, 0.5), (2, 0.2, "white")])[1]["color"]
    [0.5, 0.5, 0.5]
    """
    if not 1 <= len(points) <= POINTS_MAX:
        raise ValueError(f"a transfer function has 1 to {POINTS_MAX} points, not {len(points)}")
    values, opacities, colors = [], [], []
    for point in points:
        if isinstance(point, dict):
            value, opacity, color = point["value"], point["opacity"], point["color"]
        else:
            value, opacity, *rest = point
            color = rest[0] if rest else None
        values.append(float(value))
        opacities.append(min(float(opacity), OPACITY_MAX))
        colors.append(None if color is None else color_of(color))
    if any(b <= a for a, b in itertools.pairwise(values)):
        raise ValueError(f"the values of a transfer function rise strictly; these do not: {values}")
    known = [(value, color) for value, color in zip(values, colors) if color is not None] or [(values[0], list(WHITE))]
    at = [value for value, _ in known]
    filled = np.transpose([np.interp(values, at, [color[k] for _, color in known]) for k in range(3)])
    return [
        {"value": value, "opacity": opacity, "color": [round(float(part), 6) for part in color]}
        for value, opacity, color in zip(values, opacities, filled)
    ]


def window_points(center: float, width: float, opacity: float = 0.5) -> list[Point]:
    """A ramp from black and transparent to white, over a window as radiologists use it: its centre and width."""
    if not width > 0:
        raise ValueError(f"window: the width {width} is not above 0")
    return points_of([(center - width / 2, 0, (0, 0, 0)), (center + width / 2, opacity, WHITE)])


@cache
def _tables() -> dict[str, list[str]]:
    return json.loads(files("splatd").joinpath("color_maps.json").read_text())


def color_map(name: Any) -> list[list[float]]:
    """Evenly spaced colours of a map: its name in the page or in Matplotlib, the map itself, or a list of colours."""
    if isinstance(name, str):
        if name in _tables():
            return [color_of(text) for text in _tables()[name]]
        try:
            import matplotlib  # pyright: ignore[reportMissingImports]
        except ImportError:
            known = ", ".join(_tables())
            raise ValueError(
                f"colour map '{name}': Matplotlib has it perhaps, but is not installed; known without it: {known}"
            ) from None
        name = matplotlib.colormaps[name]
    if callable(name):
        colors = np.array([name(t) for t in np.linspace(0, 1, MAP_STOPS)], float)
        return colors[:, :3].round(6).tolist()
    return [color_of(color) for color in name]


def map_points(
    colors: Sequence[Sequence[float]],
    low: float,
    high: float,
    opacity: float | Sequence[tuple[float, float]] | Callable[[float], float],
) -> list[Point]:
    """Points that have the colours of a map from `low` to `high`.

    Parameters
    ----------
    opacity
        One number: the opacity rises linearly from 0 at `low` to this number at `high`. Pairs (value, opacity):
        linear between them, constant outside. A function of the value.
    """
    if not high > low:
        raise ValueError(f"range: {high} is not above {low}")
    stops = np.linspace(low, high, len(colors))
    if callable(opacity):
        values = stops
        opacities = [float(opacity(value)) for value in values]
    else:
        pairs = [(low, 0.0), (high, float(opacity))] if isinstance(opacity, (int, float)) else list(opacity)
        values = np.union1d(stops, [value for value, _ in pairs])
        opacities = np.interp(values, [value for value, _ in pairs], [part for _, part in pairs])
    channels = [np.interp(values, stops, [color[k] for color in colors]) for k in range(3)]
    return points_of([(v, o, (r, g, b)) for v, o, r, g, b in zip(values, opacities, *channels)])
