# SPDX-License-Identifier: Apache-2.0
"""Each example runs, and writes what it says."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

import splatd

EXAMPLES = Path(splatd.__file__).parents[2] / "examples"
WRITES = {
    "ct_presets": ["ct_presets.png"],
    "simulation": ["simulation.png", "simulation.webm"],
    "microscopy": ["microscopy.png"],
    "movie": ["movie.webm"],
    "share": ["share.jpg"],
    "remote": ["remote.webp"],
}


def run(name, folder, *arguments, **environment):
    """Runs an example in a folder, and returns what it prints."""
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": str(EXAMPLES.parent / "src"), **environment}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", WRITES)
def test_example(name, daemon, tmp_path):
    if name == "microscopy":
        pytest.importorskip("zarr")
        run(name, tmp_path)
    else:
        run(name, tmp_path, SPLATD_URL=daemon.url, SPLATD_TOKEN=daemon.token)
    for file in WRITES[name]:
        path = tmp_path / file
        if path.suffix == ".webm":
            assert path.read_bytes()[:4] == b"\x1aE\xdf\xa3"
            continue
        with PIL.Image.open(path) as image:
            pixels = np.asarray(image.convert("RGB"))
        assert len(np.unique(pixels)) > 32, f"{file} shows nothing"


def test_colours_of_channels(tmp_path):
    pytest.importorskip("zarr")
    run("microscopy", tmp_path)
    with PIL.Image.open(tmp_path / "microscopy.png") as image:
        red, green, blue = np.moveaxis(np.asarray(image.convert("RGB")).astype(int), 2, 0)
    assert ((green > red + 40) & (blue > red + 40)).any(), "no cyan nuclei"
    assert ((red > green + 40) & (blue > green + 40)).any(), "no magenta tissue"


def test_thumbnails(tmp_path):
    (tmp_path / "data/deep").mkdir(parents=True)
    for number in range(3):
        samples = np.full((8, 8, 8), number, "u1")
        samples[2:6, 2:6, 2:6] = 200
        header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n"
        (tmp_path / f"data/deep/v{number}.nrrd").write_bytes(header.encode() + samples.tobytes())
    (tmp_path / "data/broken.nrrd").write_bytes(b"NRRD0004\n\n")
    printed = run("thumbnails", tmp_path, tmp_path / "data", tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["v0.png", "v1.png", "v2.png"]
    assert "broken.nrrd: " in printed


def test_notebooks(tmp_path):
    subprocess.run([sys.executable, EXAMPLES / "notebooks.py", tmp_path], check=True)
    assert {path.stem for path in tmp_path.iterdir()} == {*WRITES, "thumbnails"}
    for path in tmp_path.iterdir():
        cells = json.loads(path.read_text())["cells"]
        assert cells[0]["cell_type"] == "markdown"
        for number, cell in enumerate(cells):
            if cell["cell_type"] == "code":
                compile("".join(cell["source"]), f"{path.name}[{number}]", "exec")
