# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # Thumbnails of a folder
# Every volume below a folder, several at a time. A file that cannot be read does not stop the others.

# %%
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import splatd

folder, out = (sys.argv[1:] + ["."] * 2)[:2]
out = Path(out)
out.mkdir(parents=True, exist_ok=True)
daemon = splatd.connect() if "SPLATD_URL" in os.environ else splatd.start(data=folder)


# %%
def found(path=""):
    """The volumes below a folder."""
    for entry in daemon.files(path):
        below = f"{path}/{entry['name']}" if path else entry["name"]
        if entry["kind"] == "folder":
            yield from found(below)
        else:
            yield below


def draw(path):
    """Draws one volume, and closes it, so that memory does not fill up."""
    try:
        volume = daemon.load(path)
    except splatd.Error as error:
        return f"{path}: {error}"
    try:
        volume.view(size=(128, 128)).render().save(out / f"{volume.id}.png")
    except splatd.Error as error:
        return f"{path}: {error}"
    finally:
        volume.close()
    return f"{path}: {volume.id}.png"


# %%
with ThreadPoolExecutor(4) as pool:
    for line in pool.map(draw, found()):
        print(line)

# %%
daemon.close()
