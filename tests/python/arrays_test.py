# SPDX-License-Identifier: Apache-2.0
"""Arrays of every type, order and place arrive as they are."""

import numpy as np
import pytest

from splatd.arrays import TYPES, grid_of

# What the daemon makes of types that it does not keep.
KEPT = {"uint32": "float64", "uint64": "float64", "int64": "float64", "float16": "float32"}


def samples_of(volume):
    """All samples, read back slice by slice."""
    return np.stack([volume.slice("z", index=k).array for k in range(volume.shape[0])])


@pytest.fixture(scope="module")
def ramp():
    return np.arange(3 * 4 * 5).reshape(3, 4, 5)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("name", TYPES)
def test_every_type_and_byte_order(daemon, ramp, name, order):
    array = ramp.astype(np.dtype(name).newbyteorder(order))
    volume = daemon.add(array, name=name)
    assert volume.shape == (3, 4, 5)
    np.testing.assert_array_equal(samples_of(volume), array)
    volume.close()


def test_extreme_values(daemon):
    for dtype in ("uint8", "int8", "uint16", "int16", "int32"):
        info = np.iinfo(dtype)
        array = np.full((2, 2, 2), info.min, dtype)
        array[1] = info.max
        volume = daemon.add(array)
        assert volume.dtype == dtype
        assert volume.range == (info.min, info.max)


@pytest.mark.parametrize(
    "changed",
    [
        lambda a: np.asfortranarray(a),
        lambda a: a[::-1],
        lambda a: a[:, ::2, ::-1],
        lambda a: a.transpose(2, 0, 1),
        lambda a: np.broadcast_to(a[:1], a.shape),
        lambda a: np.ascontiguousarray(a)[:, :, 1:],
    ],
)
def test_strides(daemon, ramp, changed):
    array = changed(ramp.astype("i2"))
    np.testing.assert_array_equal(samples_of(daemon.add(array)), array)


def test_contiguous_arrays_are_not_copied(ramp):
    for array in (ramp.astype("u1"), ramp.astype(">f4"), ramp.astype(bool)):
        assert np.shares_memory(grid_of(array).samples, array)


def test_axes_and_place(daemon, ramp):
    array = ramp.astype("u1")
    zyx = daemon.add(array, spacing=(3, 2, 1), origin=(30, 20, 10), unit="mm", value_unit="HU", name="zyx")
    xyz = daemon.add(array.transpose(2, 1, 0), axes="xyz", spacing=(1, 2, 3), origin=(10, 20, 30), name="xyz")
    for volume in (zyx, xyz):
        assert (volume.shape, volume.spacing, volume.origin) == ((3, 4, 5), (3, 2, 1), (30, 20, 10))
        np.testing.assert_array_equal(samples_of(volume), array)
    assert (zyx.unit, zyx.value_unit, zyx.name) == ("mm", "HU", "zyx")
    assert zyx.measure("marker", [(12, 22, 33)])["value"] == array[1, 1, 2]


def test_vectors(daemon):
    field = np.zeros((4, 5, 6, 3), "f4")
    field[..., 0], field[..., 2] = 3, 4
    for array, axes in ((field, "zyxc"), (np.moveaxis(field, 3, 0), "czyx"), (field.transpose(2, 1, 0, 3), "xyzc")):
        volume = daemon.add(array, axes=axes)
        assert volume.shape == (4, 5, 6)
        assert volume.range == (5, 5)
        assert [entry["components"] for entry in volume.info["fields"]] == [1, 3]


def test_coordinates(daemon, ramp):
    array = ramp.astype("u1")
    uneven = daemon.add(array, coordinates={"z": [10, 11, 15], "x": [0, 2, 4, 6, 8]})
    assert uneven.origin == (10, 0, 0)
    assert uneven.spacing == (2.5, 1, 2)
    assert uneven.info["coordinates"] == [None, None, [0, 1, 5]]
    assert uneven.slice("z", position=4.6).array[0, 0] == array[2, 0, 0]
    falling = daemon.add(array, coordinates={"z": [2, 1, 0]})
    assert falling.measure("marker", [(0, 0, 2)])["value"] == array[0, 0, 0]


def test_holes(daemon):
    array = np.ones((4, 4, 4), "f4")
    array[0, 0, 0] = np.nan
    array[0, 0, 1] = np.inf
    assert daemon.add(array).info["nonfinite"] == 2
    masked = np.ma.masked_equal(np.arange(64, dtype="u1").reshape(4, 4, 4), 7)
    volume = daemon.add(masked)
    assert volume.info["nonfinite"] == 1
    assert volume.range == (0, 63)


def test_bool(daemon, ball):
    volume = daemon.add(ball > 100)
    assert volume.dtype == np.uint8
    assert volume.range == (0, 1)


@pytest.mark.parametrize(
    ("array", "options", "text"),
    [
        (np.zeros((2, 2)), {}, "3 dimensions, this one has 2"),
        (np.zeros((2, 0, 2)), {}, "empty"),
        (np.zeros((2, 2, 2), complex), {}, "numpy.abs"),
        (np.zeros((2, 2, 2), "U3"), {}, "cannot be rendered"),
        (np.zeros((2, 2, 2, 2)), {"axes": "zyxc"}, "one by one"),
        (np.zeros((2, 2, 2)), {"axes": "abc"}, "x, y and z once each"),
        (np.zeros((2, 2, 2)), {"spacing": (1, 0, 1)}, "not above 0"),
        (np.zeros((2, 2, 2)), {"spacing": (1, float("nan"), 1)}, "not finite"),
        (np.zeros((2, 2, 2)), {"coordinates": {"z": [0, 1, 2]}}, "3 positions for 2 samples"),
        (np.zeros((3, 2, 2)), {"coordinates": {"z": [0, 1, 1]}}, "sort the array"),
    ],
)
def test_refused(daemon, array, options, text):
    before = len(daemon.volumes())
    with pytest.raises((ValueError, TypeError), match=text):
        daemon.add(array, **options)
    assert len(daemon.volumes()) == before


def test_nothing_finite(daemon):
    volume = daemon.add(np.full((2, 2, 2), np.nan))
    assert volume.info["nonfinite"] == 8
    assert volume.view(size=(8, 8)).render().shape == (8, 8, 4)


def test_dlpack_and_array_protocol(daemon, ramp):
    class Tensor:
        """What PyTorch's tensors have in common with those of other packages."""

        def __array__(self, dtype=None, copy=None):
            return ramp.astype("f4")

    np.testing.assert_array_equal(samples_of(daemon.add(Tensor())), ramp)
