# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # A movie
# A camera path has keyframes; the daemon draws the frames between them, also while no program waits.

# %%
import os
import sys

import splatd

daemon = splatd.connect() if "SPLATD_URL" in os.environ else splatd.start()
volume = daemon.upload(sys.argv[1]) if len(sys.argv) > 1 else daemon.load("demo:engine")

# %% Once around, then closer, while a plane opens the object.
view = volume.view(size=(320, 240)).with_camera(azimuth=0, elevation=20)
distance = view.angles()["distance"]
opened = view.with_camera(azimuth=360, distance=0.6 * distance).with_clip(box=((0, 0, 0), (1, 1, 0.6)))
path = (
    splatd.Path(fps=6).key(0, view).key(2, view.with_camera(azimuth=360), ease="smooth").key(3, opened, ease="smooth")
)

# %% An interrupt deletes the path in the daemon.
job = daemon.render_path(path, format="webm", quality=80)
for done, total in job.progress():
    print(f"\r{done} of {total} frames", end="", flush=True)
print()
print(job.save("movie.webm"))

# %%
daemon.close()
