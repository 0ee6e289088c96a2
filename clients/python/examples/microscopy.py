# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # Channels of a microscope
# An OME-Zarr has its channels side by side. Each becomes a volume, and the view mixes them, each in its own colour.

# %%
import json
import os
import tempfile
from pathlib import Path

import numpy as np
import zarr

import splatd
from splatd import layers

folder = Path(tempfile.mkdtemp())
daemon = splatd.connect() if "SPLATD_URL" in os.environ else splatd.start(data=folder)

# %% An OME-Zarr with nuclei and the tissue around them.
random = np.random.default_rng(5)
shape = (40, 64, 64)
place = np.stack(np.indices(shape), -1)
centers = random.uniform((8, 8, 8), (32, 56, 56), (12, 3))
nearest = np.min([np.linalg.norm(place - center, axis=-1) for center in centers], axis=0)
nuclei = 220 * np.clip((6 - nearest) / 2, 0, 1)
tissue = 150 * np.exp(-(((nearest - 10) / 3) ** 2))
image = np.stack([nuclei, tissue]).astype("u1")
group = zarr.open_group(folder / "cells.zarr", mode="w", zarr_format=2)
group.create_array("0", shape=image.shape, chunks=(1, 20, 32, 32), dtype="u1")[...] = image
axes = [{"name": "c", "type": "channel"}] + [{"name": n, "type": "space", "unit": "micrometer"} for n in "zyx"]
scale = [{"type": "scale", "scale": [1, 0.5, 0.25, 0.25]}]
group.attrs["multiscales"] = [
    {"version": "0.4", "axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scale}]}
]
group.attrs["omero"] = {"channels": [{"label": "nuclei", "color": "00FFFF"}, {"label": "tissue", "color": "FF00FF"}]}

# %%
first = daemon.load("cells.zarr")
others = [daemon.load(f"cells.zarr?field={name}") for name in first.info["other_fields"]]
print(first, first.info["fields"][0]["name"], json.dumps([other.name for other in others]))
view = first.view(size=(320, 320)).with_transfer([(40, 0, "black"), (220, 0.4, "cyan")])
haze = [(20, 0, "black"), (150, 0.02, "magenta")]
view = view.with_layers(layers.volume(), *(layers.channel(other, points=haze) for other in others))
view.render().save("microscopy.png")

# %%
daemon.close()
