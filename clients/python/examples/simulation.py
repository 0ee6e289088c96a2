# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # A time series of a simulation
# xarray brings the coordinates, the units and the times. The daemon keeps the steps; a view shows one of them.

# %%
import os

import numpy as np
import xarray

import splatd

daemon = splatd.connect() if "SPLATD_URL" in os.environ else splatd.start()

# %% A warm bubble that rises and turns into a ring.
z, y, x = np.linspace(0, 2, 48), np.linspace(-1, 1, 40), np.linspace(-1, 1, 40)
hours = np.arange(6) * 0.5
grid = np.meshgrid(z, y, x, indexing="ij")


def temperature(hour):
    height, radius = 0.4 + 0.45 * hour, 0.15 * hour
    ring = np.sqrt((np.hypot(grid[1], grid[2]) - radius) ** 2 + (grid[0] - height) ** 2)
    return 280 + 25 * np.exp(-((ring / 0.3) ** 2))


field = xarray.DataArray(
    np.stack([temperature(hour) for hour in hours]).astype("f4"),
    dims=("time", "z", "y", "x"),
    coords={
        "time": ("time", hours, {"units": "h"}),
        "z": ("z", z, {"units": "km"}),
        "y": ("y", y, {"units": "km"}),
        "x": ("x", x, {"units": "km"}),
    },
    name="temperature",
    attrs={"units": "K"},
)

# %%
volume = field.splat.add(daemon)
print(volume, volume.unit, volume.value_unit, volume.info["steps"])
view = volume.view(size=(320, 320)).with_transfer("inferno", range=(282, 305), opacity=0.2)
view = view.with_camera(target=(0, 0, 1), distance=5)  # all of the domain, not only where the first step is warm
view.with_step(3).render().save("simulation.png")

# %% A movie: the time runs while the camera turns.
path = (
    splatd.Path(fps=5)
    .key(0, view.with_camera(azimuth=0).with_step(0))
    .key(2, view.with_camera(azimuth=60).with_step(5))
)
job = daemon.render_path(path, format="webm")
for done, total in job.progress():
    print(f"{done} of {total} frames")
print(job.save("simulation.webm"))

# %%
daemon.close()
