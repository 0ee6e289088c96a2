# SPDX-License-Identifier: Apache-2.0
"""The angles of a camera around its target, as protocol/orbit.h defines them.

They refer to the default camera of the volume. Its up is the axis of the elevation; the front is the axis of the world,
across that up, from which the default camera looks most.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

POLE_DEGREES = 89.9  # beyond this elevation, the top of the image tells the azimuth


def _axes(defaults: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Up, front and right, orthonormal; right as seen by an eye at the front."""
    up = np.array(defaults["up"], float)
    up /= np.linalg.norm(up)
    away = np.array(defaults["position"], float) - np.array(defaults["target"], float)
    away -= away @ up * up
    most = int(np.argmax(np.abs(away)))
    front = np.zeros(3)
    front[most] = -1 if away[most] < 0 else 1
    front -= front @ up * up
    front /= np.linalg.norm(front)
    return up, front, np.cross(up, front)


def angles_of(camera: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, float]:
    """Azimuth, elevation and roll in degrees, and the distance in world units.

    Parameters
    ----------
    camera, defaults
        position, target and up of the camera, and of the default camera of the volume.
    """
    up, front, right = _axes(defaults)
    away = np.array(camera["position"], float) - np.array(camera["target"], float)
    top = np.array(camera["up"], float)
    rise, horizontal = away @ up, np.hypot(away @ front, away @ right)
    elevation = np.degrees(np.arctan2(rise, horizontal))
    towards = away if abs(elevation) <= POLE_DEGREES else top * (-1 if rise > 0 else 1)
    azimuth = np.arctan2(towards @ right, towards @ front)
    level = np.cos(azimuth) * front + np.sin(azimuth) * right
    tilt = np.radians(elevation)
    above = -np.sin(tilt) * level + np.cos(tilt) * up
    aside = np.cross(above, np.cos(tilt) * level + np.sin(tilt) * up)
    roll = np.arctan2(-(top @ aside), top @ above)
    return {
        "azimuth": float(np.degrees(azimuth)),
        "elevation": float(elevation),
        "distance": float(np.hypot(rise, horizontal)),
        "roll": float(np.degrees(roll)),
    }
