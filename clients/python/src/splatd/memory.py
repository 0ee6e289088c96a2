# SPDX-License-Identifier: Apache-2.0
"""Arrays in memory that a daemon on this computer maps, so that nothing is sent (server/http/UNIX.md). Linux only."""

from __future__ import annotations

import array
import ctypes
import fcntl
import json
import mmap
import os
import socket
import struct
from typing import Any, cast

import numpy as np

from . import errors

MAGIC = b"\0SPLMEM\x01"
SEALS = 0x0002 | 0x0008  # F_SEAL_SHRINK | F_SEAL_WRITE: the daemon reads what can neither shrink nor change
MAP_PRIVATE, MAP_FIXED = 0x02, 0x10
PROT_READ_WRITE = 0x3
ANSWER_SECONDS = 30.0
ANSWER_BYTES_MAX = 65536
WRITE_BYTES = 64 << 20
#: Types that the daemon keeps as they are.
TYPES = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")


class Region(mmap.mmap):
    """Shared memory of an array until the daemon has it; afterwards the array's own, copied page by page on writing."""

    descriptor = -1  # of the memory; -1 once it was passed

    @classmethod
    def create(cls, size: int) -> Region:
        """Memory of `size` bytes, which are 0."""
        descriptor = os.memfd_create("splatd-array", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.ftruncate(descriptor, size)
            region = cls(descriptor, size)
        except BaseException:
            os.close(descriptor)
            raise
        region.descriptor = descriptor
        return region

    def forget(self) -> None:
        """Closes the descriptor; the memory stays."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1

    def __del__(self) -> None:
        self.forget()


def empty(shape: Any, dtype: Any = np.float32) -> np.ndarray:
    """An array of zeros that `Daemon.add` gives to a daemon on this computer without a copy.

    The volume shows the array as it is at `add`. Writing to it afterwards is allowed, and does not change the volume:
    add it again to show it.

    Parameters
    ----------
    shape : tuple of int
        Samples along z, y, x.
    dtype
        uint8, int8, uint16, int16, int32, float32 or float64; other types are copied by `add`.

    Examples
    --------
    >>> samples = splatd.empty((16, 32, 32), "u1")
    >>> samples[4:12, 8:24, 8:24] = 200
    >>> daemon.add(samples).range
    (0, 200)
    """
    kind = np.dtype(dtype)
    count = int(np.prod(shape, dtype=np.int64))
    if not count or kind.hasobject:
        return np.zeros(shape, kind)
    return np.frombuffer(Region.create(count * kind.itemsize), kind).reshape(shape)


def region_of(samples: np.ndarray) -> Region | None:
    """The region whose bytes the array has, all and in their order; None for other arrays."""
    root: Any = samples
    while isinstance(root, np.ndarray) and root.base is not None:
        root = root.base
    root = root.obj if isinstance(root, memoryview) else root
    if not isinstance(root, Region) or root.descriptor < 0:
        return None
    is_whole = samples.nbytes == len(root) and samples.flags.c_contiguous and samples.flags.writeable
    is_whole = is_whole and samples.dtype.isnative
    return root if is_whole else None


def copied(samples: np.ndarray) -> int:
    """The descriptor, for the caller to close, of memory with a copy of the samples in this computer's byte order."""
    descriptor = os.memfd_create("splatd-array", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        if samples.dtype.isnative:
            # Writing takes half the time of a copy into a mapping, whose pages would be made one by one.
            data, offset = memoryview(cast(Any, samples.view(np.uint8).reshape(-1))), 0
            while offset < data.nbytes:
                offset += os.pwrite(descriptor, data[offset : offset + WRITE_BYTES], offset)
        else:
            os.ftruncate(descriptor, samples.nbytes)
            with mmap.mmap(descriptor, samples.nbytes) as mapped:
                np.copyto(np.frombuffer(mapped, samples.dtype.newbyteorder("=")).reshape(samples.shape), samples)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def detach(region: Region, samples: np.ndarray) -> None:
    """Maps the memory privately at the same address: the array stays as it is, and its memory can be sealed."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    address = samples.ctypes.data
    mapped = libc.mmap(address, len(region), PROT_READ_WRITE, MAP_PRIVATE | MAP_FIXED, region.descriptor, 0)
    if mapped != address:
        raise OSError(ctypes.get_errno(), "the array cannot be mapped again")


def passed(path: str, token: str, descriptor: int) -> str:
    """Gives the memory to the daemon at this socket, and returns the id under which it can be loaded once.

    Raises
    ------
    Error
        The daemon refuses it; the text says why.
    ConnectionFailed
    """
    size = os.fstat(descriptor).st_size
    fcntl.fcntl(descriptor, getattr(fcntl, "F_ADD_SEALS", 1033), SEALS)
    hello = MAGIC + struct.pack("<QI", size, len(token)) + token.encode()
    try:
        with socket.socket(socket.AF_UNIX) as link:
            link.settimeout(ANSWER_SECONDS)
            link.connect(path)
            link.sendmsg([hello], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [descriptor]))])
            text = b""
            while len(text) < ANSWER_BYTES_MAX and (part := link.recv(4096)):
                text += part
        answer = json.loads(text)
    except (OSError, ValueError) as error:
        raise errors.ConnectionFailed(f"{path}: the daemon does not take the memory: {error}") from error
    if "memory" not in answer:
        raise errors.of_status(answer.get("status", 0), answer.get("detail", "the daemon does not take the memory"))
    return answer["memory"]


def give(path: str, token: str, samples: np.ndarray) -> str:
    """Gives an array of one of `TYPES` to the daemon, and returns the id for `POST /volumes`."""
    region = region_of(samples)
    if region:
        detach(region, samples)
        try:
            return passed(path, token, region.descriptor)
        finally:
            region.forget()  # the memory stays: it is the array's own now
    descriptor = copied(samples)
    try:
        return passed(path, token, descriptor)
    finally:
        os.close(descriptor)
