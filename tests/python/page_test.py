# SPDX-License-Identifier: Apache-2.0
"""What the package has in common with the page is the same: presets by kind of data, colour maps, types of the view."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import splatd
from splatd import presets, transfer

ROOT = Path(splatd.__file__).parents[4]
CORE = ROOT / "clients/web/core"

SCRIPT = """
import { presetOf, KINDS } from '%s/tissue.js';
import { MAP_NAMES, tableOf, stopsOf, colorOfStops } from '%s/color_maps.js';
import { opacityAt } from '%s/transfer.js';
const input = JSON.parse(process.argv[1]);
const presets = input.map(({ range, counts, unit, meaning }) => Object.fromEntries(KINDS.map((kind) => {
  const { points, map } = presetOf(kind, { range, counts }, unit, meaning);
  return [kind, { points, map, opacity: points.map((p) => opacityAt(points, p.value)) }];
})));
const maps = Object.fromEntries(MAP_NAMES.map((name) => [name, tableOf(name).map(([, color]) => color)]));
console.log(JSON.stringify({ presets, maps }));
"""


def histograms():
    """Histograms of a CT, of one with an offset, of bytes, of a constant background, and of few values."""
    random = np.random.default_rng(7)
    air, tissue, bone = random.normal(-1000, 20, 40000), random.normal(40, 60, 30000), random.uniform(200, 1600, 4000)
    ct = np.concatenate([air, tissue, bone])
    bytes_ = np.clip(random.gamma(2, 12, 50000), 0, 255)
    plain = np.concatenate([np.zeros(60000), random.uniform(0, 5, 30000)])
    for values, unit, meaning in (
        (ct, "HU", ""),
        (ct, "", ""),
        (ct, "K", ""),
        (np.clip(ct, -1000, None) + 1024, "", ""),
        (bytes_, "", ""),
        (plain, "m/s", ""),
        (np.array([0, 0, 0, 1, 1, 2.0]), "", "labels"),
    ):
        low, high = float(values.min()), float(values.max())
        yield {
            "range": [low, high],
            "counts": np.histogram(values, 256, (low, high))[0].tolist(),
            "unit": unit,
            "meaning": meaning,
        }


@pytest.fixture(scope="module")
def page():
    node = shutil.which("node")
    if not node:
        pytest.skip("node is not installed")
    script = SCRIPT % ((CORE.as_uri(),) * 3)
    given = json.dumps(list(histograms()))
    return json.loads(subprocess.check_output([node, "--input-type=module", "-e", script, given]))


def test_presets(page):
    for number, histogram in enumerate(histograms()):
        for kind in presets.KINDS:
            theirs = page["presets"][number][kind]
            ours = presets.preset_points(
                kind, *histogram["range"], np.array(histogram["counts"]), histogram["unit"], histogram["meaning"]
            )
            values = [point["value"] for point in ours]
            for point in theirs["points"]:
                opacity = np.interp(point["value"], values, [one["opacity"] for one in ours])
                assert opacity == pytest.approx(point["opacity"], abs=1e-6), (number, kind)
                if theirs["map"] is None:
                    color = [np.interp(point["value"], values, [one["color"][k] for one in ours]) for k in range(3)]
                    assert color == pytest.approx(point["color"], abs=1e-5), (number, kind)


def test_color_maps(page):
    for name, colors in page["maps"].items():
        assert np.allclose(transfer.color_map(name), colors, atol=1e-5), name


def test_types_follow_the_schema():
    subprocess.run([sys.executable, ROOT / "clients/python/generate_types.py", "--check"], check=True)


def test_versions_agree():
    text = (ROOT / "renderer/include/sp/version.h").read_text()
    numbers = [re.search(rf"SP_VERSION_{part} (\d+)", text)[1] for part in ("MAJOR", "MINOR", "PATCH")]
    assert ".".join(numbers) == splatd.__version__
    assert f'version = "{splatd.__version__}"' in (ROOT / "clients/python/pyproject.toml").read_text()
