# SPDX-License-Identifier: Apache-2.0
"""xarray: names, coordinates and units."""

import numpy as np
import pytest

xarray = pytest.importorskip("xarray")


@pytest.fixture
def field():
    values = np.arange(3 * 4 * 5, dtype="f4").reshape(3, 4, 5)
    coords = {"z": [0.0, 10.0, 30.0], "lat": [50.0, 49.0, 48.0, 47.0], "lon": [5.0, 6.0, 7.0, 8.0, 9.0]}
    array = xarray.DataArray(values, dims=("z", "lat", "lon"), coords=coords, name="t", attrs={"units": "K"})
    for dim in coords:
        array[dim].attrs["units"] = "km"
    return array


def test_coordinates_units_and_names(daemon, field):
    volume = field.splat.add(daemon)
    assert (volume.name, volume.unit, volume.value_unit) == ("t", "km", "K")
    assert volume.info["coordinates"][2] == [0, 10, 30]
    assert volume.shape == (3, 4, 5)
    # Latitudes fall: the sample of 50 degrees keeps its place in the world.
    assert volume.measure("marker", [(5, 50, 0)])["value"] == field.sel(z=0, lat=50, lon=5)
    assert volume.measure("marker", [(8, 48, 30)])["value"] == field.sel(z=30, lat=48, lon=8)


def test_dimensions_by_name(daemon, field):
    volume = daemon.add(field.transpose("lon", "z", "lat"))
    assert volume.measure("marker", [(8, 48, 30)])["value"] == field.sel(z=30, lat=48, lon=8)


def test_arguments_replace_what_it_states(daemon, field):
    assert daemon.add(field, name="mine", unit="m").name == "mine"


def test_other_dimensions(daemon, field):
    with pytest.raises(ValueError, match=r"isel\(member=0\)"):
        daemon.add(field.expand_dims(member=2))
    dated = field.rename(z="time").assign_coords(time=np.array(["2020-01-01", "2020-01-02", "2020-01-03"], "M8[ns]"))
    assert daemon.add(dated).spacing[0] == 86400


def test_dask(daemon, field):
    pytest.importorskip("dask")
    assert daemon.add(field.chunk(2)).range == (0, 59)


def test_time_series(daemon, field):
    even = field.assign_coords(z=("z", [0.0, 10.0, 20.0], {"units": "km"}))
    series = xarray.concat([even, even + 100, even + 200], dim="time").assign_coords(time=[0.0, 1.0, 4.0])
    series.time.attrs["units"] = "h"
    for array in (series, series.transpose("z", "time", "lat", "lon")):
        volume = array.splat.add(daemon)
        assert volume.steps == 3
        assert volume.info["steps"] == {"count": 3, "unit": "h", "times": [0, 1, 4]}
        assert (volume.unit, volume.value_unit, volume.spacing) == ("km", "K", (10, 1, 1))
        for step in range(3):
            view = volume.view(size=(16, 16)).with_step(step)
            assert view.render().shape == (16, 16, 4)
            expected = series.sel(lat=[47, 48, 49, 50]).isel(time=step, z=1)  # rising
            np.testing.assert_array_equal(volume.slice("z", index=1, step=step).array, expected)
