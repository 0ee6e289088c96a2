# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # A view for several people
# One person's change is everyone's image. Links open the page in any browser.

# %%
import os

import splatd

daemon = splatd.connect() if "SPLATD_URL" in os.environ else splatd.start()
volume = daemon.load("demo:engine")
session = volume.view(size=(320, 240)).share()
print("to watch:  ", session.link("view"))
print("to control:", session.link("control"))

# %% A colleague joins, here as a script, and sees each change.
guest = splatd.connect(daemon.url, token=session.link("view").rsplit("token=", 1)[1])
with guest.session(session.id).stream(name="Ada") as stream:
    first = stream.wait()
    session.change(camera={"azimuth": 60})
    second = stream.wait()
    while second.image == first.image:
        second = stream.wait()
    print([person["name"] for person in session.participants])
    second.image.save("share.jpg")

# %% Measurements belong to all.
session.measures.add("distance", [(0, 45, 45), (159, 45, 45)], text="length")
print(session.measures.csv())

# %%
session.delete()
daemon.close()
