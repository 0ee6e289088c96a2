# SPDX-License-Identifier: Apache-2.0
"""One daemon for all tests of the package; docstrings find it as `daemon`, and a built-in volume as `demo`."""

import numpy as np
import pytest

import splatd


@pytest.fixture(scope="session")
def daemon(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    with splatd.start(backend="cpu", data=data, threads=2) as running:
        running.data_folder = data
        yield running


@pytest.fixture(scope="session")
def demo(daemon):
    return daemon.load("demo:engine")


@pytest.fixture(autouse=True)
def names_of_examples(request, doctest_namespace):
    if isinstance(request.node, pytest.DoctestItem):
        doctest_namespace.update(
            daemon=request.getfixturevalue("daemon"), demo=request.getfixturevalue("demo"), splatd=splatd
        )


@pytest.fixture
def ball():
    """A ball of radius 10 in the middle of 32 x 32 x 32 samples: 200 inside, 0 outside, linear over 2 samples."""
    z, y, x = np.mgrid[:32, :32, :32] - 15.5
    return np.clip((11 - np.sqrt(x * x + y * y + z * z)) * 100, 0, 200).astype("u1")
