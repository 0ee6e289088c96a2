# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # A daemon next to the data
# On the machine with the data:
#
#     splatd --data /scans
#
# It prints its address with a token. On this computer:
#
#     ssh -L 8080:127.0.0.1:8080 machine
#     export SPLATD_URL=http://127.0.0.1:8080 SPLATD_TOKEN=...
#
# Only images travel.

# %%
import splatd

daemon = splatd.connect()
print(daemon, daemon.version, daemon.status["backend"])

# %%
for entry in daemon.files():
    print(entry["kind"], entry["name"], entry.get("dims", ""))

# %%
volume = daemon.load("demo:engine")
volume.view(size=(320, 240)).render(format="webp").save("remote.webp")
