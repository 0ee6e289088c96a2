# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # A CT and its presets
# A preset is a transfer function for a kind of data. It finds Hounsfield units in the values, also if the file does not
# name them.

# %%
import os
import sys

import numpy as np
import PIL.Image

import splatd

scan = sys.argv[1] if len(sys.argv) > 1 else None
daemon = splatd.connect() if "SPLATD_URL" in os.environ else splatd.start()

# %% [markdown]
# Without a scan of your own, this makes a chest in Hounsfield units: fat and muscle, two lungs with vessels, a spine.


# %%
def chest(n=96):
    z, y, x = np.mgrid[-1 : 1 : n * 1j, -1 : 1 : n * 1j, -1 : 1 : n * 1j]
    values = np.full(x.shape, -1000.0)

    def fill(distance, hounsfield):
        """Sets the inside, where the distance is below 1, with an edge of two samples."""
        inside = np.clip((1 - distance) * n / 4, 0, 1)
        values[...] = values * (1 - inside) + hounsfield * inside

    fill(np.sqrt((x / 0.95) ** 2 + (y / 0.65) ** 2 + (z / 1.5) ** 4), -90)
    fill(np.sqrt((x / 0.88) ** 2 + (y / 0.58) ** 2 + (z / 1.5) ** 4), 45)
    for side in (-1, 1):
        fill(np.sqrt(((x - 0.42 * side) / 0.34) ** 2 + ((y + 0.05) / 0.42) ** 2 + (z / 0.85) ** 2), -820)
        for turn in np.linspace(-0.9, 0.9, 5):
            away = np.hypot(y + 0.05 - 0.3 * turn * np.abs(x), z - 0.5 * turn * np.abs(x))
            fill(away / 0.07 + 100 * ((x * side < 0.08) | (x * side > 0.68)), 180)
    fill(np.hypot(x, y - 0.42) / (0.13 + 0.015 * np.cos(20 * z)), 700)
    return (values + np.random.default_rng(1).normal(0, 8, values.shape)).astype(np.int16)


volume = daemon.upload(scan) if scan else daemon.add(chest(), spacing=4, unit="mm", value_unit="HU", name="chest")
print(volume, volume.range, volume.value_unit)

# %%
view = volume.view(size=(320, 320)).with_camera(azimuth=30, elevation=15)
images = [view.with_transfer(preset=kind).render() for kind in ("CT bone", "CT soft", "CT lung", "CT vessels")]
row = PIL.Image.fromarray(np.hstack([np.asarray(image) for image in images]))
row.save("ct_presets.png")

# %%
daemon.close()
