# SPDX-License-Identifier: Apache-2.0
"""Transfer functions by kind of data, as the page offers them (clients/web/core/tissue.js).

Presets of CT are in Hounsfield units, if these can be found in the values. The others follow percentiles of the
histogram. Opacities refer to the smallest spacing.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable

import numpy as np

from .transfer import OPACITY_MAX, color_map, map_points, points_of
from .types import Point

_HOUNSFIELD = re.compile(r"^\[?(hu|hounsfield( units?)?)\]?$", re.IGNORECASE)
_AIR = -1000.0
_DENSE = 1600.0  # HU of the densest bone in most scans
_BACKGROUND = 0.2  # share of the samples
_SKIN = (0.85, 0.55, 0.42)
_FAT = (0.93, 0.74, 0.5)
_MUSCLE = (0.78, 0.32, 0.26)
_BLOOD = (0.82, 0.12, 0.1)
_BONE = (0.96, 0.91, 0.8)
_WHITE = (1.0, 1.0, 1.0)

_CT = {
    "ct-bone": [(150, 0, _SKIN), (250, 0.06, _FAT), (400, 0.35, _BONE), (900, 0.6, _BONE), (1600, 0.85, _WHITE)],
    "ct-soft": [
        (-180, 0, _SKIN),
        (-110, 0.02, _FAT),
        (-30, 0.03, _FAT),
        (20, 0.12, _MUSCLE),
        (80, 0.2, _MUSCLE),
        (160, 0.3, _BLOOD),
        (350, 0.5, _BONE),
        (1600, 0.8, _WHITE),
    ],
    "ct-lung": [
        (-980, 0, (0.25, 0.35, 0.5)),
        (-900, 0.012, (0.45, 0.62, 0.8)),
        (-750, 0.035, (0.75, 0.85, 0.95)),
        (-600, 0.02, (0.9, 0.75, 0.7)),
        (-450, 0.09, _SKIN),
        (-300, 0.01, _SKIN),
        (-150, 0, _SKIN),
    ],
    "ct-vessels": [
        (130, 0, _MUSCLE),
        (180, 0.12, _BLOOD),
        (320, 0.45, (0.92, 0.25, 0.15)),
        (480, 0.35, (0.95, 0.6, 0.35)),
        (700, 0.3, _BONE),
        (1600, 0.5, _WHITE),
    ],
}
KINDS = (*_CT, "mr", "microscopy", "simulation")


class _Counts:
    """A histogram of `counts.size` equal bins in [low, high]; the same statistics as clients/web/core/histogram.js."""

    def __init__(self, low: float, high: float, counts: np.ndarray) -> None:
        self.low, self.high, self.counts = low, high, counts
        self.width = (high - low) / counts.size
        self.middles = low + self.width * (np.arange(counts.size) + 0.5)

    def percentile(self, part: float, above: float = -np.inf) -> float:
        """The value below which the share `part` of the samples of at least `above` lies."""
        position = -np.inf if above == -np.inf else np.ceil((above - self.low) / self.width - 1e-9)
        first = int(np.clip(position, 0, self.counts.size - 1))
        rest = self.counts[first:]
        if not rest.sum():
            return self.high
        wanted = part * rest.sum()
        sums = np.cumsum(rest)
        at = int(np.argmax(sums >= wanted))
        before = sums[at] - rest[at]
        inside = (wanted - before) / rest[at] if rest[at] else 0.0
        return float(self.low + self.width * (first + at + inside))

    def peak(self, low: float = -np.inf, high: float = np.inf) -> float | None:
        """The middle of the fullest bin between two values."""
        inside = np.flatnonzero((self.middles >= low) & (self.middles <= high))
        return float(self.middles[inside[np.argmax(self.counts[inside])]]) if inside.size else None

    def threshold(self) -> float:
        """The threshold between background and object (Otsu 1979), with the logarithm of the counts as weights."""
        weights = np.log1p(self.counts)
        total, moment = weights.sum(), (weights * np.arange(weights.size)).sum()
        weight, sums = np.cumsum(weights)[:-1], np.cumsum(weights * np.arange(weights.size))[:-1]
        valid = (weight > 0) & (weight < total)
        if not valid.any():
            return self.low
        between = np.full(weight.size, -1.0)
        between[valid] = (moment * weight[valid] - sums[valid] * total) ** 2 / (weight[valid] * (total - weight[valid]))
        return float(self.low + self.width * (int(np.argmax(between)) + 1))

    def has_air(self) -> bool:
        """True if the values look like a CT: among low values, the fullest bin holds air."""
        air = self.peak(-1500, -300) if self.low <= -200 and self.high >= 200 else None
        if air is None or abs(air - _AIR) > 150:
            return False
        return self.counts[int((air - self.low) / (self.high - self.low) * self.counts.size)] > 0


def _hounsfield(counts: _Counts, unit: str, meaning: str) -> Callable[[float], float]:
    """How Hounsfield units lie in the values. Only where the file states no unit, the histogram decides."""
    low, high = counts.low, counts.high
    is_open = not unit and not meaning
    if _HOUNSFIELD.match(unit) or (is_open and counts.has_air()):
        return lambda hu: hu
    # Scanners without negative numbers store HU + 1024 or HU + 1000. Soft tissue, the peak between -150 and 150 HU,
    # decides.
    tissue = counts.peak(850, 1180) if is_open and -200 < low < 400 and 1400 < high < 6000 else None
    if tissue is not None:
        offset = 1024 if abs(tissue - 1040) <= abs(tissue - 1016) else 1000
        return lambda hu: hu + offset
    peak = counts.peak(low, low + (high - low) / 3)
    air = low if peak is None else peak
    span = max(counts.percentile(0.995, counts.threshold()) - air, (high - low) / 100)
    return lambda hu: air + (hu - _AIR) / (_DENSE - _AIR) * span


def _rising(points: list[tuple], low: float, high: float) -> list[tuple]:
    """Points whose values rise. Few values make percentiles coincide: then the points are spread over the range."""
    if all(b[0] > a[0] for a, b in itertools.pairwise(points)):
        return points
    first = points[0][0] if points[0][0] < high else low
    return [(first + (high - first) * (i / (len(points) - 1)), *point[1:]) for i, point in enumerate(points)]


def _mr(counts: _Counts) -> list[tuple]:
    base = counts.threshold()
    return [
        (base, 0, (0.15, 0.1, 0.12)),
        (counts.percentile(0.25, base), 0.02, (0.55, 0.38, 0.34)),
        (counts.percentile(0.6, base), 0.1, (0.82, 0.66, 0.58)),
        (counts.percentile(0.9, base), 0.3, (0.95, 0.88, 0.8)),
        (counts.percentile(0.995, base), 0.6, _WHITE),
    ]


def _microscopy(counts: _Counts) -> list[tuple]:
    dark = counts.peak()  # the background of fluorescence is the fullest bin, and what lights up is rare
    base = counts.low if dark is None else dark
    return [
        (counts.percentile(0.5, base), 0, (0, 0.1, 0.15)),
        (counts.percentile(0.9, base), 0.02, (0, 0.45, 0.4)),
        (counts.percentile(0.98, base), 0.2, (0.25, 0.85, 0.45)),
        (counts.percentile(0.999, base), 0.7, (0.9, 1, 0.75)),
    ]


def _simulation(counts: _Counts) -> list[tuple]:
    most = int(np.argmax(counts.counts))
    is_background = counts.counts[most] > _BACKGROUND * counts.counts.sum() and most < counts.counts.size / 2
    base = float(counts.middles[most] + counts.width) if is_background else counts.low
    shares = ((0.5, 0.012), (0.9, 0.06), (0.99, 0.3))
    return [
        (base, 0, _WHITE),
        *((counts.percentile(part, base), o, _WHITE) for part, o in shares),
        (counts.high, 0.6, _WHITE),
    ]


def preset_points(
    kind: str, low: float, high: float, counts: np.ndarray, unit: str = "", meaning: str = ""
) -> list[Point]:
    """The points of a kind of data.

    Parameters
    ----------
    kind : str
        One of `KINDS`; capitals, spaces and hyphens make no difference: "CT bone" is "ct-bone".
    low, high, counts
        The histogram of the values: its range, and the samples per bin of equal width.
    unit, meaning : str
        What the file says about the values.
    """
    kind = name_of(kind)
    if not high > low:
        return points_of([(low, 0.1, _WHITE)])
    histogram = _Counts(low, high, np.asarray(counts))
    if kind in _CT:
        at = _hounsfield(histogram, unit, meaning)
        points = [(at(hu), opacity, color) for hu, opacity, color in _CT[kind]]
    else:
        points = {"mr": _mr, "microscopy": _microscopy, "simulation": _simulation}[kind](histogram)
    points = [(value, min(opacity, OPACITY_MAX), color) for value, opacity, color in _rising(points, low, high)]
    if kind == "simulation":
        return map_points(color_map("viridis"), low, high, [(value, opacity) for value, opacity, _ in points])
    return points_of(points)


def name_of(text: str) -> str:
    """The name of a preset as the daemon and `KINDS` have it."""
    return "-".join(text.lower().replace("_", " ").split())
