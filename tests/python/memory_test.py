# SPDX-License-Identifier: Apache-2.0
"""Arrays that the daemon maps: nothing is sent, nothing leaks, and later writes do not show."""

import os

import numpy as np
import pytest

import splatd
from splatd import memory


def open_descriptors():
    return len(os.listdir("/proc/self/fd"))


@pytest.fixture
def sent(daemon, monkeypatch):
    """Fails if an array is uploaded."""

    def refuse(*arguments):
        raise AssertionError("the array was uploaded")

    monkeypatch.setattr(splatd.Daemon, "_send", refuse)
    return daemon


@pytest.mark.parametrize("dtype", [*memory.TYPES, ">u2", ">f8"])
def test_arrays_are_mapped(sent, dtype):
    array = np.arange(4 * 5 * 6).reshape(4, 5, 6).astype(dtype)
    volume = sent.add(array, spacing=(3, 2, 1), origin=(1, 2, 3), unit="mm", value_unit="HU")
    for k in range(4):
        np.testing.assert_array_equal(volume.slice("z", index=k).array, array[k])
    assert (volume.spacing, volume.origin, volume.unit, volume.value_unit) == ((3, 2, 1), (1, 2, 3), "mm", "HU")
    volume.close()


def test_direction_is_the_same_both_ways(daemon, monkeypatch):
    direction = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]  # a turned array: the columns are its axes x, y, z
    array = np.arange(24, dtype="u1").reshape(2, 3, 4)
    mapped = daemon.add(array, direction=direction)
    monkeypatch.setattr(daemon, "socket_path", "")
    uploaded = daemon.add(array, direction=direction)
    for volume in (mapped, uploaded):
        assert volume.info["direction"] == direction
        assert volume.measure("marker", [(0, 1, 0)])["value"] == array[0, 0, 1]


def test_empty_arrays_are_there_already(sent):
    array = splatd.empty((8, 9, 10), "i2")
    assert not array.any()
    array[...] = np.arange(720).reshape(8, 9, 10)
    volume = sent.add(array)
    array[0] = -5  # the array is still the caller's, and the volume is as it was
    np.testing.assert_array_equal(volume.slice("z", index=0).array, np.arange(90).reshape(9, 10))
    assert volume.range == (0, 719)
    again = sent.add(array)
    np.testing.assert_array_equal(again.slice("z", index=0).array, np.full((9, 10), -5))
    assert array[7, 8, 9] == 719


def test_empty_arrays_of_another_byte_order(sent):
    array = splatd.empty((4, 4, 4), ">f4")
    array[...] = 3
    assert sent.add(array).range == (3, 3)


def test_addresses_of_the_daemon(tmp_path):
    with splatd.start(backend="null", listen=["127.0.0.1:0", f"unix:{tmp_path}/own"]) as daemon:
        assert daemon.socket_path == f"{tmp_path}/own"
        assert daemon.add(np.ones((4, 4, 4), "u1")).range == (1, 1)


def test_parts_of_empty_arrays_are_copied(sent):
    array = splatd.empty((8, 9, 10), "u1")
    array[2:6] = 7
    assert sent.add(array[2:6]).range == (7, 7)
    array[...] = 1  # still shared memory of its own
    assert sent.add(array).range == (1, 1)


def test_descriptors_are_closed(sent):
    sent.add(np.zeros((4, 4, 4), "u1")).close()
    before = open_descriptors()
    for _ in range(20):
        sent.add(np.ones((4, 4, 4), "u1")).close()
        array = splatd.empty((4, 4, 4), "u1")
        sent.add(array).close()
        del array
    assert open_descriptors() <= before + 1


def test_wrong_tokens(daemon):
    stranger = splatd.Daemon(f"unix:{daemon.socket_path}", "0123456789abcdef0123456789abcdef")
    with pytest.raises(splatd.errors.Unauthorized):
        stranger.add(np.zeros((4, 4, 4), "u1"))


def test_everything_works_over_the_socket(daemon):
    local = splatd.connect(f"unix:{daemon.socket_path}", token=daemon.token)
    view = local.add(np.tri(16, dtype="u1")[None].repeat(16, 0)).view(size=(32, 32))
    with view.share() as session, session.stream(format="png") as stream:
        assert np.array_equal(stream.wait().image, view.render())
        with pytest.raises(splatd.Error, match="Unix socket"):
            session.link()


def test_not_a_daemon(tmp_path):
    with pytest.raises(splatd.errors.ConnectionFailed):
        memory.give(str(tmp_path / "none"), "", np.zeros((2, 2, 2), "u1"))
