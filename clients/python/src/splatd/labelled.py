# SPDX-License-Identifier: Apache-2.0
"""xarray: coordinates become spacing, origin or uneven positions, attributes become units and names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray

TIMES = ("time", "t", "step", "frame")
#: Names of spatial dimensions, in lower case, that mean x, y or z.
NAMES = {
    "x": ("x", "lon", "longitude", "easting", "i", "col", "columns"),
    "y": ("y", "lat", "latitude", "northing", "j", "row", "rows"),
    "z": ("z", "lev", "level", "depth", "height", "altitude", "plane", "k", "slice"),
}


def is_labelled(array: Any) -> bool:
    """True for an xarray.DataArray, whether or not xarray is imported here."""
    return type(array).__module__.split(".")[0] == "xarray" and hasattr(array, "dims") and hasattr(array, "coords")


def axes_of(dims: tuple[Any, ...]) -> str:
    """Which axis each dimension is: by its name, else by its place, z, y, x.

    >>> axes_of(("level", "lat", "lon")), axes_of(("a", "b", "c"))
    ('zyx', 'zyx')
    """
    if len(dims) == 4 and any(str(dim).lower() in TIMES for dim in dims):
        at = next(k for k, dim in enumerate(dims) if str(dim).lower() in TIMES)
        spatial = axes_of((*dims[:at], *dims[at + 1 :]))
        return spatial[:at] + "t" + spatial[at:]
    if len(dims) != 3:
        raise ValueError(
            f"a volume has three dimensions, this array has {list(dims)}: "
            f"choose one of the others, such as da.isel({dims[0]}=0)"
        )
    by_name = [next((axis for axis, names in NAMES.items() if str(dim).lower() in names), "") for dim in dims]
    return "".join(by_name) if sorted(by_name) == ["x", "y", "z"] else "zyx"


def _positions(coordinate: xarray.DataArray) -> np.ndarray | None:
    """The positions of a coordinate in its unit; of dates in seconds. None if they are no numbers."""
    values = np.asarray(coordinate)
    if np.issubdtype(values.dtype, np.datetime64) or np.issubdtype(values.dtype, np.timedelta64):
        return (values - values[0]) / np.timedelta64(1, "s")
    return values.astype(float) if np.issubdtype(values.dtype, np.number) else None


def arguments_of(array: xarray.DataArray) -> tuple[Any, dict[str, Any]]:
    """The samples of a DataArray, with rising coordinates, and the arguments of `Daemon.add` that it states."""
    axes = axes_of(array.dims)
    falling = [
        dim for dim in array.dims if dim in array.coords and array[dim].size > 1 and array[dim][0] > array[dim][-1]
    ]
    array = array.isel({dim: slice(None, None, -1) for dim in falling})
    coordinates: dict[str, Any] = {}
    units: list[str] = []
    times: dict[str, Any] = {}
    for axis, dim in zip(axes, array.dims):
        if dim not in array.coords:
            continue
        positions = _positions(array[dim])
        if axis == "t" and positions is not None:
            is_date = np.issubdtype(array[dim].dtype, np.datetime64) or np.issubdtype(array[dim].dtype, np.timedelta64)
            times = {"times": positions, "time_unit": "s" if is_date else str(array[dim].attrs.get("units", ""))[:31]}
        elif positions is not None and positions.size > 1:
            coordinates[axis] = positions
            units.append(str(array[dim].attrs.get("units", "")))
    stated: dict[str, Any] = {
        "axes": axes,
        "coordinates": coordinates,
        "value_unit": str(array.attrs.get("units", ""))[:31],
    }
    stated |= times
    if units and len(set(units)) == 1:
        stated["unit"] = units[0][:31]
    if array.name or "long_name" in array.attrs:
        stated["name"] = str(array.attrs.get("long_name", array.name))
    return array.data, stated


def register() -> None:
    """Gives each DataArray the accessor `splat`. Does nothing without xarray."""
    try:
        import xarray
    except ImportError:
        return

    @xarray.register_dataarray_accessor("splat")
    class SplatAccessor:  # pyright: ignore[reportUnusedClass]
        """Volume rendering of a DataArray with three dimensions."""

        def __init__(self, array: xarray.DataArray) -> None:
            self._array = array

        def add(self, daemon: Any = None, **options: Any) -> Any:
            """Gives the array to a daemon, by default to the one of `splatd.plot`: see `Daemon.add`."""
            from . import default_daemon

            return (daemon or default_daemon()).add(self._array, **options)

        def plot(self, **options: Any) -> Any:
            """Shows the array: see `splatd.plot`."""
            from . import plot

            return plot(self._array, **options)
