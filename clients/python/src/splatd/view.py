# SPDX-License-Identifier: Apache-2.0
"""The view: everything that an image depends on. Views never change; each method returns another one."""

from __future__ import annotations

import copy
import numbers
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any

from . import layers as layers_of_view
from . import presets, transfer
from .image import Image
from .orbit import angles_of
from .transfer import Color, PointLike
from .types import ViewPatch

if TYPE_CHECKING:
    from .session import Session
    from .volume import Volume
    from .widget import Widget

ANGLES = ("azimuth", "elevation", "distance", "roll")
FULL_TURN = 360.0


class LeftOut(Enum):
    """The default of arguments for which None has a meaning of its own."""

    LEFT_OUT = "left out"


LEFT_OUT = LeftOut.LEFT_OUT


def merged(patch: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """One merge patch (RFC 7396) that does what two do in turn.

    >>> merged({"a": {"b": 1, "c": 2}}, {"a": {"b": None}})
    {'a': {'b': None, 'c': 2}}
    """
    result = dict(patch)
    for key, value in change.items():
        both = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
        result[key] = merged(result[key], value) if both else copy.deepcopy(value)
    return result


def given(**members: Any) -> dict[str, Any]:
    """The members that are not left out."""
    return {name: value for name, value in members.items() if value is not LEFT_OUT}


class View:
    """A volume as it is drawn: camera, transfer function, light, layers, clipping. Make one with `Volume.view()`.

    A view holds what differs from the default view of its volume. Positions and directions are in the world of the
    volume, in the order x, y, z.
    """

    def __init__(self, volume: Volume, patch: Mapping[str, Any] | None = None) -> None:
        self._volume = volume
        self._patch: dict[str, Any] = copy.deepcopy(dict(patch or {}))

    @property
    def volume(self) -> Volume:
        """The volume that the view shows."""
        return self._volume

    @property
    def document(self) -> dict[str, Any]:
        """A copy of the view as the protocol has it (view.schema.json), without members that have their defaults."""
        document = merged(copy.deepcopy(self._patch), {"volume": self._volume.id})
        camera = document.get("camera")
        if camera:
            for angle in ("azimuth", "roll"):
                if isinstance(camera.get(angle), numbers.Real):
                    camera[angle] = float(camera[angle]) % FULL_TURN
        return document

    def __eq__(self, other: object) -> bool:
        return isinstance(other, View) and self._volume is other._volume and self._patch == other._patch

    __hash__ = None  # type: ignore[assignment]

    def __copy__(self) -> View:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> View:
        return self  # it never changes

    def __repr__(self) -> str:
        return f"<splatd.View of {self._volume.id!r}: {self._patch}>"

    def patch(self, change: ViewPatch | Mapping[str, Any]) -> View:
        """The view with any change: a merge patch (RFC 7396) of the view. None restores the default of a member."""
        return View(self._volume, merged(self._patch, change))

    def with_size(self, width: int, height: int) -> View:
        """The view with images of `width` x `height` px, each in [1, 8192]."""
        return self.patch({"size": [int(width), int(height)]})

    def with_background(self, color: Color | None, alpha: float = 1.0) -> View:
        """The view over another background; None: transparent."""
        return self.patch({"background": [0, 0, 0, 0] if color is None else [*transfer.color_of(color), alpha]})

    def with_camera(
        self,
        *,
        azimuth: float | LeftOut | None = LEFT_OUT,
        elevation: float | LeftOut | None = LEFT_OUT,
        distance: float | LeftOut | None = LEFT_OUT,
        roll: float | LeftOut | None = LEFT_OUT,
        position: Sequence[float] | LeftOut | None = LEFT_OUT,
        target: Sequence[float] | LeftOut | None = LEFT_OUT,
        up: Sequence[float] | LeftOut | None = LEFT_OUT,
        fov_y: float | LeftOut | None = LEFT_OUT,
        projection: str | LeftOut | None = LEFT_OUT,
        height: float | LeftOut | None = LEFT_OUT,
        near: float | LeftOut | None = LEFT_OUT,
    ) -> View:
        """The view from another camera. Members that are left out stay.

        Parameters
        ----------
        azimuth : float
            Where the eye is around the target, in degrees: 0 in front, 90 on the right. Any number of turns.
        elevation : float
            Angle of the eye above the target in degrees, -90 to 90.
        distance : float
            From the eye to the target, in world units.
        roll : float
            Turns the image clockwise, in degrees.
        position, target, up
            Instead of these angles: the eye, the point at the centre of the image, the direction that points up; x,
            y, z.
        fov_y : float
            Vertical field of view in degrees, 1 to 170.
        projection : str
            "perspective" or "orthographic"
        height : float
            Height of an orthographic image in world units.
        near : float
            Distance of the near plane in world units.

        Raises
        ------
        ValueError
            Angles and `position` or `up` cannot be combined in one call.
        """
        change = given(
            azimuth=azimuth,
            elevation=elevation,
            distance=distance,
            roll=roll,
            position=position,
            target=target,
            up=up,
            fov_y=fov_y,
            projection=projection,
            height=height,
            near=near,
        )
        for name in ("position", "target", "up"):
            if change.get(name) is not None and name in change:
                change[name] = [float(part) for part in change[name]]
        camera = dict(self._patch.get("camera") or {})
        angles = [name for name in ANGLES if change.get(name) is not None]
        places = [name for name in ("position", "up") if change.get(name) is not None]
        if angles and places:
            raise ValueError(f"with_camera: {angles[0]} and {places[0]} exclude each other")
        if angles and any(camera.get(name) is not None for name in ("position", "up")):
            camera |= self.angles()  # the angles that are not given stay
        dropped = ANGLES if places else ("position", "up") if angles else ()
        camera = {name: value for name, value in camera.items() if name not in dropped}
        return View(self._volume, {**self._patch, "camera": merged(camera, change)})

    def angles(self) -> dict[str, float]:
        """Azimuth, elevation and roll of the camera in degrees, and its distance from the target in world units."""
        defaults = self._volume.default_camera()
        camera = {name: value for name, value in (self._patch.get("camera") or {}).items() if value is not None}
        given_angles = {name: camera[name] for name in ANGLES if name in camera}
        return angles_of({**defaults, **camera}, defaults) | given_angles

    def with_transfer(
        self,
        points: Sequence[PointLike] | str | Any = None,
        *,
        window: tuple[float, float] | None = None,
        preset: str | None = None,
        range: tuple[float, float] | None = None,
        opacity: Any = 0.5,
        gradient: Sequence[tuple[float, float]] | LeftOut | None = LEFT_OUT,
        order: str | LeftOut | None = LEFT_OUT,
        reference_length: float | LeftOut | None = LEFT_OUT,
    ) -> View:
        """The view with another transfer function.

        Parameters
        ----------
        points
            A list of (value, opacity) or (value, opacity, colour), with rising values in the unit of the data. Points
            without a colour take it from their neighbours. Or a colour map: its name ("viridis", any name of
            Matplotlib), a Matplotlib colour map, or an array of colours.
        window : (float, float)
            Instead: centre and width of a window, from black and transparent to white.
        preset : str
            Instead: a kind of data ("CT bone", "CT soft", "CT lung", "CT vessels", "MR", "microscopy", "simulation"),
            or a preset that the daemon stores, whose other members of the view are taken as well.
        range : (float, float)
            Of a colour map: the values of its first and last colour. Default: the range of the volume.
        opacity
            Of a colour map and a window: the opacity at the upper end, from 0 at the lower one, over
            `reference_length`. For a map also a list of (value, opacity), or a function of the value.
        gradient
            A list of (gradient magnitude, factor on the opacity).
        order : str
            "pre", "post" or "auto"
        reference_length : float
            Length in world units that opacities refer to. Default: the smallest spacing.

        Examples
        --------
        >>> view = demo.view().with_transfer([(40, 0), (120, 0.05, "#c88"), (230, 0.9, "white")])
        >>> view = demo.view().with_transfer("viridis", range=(40, 230), opacity=0.2)
        """
        given_ways = [way for way in (points, window, preset) if way is not None]
        if len(given_ways) > 1:
            raise ValueError("with_transfer: give one of points, window and preset")
        change: dict[str, Any] = given(order=order, reference_length=reference_length)
        if gradient is not LEFT_OUT:
            change["gradient"] = None if gradient is None else [{"magnitude": m, "scale": s} for m, s in gradient]
        if preset is not None:
            return self._with_preset(preset).patch({"transfer_function": change})
        if window is not None:
            change["points"] = transfer.window_points(*window, opacity=opacity)
        elif points is not None:
            change["points"] = self._points(points, range, opacity)
        return self.patch({"transfer_function": change})

    def _points(self, points: Any, range: tuple[float, float] | None, opacity: Any) -> list[Any]:
        is_list = isinstance(points, (list, tuple)) and range is None
        if is_list:
            return list(transfer.points_of(points))
        low, high = range or self._volume.range
        return list(transfer.map_points(transfer.color_map(points), low, high, opacity))

    def _with_preset(self, name: str) -> View:
        if presets.name_of(name) in presets.KINDS:
            return self.patch({"transfer_function": {"points": self._volume.preset_points(name)}})
        stored = dict(self._volume.daemon.presets[name])
        stored.pop("volume", None)
        return self.patch(stored)

    def with_layers(self, *layers: layers_of_view.Layer) -> View:
        """The view with these layers: see `splatd.layers`. They replace those that it has."""
        return self.patch({"layers": [dict(layer) for layer in layers] or None})

    def with_clip(
        self,
        *,
        box: Sequence[Sequence[float]] | LeftOut | None = LEFT_OUT,
        planes: Sequence[tuple[Sequence[float], float]] | LeftOut | None = LEFT_OUT,
    ) -> View:
        """The view with clipping.

        Parameters
        ----------
        box
            Lower and upper corner, as fractions of the axes x, y, z of the volume: ((0, 0, 0), (1, 1, 0.5)).
        planes
            A list of (normal, offset): points p with p . normal >= offset are visible. World units, x, y, z.
        """
        change: dict[str, Any] = {}
        if box is not LEFT_OUT:
            change["box"] = None if box is None else [[float(part) for part in corner] for corner in box]
        if planes is not LEFT_OUT:
            change["planes"] = None if planes is None else [{"normal": list(n), "offset": float(o)} for n, o in planes]
        return self.patch({"clip": change})

    def with_shading(self, **members: Any) -> View:
        """The view in another light: mode ("phong", "none"), ambient, diffuse, specular, exponent, occlusion, shadow,
        …"""
        return self.patch({"shading": members})

    def with_compositing(self, **members: Any) -> View:
        """The view with another compositing: mode ("sheet", "slab", "maximum", "mean", …), window, colors, …"""
        return self.patch({"compositing": members})

    def with_filter(self, **members: Any) -> View:
        """The view with another filter: mode ("adaptive", "ewa", …), kernel, sigma, cutoff, lowpass, …"""
        return self.patch({"filter": members})

    def with_step(self, step: int) -> View:
        """The view of another time step, from 0."""
        return self.patch({"time": {"step": int(step)}})

    def render(self, *, size: tuple[int, int] | None = None, format: str = "png", quality: int | None = None) -> Image:
        """Draws the view.

        Parameters
        ----------
        size : (int, int)
            Width and height in px. Default: the size of the view.
        format : str
            png, jpeg, webp or exr (linear floats with alpha and depth).
        quality : int
            1 to 100, of JPEG and WebP.

        Returns
        -------
        Image
            Like an array (height, width, 4) of uint8; `save`, `pil`, `bytes`.
        """
        document = self.document if size is None else self.with_size(*size).document
        answer = self._volume.daemon.http.request(
            "POST", "api/v1/render", query={"format": format, "quality": quality}, json=document
        )
        return Image.of_answer(answer.data, answer.headers)

    def share(self) -> Session:
        """A session that shows this view to several people, and its links."""
        return self._volume.daemon.share(self)

    def show(self, *, transport: str = "auto", controls: bool = True, width: str = "", height: str = "") -> Widget:
        """A widget with this view for a notebook; it needs `pip install 'splatd[jupyter]'`.

        Parameters
        ----------
        transport : str
            How the browser reaches the daemon. "websocket": directly, or through jupyter-server-proxy. "kernel":
            through the kernel, which works everywhere, but waits for cells that run unless the kernel has subshells.
            "auto": the first of these that works; `Widget.transport_used` tells it.
        controls : bool
            True: mouse, touch and keys move the camera.
        width, height : str
            CSS lengths, such as "100%" and "30em". Default: the size of the view, and no wider than the cell.
        """
        from .widget import Widget

        return Widget(self, transport=transport, controls=controls, width=width, height=height)

    def full(self) -> dict[str, Any]:
        """The view with every member, as the daemon understands it. A session holds it for a moment."""
        with self.share() as session:
            return session.document

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        return self.render()._repr_mimebundle_()
