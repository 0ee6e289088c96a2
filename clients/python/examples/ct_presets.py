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
# Without a scan of your own, this makes one: a skull, a brain and air, in Hounsfield units.


# %%
def phantom(n=96):
    z, y, x = np.mgrid[-1 : 1 : n * 1j, -1 : 1 : n * 1j, -1 : 1 : n * 1j]
    r = np.sqrt(x**2 + (y / 0.85) ** 2 + z**2)
    values = np.full(r.shape, -1000.0)
    for radius, hounsfield in ((0.9, 50), (0.85, 900), (0.75, 35)):
        values[r < radius] = hounsfield
    values += np.random.default_rng(1).normal(0, 8, values.shape)
    return values.astype(np.int16)


volume = daemon.upload(scan) if scan else daemon.add(phantom(), spacing=2, unit="mm", value_unit="HU", name="phantom")
print(volume, volume.range, volume.value_unit)

# %%
view = volume.view(size=(320, 320)).with_camera(azimuth=30, elevation=15)
images = [view.with_transfer(preset=kind).render() for kind in ("CT bone", "CT soft", "CT lung", "CT vessels")]
row = PIL.Image.fromarray(np.hstack([np.asarray(image) for image in images]))
row.save("ct_presets.png")

# %%
daemon.close()
