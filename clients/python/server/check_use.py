# SPDX-License-Identifier: Apache-2.0
"""Uses the installed wheels: renders, and reads files with each module of the importer. Usage: check_use.py IMAGE"""

import os
import struct
import sys
import tempfile

import numpy as np
import splatd_server

import splatd

STL = (
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 9 0 0\nvertex 0 9 5\nendloop\nendfacet\nendsolid a\n"
)


def netcdf():
    """A classic NetCDF file with one array 4 × 4 × 4 of bytes."""

    def name(text):
        return struct.pack(">i", len(text)) + text.encode() + b"\0" * (-len(text) % 4)

    sizes = struct.pack(">ii", 10, 3) + b"".join(name(n) + struct.pack(">i", 4) for n in "zyx")
    head = b"CDF\1" + bytes(4) + sizes + bytes(8) + struct.pack(">ii", 11, 1)
    head += name("v") + struct.pack(">iiii", 3, 0, 1, 2) + bytes(8) + struct.pack(">ii", 1, 64)
    return head + struct.pack(">i", len(head) + 4) + bytes(range(64))


def tiff():
    """A TIFF with two pages 4 × 4 of bytes."""
    data, pages = b"II*\0" + struct.pack("<I", 8), 2
    for page in range(pages):
        at = len(data)
        tags = [
            (256, 4),
            (257, 4),
            (258, 8),
            (259, 1),
            (262, 1),
            (273, at + 2 + 9 * 12 + 4),
            (277, 1),
            (278, 4),
            (279, 16),
        ]
        after = 0 if page == pages - 1 else at + 2 + 9 * 12 + 4 + 16
        data += struct.pack("<H", 9) + b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
        data += struct.pack("<I", after) + bytes(range(16))
    return data


def main():
    folder = tempfile.mkdtemp()
    nrrd = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\n" + bytes(range(64))
    for file, content in (("a.nrrd", nrrd), ("a.stl", STL.encode()), ("a.nc", netcdf()), ("a.tif", tiff())):
        with open(os.path.join(folder, file), "wb") as output:
            output.write(content)
    with splatd.start(data=folder, backend="cpu") as daemon:
        daemon.load("demo:engine").view().render().save(sys.argv[1])
        for file in ("a.nrrd", "a.stl", "a.nc", "a.tif"):
            print(file, daemon.load(file).view(size=(64, 64)).render().array.shape)
        array = daemon.add(np.random.default_rng(1).random((16, 16, 16), dtype="f4"))
        view = array.view(size=(64, 64))
        print("array", view.render().array.shape)
        try:
            view.render(format="exr")
            sys.exit("an EXR was rendered without its module")
        except splatd.Error as error:
            print("exr:", error)
    # DICOM, HDF5 and Zarr: the modules load with all their libraries.
    import ctypes

    for module in sorted((splatd_server.folder().parent / "lib/splatd").glob("*.so")):
        ctypes.CDLL(str(module))
        print(module.name, "loads")


main()
