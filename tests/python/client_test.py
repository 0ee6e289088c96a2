# SPDX-License-Identifier: Apache-2.0
"""Views, images, reading volumes, presets, saved views, sessions, streams and camera paths against a real daemon."""

import copy
import gc
import io
import json
import tarfile
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import PIL.Image
import pytest

import splatd
from splatd import layers
from splatd.transfer import color_map, color_of


def test_images(demo, tmp_path):
    image = demo.view(size=(80, 60)).with_background("#336699").render()
    assert image.shape == (60, 80, 4)
    assert np.asarray(image).dtype == np.uint8
    assert list(image[0, 0]) == [0x33, 0x66, 0x99, 255]
    assert demo.view(size=(80, 60)).with_background(None).render()[0, 0, 3] == 0
    assert image.save(tmp_path / "a.png").read_bytes() == image.bytes
    with PIL.Image.open(image.save(tmp_path / "a.jpg")) as jpeg:
        assert jpeg.format == "JPEG"
    webp = demo.view(size=(80, 60)).render(format="webp")
    assert PIL.Image.open(io.BytesIO(webp.bytes)).format == "WEBP"
    assert webp._repr_png_()[:4] == b"\x89PNG"
    exr = demo.view(size=(80, 60)).render(format="exr")
    assert exr.save(tmp_path / "a.exr").read_bytes()[:4] == b"v/1\x01"
    with pytest.raises(ValueError, match="no extension"):
        image.save(tmp_path / "a")
    with pytest.raises(ValueError, match='format="exr"'):
        image.save(tmp_path / "b.exr")


def test_views_never_change(demo):
    view = demo.view()
    other = view.with_camera(azimuth=450, elevation=10).with_size(64, 48)
    assert view.document == {"volume": demo.id}
    assert other.document["camera"] == {"azimuth": 90, "elevation": 10}
    assert other.with_camera(azimuth=None).document["camera"]["azimuth"] is None
    assert other.full()["size"] == [64, 48]
    assert not [s for s in demo.daemon.sessions()]


def test_numbers_of_numpy(demo):
    view = demo.view().with_size(np.int64(40), np.int32(30)).with_camera(azimuth=np.float32(20))
    view = view.patch({"camera": {"fov_y": np.float32(25)}, "background": np.array([0, 0, 1, 1])})
    assert view.render().shape == (30, 40, 4)
    with view.share() as session, session.stream() as stream:
        stream.update({"camera": {"azimuth": np.int16(5)}}, wait=True)
    with pytest.raises(TypeError, match="object"):
        view.patch({"camera": {"fov_y": object()}}).render()
    with pytest.raises(ValueError, match="JSON"):
        view.patch({"camera": {"fov_y": float("nan")}}).render()


def test_copies_of_views(demo):
    view = demo.view()
    assert copy.deepcopy(view) is view
    assert copy.copy(view) is view


def test_many_threads(demo, caplog):
    view = demo.view(size=(8, 8))
    with ThreadPoolExecutor(40) as pool:
        images = list(pool.map(lambda angle: view.with_camera(azimuth=angle).render(), range(80)))
    assert len({image.bytes for image in images}) > 40
    assert not caplog.records


def test_rendering_does_not_change_a_view(demo):
    camera = {"camera": {"azimuth": np.float32(720)}}
    view = demo.view(size=(16, 16)).patch(camera)
    view.render()
    view.document["camera"]["azimuth"] = 5
    camera["camera"]["azimuth"] = 6
    assert view == demo.view(size=(16, 16)).with_camera(azimuth=720)
    path = splatd.Path().key(0, demo.view(size=(16, 16)).with_camera(azimuth=0)).key(1, view)
    assert len(path.document["keyframes"]) == 8


def test_background_of_snapshots(demo):
    with demo.view(size=(80, 60)).share() as session:
        assert list(session.snapshot(background="red")[0, 0]) == [255, 0, 0, 255]


def test_a_listener_that_fails(demo, caplog):
    with demo.view(size=(16, 16)).share() as session, session.stream() as stream:
        stream.listen(lambda method, params: 1 / 0)
        session.change(camera={"azimuth": 50})
        assert stream.call("ping") == {}
        session.change(camera={"azimuth": 60})
        assert stream.call("view.get")["view"]["size"] == [16, 16]


def test_a_stream_keeps_its_daemon():
    stream = splatd.start(backend="cpu").load("demo:engine?size=32").view(size=(8, 8)).share().stream()
    gc.collect()
    assert stream.call("ping") == {}
    stream.close()


def test_angles_and_positions(demo):
    placed = demo.view().with_camera(azimuth=20).with_camera(position=(300, 0, 0), target=(80, 45, 45))
    assert placed.document["camera"] == {"position": [300, 0, 0], "target": [80, 45, 45]}
    with pytest.raises(ValueError, match="exclude"):
        placed.with_camera(azimuth=10, position=(1, 2, 3))
    angles = {"azimuth": 70, "elevation": -20, "distance": 150, "roll": 12}
    by_angles = demo.view().with_camera(**angles)
    camera = by_angles.full()["camera"]
    by_place = demo.view().with_camera(**{name: camera[name] for name in ("position", "target", "up")})
    assert by_place.angles() == pytest.approx(angles)
    turned = by_place.with_camera(azimuth=80)
    assert turned.full()["camera"]["position"] == pytest.approx(
        by_angles.with_camera(azimuth=80).full()["camera"]["position"]
    )
    default = demo.view().full()["camera"]
    assert demo.view().with_camera(**demo.view().angles()).full()["camera"]["position"] == pytest.approx(
        default["position"]
    )
    above = demo.view().with_camera(elevation=90, azimuth=25).full()["camera"]
    assert demo.view().patch({"camera": above}).angles()["azimuth"] == pytest.approx(25)


def test_the_error_names_the_field(demo):
    with pytest.raises(splatd.errors.InvalidRequest) as caught:
        demo.view().patch({"camera": {"fov_y": 500}}).render()
    assert (caught.value.code, caught.value.pointer) == (422, "/camera/fov_y")


def test_transfer_functions(demo):
    points = (
        demo.view()
        .with_transfer([(0, 0), (100, 0.1, "#c88"), (235, 0.9, "white")])
        .full()["transfer_function"]["points"]
    )
    assert [point["value"] for point in points] == [0, 100, 235]
    assert points[0]["color"] == points[1]["color"]
    window = demo.view().with_transfer(window=(40, 400)).full()["transfer_function"]["points"]
    assert [point["value"] for point in window] == [-160, 240]
    viridis = demo.view().with_transfer("viridis", opacity=[(0, 0), (235, 0.4)]).full()["transfer_function"]["points"]
    assert (viridis[0]["value"], viridis[-1]["value"]) == demo.range
    assert viridis[-1]["color"] == color_of("#fde725")
    with pytest.raises(ValueError, match="rise strictly"):
        demo.view().with_transfer([(1, 0), (1, 0.5)])
    with pytest.raises(ValueError, match="one of points"):
        demo.view().with_transfer("viridis", window=(1, 2))


def test_matplotlib_maps(demo):
    matplotlib = pytest.importorskip("matplotlib")
    assert np.allclose(color_map("magma")[0], matplotlib.colormaps["magma"](0.0)[:3], atol=1e-5)
    image = demo.view(size=(64, 64)).with_transfer(matplotlib.colormaps["hot"], range=(50, 200)).render()
    assert image[..., :3].max() > 0


def test_presets_by_kind(demo):
    for kind in ("CT bone", "ct_soft", "CT lung", "CT vessels", "MR", "microscopy", "simulation"):
        assert demo.view(size=(32, 32)).with_transfer(preset=kind).render().shape == (32, 32, 4)


def test_stored_presets(daemon, demo):
    daemon.presets["mine"] = demo.view().with_transfer(window=(100, 50))
    assert list(daemon.presets) == ["mine"]
    view = demo.view().with_transfer(preset="mine")
    assert view.document["transfer_function"]["points"][0]["value"] == 75
    del daemon.presets["mine"]
    with pytest.raises(KeyError, match="mine"):
        daemon.presets["mine"]


def test_layers(demo, ball, daemon):
    inner = daemon.add(ball, name="inner")
    view = daemon.volume(inner.id).view(size=(64, 64)).with_layers(layers.surface(100, color="red", opacity=1))
    assert view.render()[32, 32, 0] > 2 * view.render()[32, 32, 1]
    both = demo.view().with_layers(layers.volume(), layers.shell(detail="fast"))
    assert [layer["type"] for layer in both.full()["layers"]] == ["volume", "shell"]


def test_clip_and_shading(demo):
    view = demo.view(size=(64, 64)).with_clip(planes=[((1, 0, 0), 80)], box=((0, 0, 0), (1, 1, 0.5)))
    full = view.with_shading(occlusion=0.5).with_compositing(mode="maximum").with_filter(mode="ewa").with_step(0).full()
    assert full["clip"] == {"box": [[0, 0, 0], [1, 1, 0.5]], "planes": [{"normal": [1, 0, 0], "offset": 80}]}
    assert (full["shading"]["occlusion"], full["compositing"]["mode"], full["filter"]["mode"]) == (
        0.5,
        "maximum",
        "ewa",
    )


def test_reading_a_volume(daemon, ball):
    volume = daemon.add(ball, spacing=(2, 1, 1), unit="mm")
    histogram = volume.histogram(bins=64)
    assert histogram.counts.sum() == ball.size
    assert histogram.edges.shape == (65,)
    joint = volume.histogram(gradient=True)
    assert joint.counts.shape == (joint.gradient_edges.size - 1, joint.edges.size - 1)
    with pytest.raises(ValueError, match="divisor"):
        volume.histogram(bins=100)
    for axis, number in (("z", 0), ("y", 1), ("x", 2)):
        np.testing.assert_array_equal(volume.slice(axis, index=20).array, np.take(ball, 20, number))
    np.testing.assert_array_equal(volume.slice("z", position=40).array, ball[20])
    np.testing.assert_array_equal(volume.slice("z", index=-1).array, ball[-1])
    with pytest.raises(IndexError, match="32 samples"):
        volume.slice("z", index=32)
    oblique = volume.slice(normal=(0, 0, 1), size=(20, 10))
    assert oblique.array.shape == (10, 20)
    assert oblique.array.max() == 200
    assert volume.slice_image("z", 16, window=(100, 200)).shape == (32, 32, 4)
    assert volume.measure("distance", [(0, 0, 0), (0, 0, 10)]) | {"value": 10, "unit": "mm"} == volume.measure(
        "distance", [(0, 0, 0), (0, 0, 10)]
    )
    part = volume.measure("part", [(15.5, 15.5, 31)], range=[100, 255])
    assert abs(part["value"] / (4 / 3 * np.pi * 1000 * 2) - 1) < 0.05


def test_files_and_uploads(daemon, ball, tmp_path):
    header = {"dims": [32, 32, 32], "type": "uint8", "file": "ball.raw"}
    for folder in (daemon.data_folder, tmp_path):
        (folder / "ball.json").write_text(json.dumps(header))
        (folder / "ball.raw").write_bytes(ball.tobytes())
    assert [entry["name"] for entry in daemon.files()] == ["ball.json"]
    assert [entry["name"] for entry in daemon.files(find="BALL")] == ["ball.json"]
    told = []
    here = daemon.load("ball.json", id="here", progress=told.append)
    sent = daemon.upload(tmp_path / "ball.json", tmp_path / "ball.raw", id="sent", progress=told.append)
    assert told[-1] == 1
    for volume in (here, sent):
        np.testing.assert_array_equal(volume.slice("y", index=7).array, ball[:, 7])
    with pytest.raises(splatd.errors.NotFound):
        daemon.load("nothing.nrrd")
    (tmp_path / "bad.nrrd").write_bytes(b"NRRD0004\ntype: nonsense\n\n")
    with pytest.raises(splatd.errors.LoadFailed, match=r"bad\.nrrd: byte 25"):
        daemon.upload(tmp_path / "bad.nrrd")
    here.close()
    sent.close()
    with pytest.raises(splatd.errors.NotFound):
        here.refresh()


def test_saved_views(daemon, demo):
    view = demo.view(size=(40, 30)).with_camera(azimuth=10)
    saved = daemon.save(view, name="first")
    assert daemon.save(view).id == saved.id
    assert [entry.id for entry in daemon.saved_views()] == [saved.id]
    assert saved.view().render() == view.render()
    assert saved.url.startswith("http://127.0.0.1")
    with daemon.share(saved) as session:
        assert session.document["size"] == [40, 30]
    saved.delete()
    assert not list(daemon.saved_views())


def test_sessions(daemon, demo):
    with demo.view(size=(64, 48)).share() as session:
        guest = splatd.connect(daemon.url, token=session.link("view").rsplit("token=", 1)[1])
        assert session.change(camera={"azimuth": 40})["size"] == [64, 48]
        assert session.snapshot(size=(32, 24)).shape == (24, 32, 4)
        measure = session.measures.add("distance", [(0, 0, 0), (3, 4, 0)], text="across")
        assert session.measures[measure["id"]]["value"] == 5
        session.measures.change(measure["id"], text="wide")
        assert "wide" in session.measures.csv()
        session.measures.remove(measure["id"])
        assert len(session.measures) == 0
        watched = splatd.Session(guest, {"id": session.id})
        assert watched.document["camera"] == session.document["camera"]
        with pytest.raises(splatd.errors.Unauthorized):
            watched.change(camera={"azimuth": 0})
        with pytest.raises(splatd.errors.Unauthorized):
            watched.link()
        with session.fork() as fork:
            assert fork.document == session.document
        session.show(demo.view(size=(64, 48)).with_camera(azimuth=90))
        assert session.view.render().shape == (48, 64, 4)
    with pytest.raises(splatd.errors.NotFound):
        session.refresh()


def test_streams(demo):
    view = demo.view(size=(64, 48))
    with view.share() as session, session.stream(format="png", name="script") as stream:
        assert stream.settings["format"] == "png"
        first = stream.wait()
        assert np.array_equal(first.image, view.render())
        seqs = [stream.update({"camera": {"azimuth": azimuth}}) for azimuth in (10, 20, 30)]
        last = stream.wait(seqs[-1])
        assert np.array_equal(last.image, view.with_camera(azimuth=30).render())
        assert stream.pick(32, 24)["opacity"] > 0
        with pytest.raises(splatd.errors.InvalidRequest) as caught:
            stream.update({"camera": {"fov_y": 500}}, wait=True)
        assert caught.value.pointer == "/camera/fov_y"
        with pytest.raises(splatd.errors.InvalidRequest, match="camra"):
            stream.wait(stream.update({"camra": {}}))
        assert session.participants[0]["name"] == "script"
    with pytest.raises(splatd.errors.ConnectionFailed):
        stream.call("ping")
    with pytest.raises(splatd.errors.NotFound):
        session.stream()


def test_a_slow_consumer_gets_the_newest_frames(demo):
    with demo.view(size=(64, 48)).share() as session, session.stream() as stream:
        stream.wait()
        seqs = [stream.update({"camera": {"azimuth": azimuth % 360}}, wait=True) for azimuth in range(50)]
        frames = []
        while not frames or frames[-1].seq < seqs[-1]:
            frames.append(stream.wait(is_final=False))
        assert len(frames) < len(seqs)


def test_several_threads_change_one_stream(demo):
    with demo.view(size=(16, 16)).share() as session, session.stream() as stream:

        def turn(begin):
            for azimuth in range(begin, begin + 10):
                stream.update({"camera": {"azimuth": azimuth}}, wait=True)

        threads = [threading.Thread(target=turn, args=(begin,)) for begin in (0, 100, 200)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert stream.wait(30).seq == 30


def test_the_stream_ends_with_its_session(demo):
    session = demo.view(size=(16, 16)).share()
    with session.stream() as stream:
        session.delete()
        for _ in stream:
            pass


def test_camera_paths(daemon, demo, tmp_path):
    view = demo.view(size=(48, 32))
    path = (
        splatd.Path(fps=8)
        .key(0, view.with_camera(azimuth=0))
        .key(1, view.with_camera(azimuth=360))
        .key(1.5, view.with_camera(azimuth=360, fov_y=10))
    )
    assert path.frames == 13
    job = daemon.render_path(path)
    steps = list(job.progress())
    assert steps[-1] == (13, 13)
    assert [done for done, _ in steps] == sorted({done for done, _ in steps})
    # A full turn passes the back, and ends where it began.
    assert np.array_equal(job.frame(0), job.frame(8))
    back = view.with_camera(azimuth=180).render()
    assert np.abs(job.frame(4).array.astype(int) - back.array).mean() < 1
    folder = job.save(tmp_path / "frames")
    assert sorted(file.name for file in folder.iterdir()) == [f"{k:06}.png" for k in range(13)]
    with tarfile.open(job.save(tmp_path / "frames.tar")) as archive:
        assert archive.getnames() == [f"{k:06}.png" for k in range(13)]
    with pytest.raises(ValueError, match="folder"):
        job.save(tmp_path / "frames.webm")
    assert [other.id for other in daemon.jobs()] == [job.id]
    job.cancel()
    assert not list(daemon.jobs())


def test_movies(daemon, demo, tmp_path):
    view = demo.view(size=(48, 32))
    job = daemon.render_path(
        splatd.Path(fps=4).key(0, view).key(1, view.with_camera(azimuth=90), ease="smooth"), format="webm"
    )
    assert job.save(tmp_path / "turn.webm").read_bytes()[:4] == b"\x1aE\xdf\xa3"
    job.cancel()


def test_an_interrupt_deletes_the_path(daemon, demo):
    view = demo.view(size=(512, 512))
    job = daemon.render_path(splatd.Path(fps=30).key(0, view).key(60, view.with_camera(azimuth=90)))
    progress = job.progress()
    next(progress)
    with pytest.raises(KeyboardInterrupt):
        progress.throw(KeyboardInterrupt)
    assert not list(daemon.jobs())


def test_an_error_beside_a_path_deletes_it(daemon, demo):
    view = demo.view(size=(512, 512))
    path = splatd.Path(fps=30).key(0, view).key(60, view.with_camera(azimuth=90))
    with pytest.raises(KeyboardInterrupt), daemon.render_path(path) as job:
        raise KeyboardInterrupt
    assert job.id not in [other.id for other in daemon.jobs()]


def test_wrong_paths(demo, daemon):
    view = demo.view()
    with pytest.raises(ValueError, match="first keyframe"):
        splatd.Path().key(1, view)
    with pytest.raises(ValueError, match="rise"):
        splatd.Path().key(0, view).key(0, view)
    with pytest.raises(ValueError, match="two keyframes"):
        daemon.render_path(splatd.Path().key(0, view))
    with pytest.raises(ValueError, match="one size"):
        daemon.render_path(splatd.Path().key(0, view).key(1, view.with_size(9, 9)))


def test_closing_ends_the_daemon():
    with splatd.start(backend="null") as daemon:
        process = daemon.process
        assert process.is_running
    assert not process.is_running
    with pytest.raises(splatd.errors.ConnectionFailed, match="does not answer"):
        daemon.volumes()


def test_a_forgotten_daemon_ends():
    daemon = splatd.start(backend="null")
    child = daemon.process._child
    del daemon
    gc.collect()
    assert child.poll() is not None
