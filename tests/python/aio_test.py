# SPDX-License-Identifier: Apache-2.0
"""The asynchronous twin has each method, and its own results."""

import asyncio
import inspect

import numpy as np
import pytest

import splatd
from splatd import aio

TWINS = {
    aio.Daemon: splatd.Daemon,
    aio.Volume: splatd.Volume,
    aio.View: splatd.View,
    aio.SavedView: splatd.SavedView,
    aio.Session: splatd.Session,
    aio.Stream: splatd.Stream,
    aio.Job: splatd.Job,
}
# Members that only the synchronous interface has, because they answer at once or are for notebooks.
SYNC_ONLY = {
    "connect",
    "http",
    "presets",
    "saved_views",
    "jobs",
    "version",
    "daemon",
    "volume",
    "open",
    "measures",
    "listen",
    "show",
}


@pytest.mark.parametrize("twin", TWINS, ids=lambda twin: twin.__name__)
def test_nothing_is_missing(twin):
    names = {name for name in vars(TWINS[twin]) if not name.startswith("_")}
    missing = {name for name in names - twin._plain - SYNC_ONLY if not hasattr(twin, name)}
    assert not missing


def test_it_works(daemon):
    async def main():
        d = await aio.connect(daemon.url, token=daemon.token)
        volume = await d.add(np.tri(24, dtype="u1")[None].repeat(24, 0) * 255, name="wedge")
        assert volume.shape == (24, 24, 24)
        view = volume.view(size=(32, 24)).with_camera(azimuth=30)
        first, second = await asyncio.gather(view.render(), view.with_camera(azimuth=60).render())
        assert first != second
        assert (await view.angles())["azimuth"] == 30
        with pytest.raises(splatd.errors.InvalidRequest):
            await view.patch({"size": [0, 0]}).render()
        async with await d.share(view) as session, await session.stream(format="png") as stream:
            seq = await stream.update({"camera": {"azimuth": 60}})
            async for frame in stream:
                if frame.is_final and frame.seq == seq:
                    break
            assert np.array_equal(frame.image, second)
        job = await d.render_path(splatd.Path(fps=2).key(0, view.sync).key(1, view.sync.with_camera(azimuth=60)))
        assert [image.shape async for image in job] == [(24, 32, 4)] * 3
        await job.cancel()
        await volume.close()

    asyncio.run(main())


def test_a_cancelled_task_deletes_its_path(daemon):
    async def main():
        d = await aio.connect(daemon.url, token=daemon.token)
        view = (await d.load("demo:engine")).view(size=(512, 512))
        job = await d.render_path(splatd.Path(fps=30).key(0, view.sync).key(60, view.sync.with_camera(azimuth=90)))
        begun = asyncio.Event()

        async def watch():
            async for _ in job.progress():
                begun.set()

        task = asyncio.create_task(watch())
        await begun.wait()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert job.id not in [other.id for other in daemon.jobs()]

    asyncio.run(main())


def test_requests_are_coroutines():
    assert inspect.iscoroutinefunction(aio.Volume.histogram)
    assert not inspect.iscoroutinefunction(aio.View.with_camera)
