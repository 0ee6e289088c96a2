# SPDX-License-Identifier: Apache-2.0
"""Images as the daemon encoded them, decoded when their pixels are asked for."""

from __future__ import annotations

import io
import os
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import PIL.Image

SUFFIXES = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".webp": "webp", ".exr": "exr"}
_KINDS = {"image/png": "png", "image/jpeg": "jpeg", "image/webp": "webp", "image/x-exr": "exr"}


class Image:
    """An image of a view.

    It behaves like an array of shape (height, width, 4), of type uint8: red, green, blue and alpha as sRGB display
    values, not premultiplied. Notebooks show it. `numpy.asarray(image)`, `image[...]` and Matplotlib's `imshow` work.

    Parameters
    ----------
    data : bytes
        The encoded image.
    format : str
        png, jpeg, webp or exr.
    headers
        What the daemon said about the image, such as `x-backend`.
    """

    def __init__(self, data: bytes, format: str, headers: dict[str, str] | None = None) -> None:
        self.bytes = data
        self.format = format
        self.headers = headers or {}

    @classmethod
    def of_answer(cls, data: bytes, headers: Any) -> Image:
        """The image of an HTTP answer."""
        kind = str(headers.get("Content-Type", "")).split(";")[0]
        return cls(data, _KINDS.get(kind, kind), {name.lower(): value for name, value in headers.items()})

    def pil(self) -> PIL.Image.Image:
        """The image for Pillow. Pillow has no reader of OpenEXR: such images are for `save` and other readers."""
        import PIL.Image

        if self.format == "exr":
            raise ValueError("Pillow does not read OpenEXR: save the image, or render another format")
        return PIL.Image.open(io.BytesIO(self.bytes))

    @cached_property
    def array(self) -> np.ndarray:
        """The pixels: uint8, (height, width, 4), read-only."""
        pixels = np.array(self.pil().convert("RGBA"))
        pixels.flags.writeable = False
        return pixels

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, 4)"""
        width, height = self.pil().size
        return height, width, 4

    @property
    def dtype(self) -> np.dtype:
        """uint8"""
        return np.dtype(np.uint8)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if copy is False and dtype is not None and np.dtype(dtype) != self.dtype:
            raise ValueError("another type needs a copy")
        pixels = self.array if dtype is None else self.array.astype(dtype, copy=False)
        return pixels.copy() if copy and pixels is self.array else pixels

    def __getitem__(self, index: Any) -> Any:
        return self.array[index]

    def __len__(self) -> int:
        return self.shape[0]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Image) and self.format == other.format and self.bytes == other.bytes

    def __hash__(self) -> int:
        return hash(self.bytes)

    def __repr__(self) -> str:
        size = "" if self.format == "exr" else "{1} x {0}, ".format(*self.shape)
        return f"<splatd.Image {size}{self.format}, {len(self.bytes)} bytes>"

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the image to a file and returns its path.

        The extension chooses the format. The bytes of the daemon are written if they have this format, else Pillow
        converts them. An existing file is replaced.

        Examples
        --------
        >>> path = demo.view(size=(64, 48)).render().save("a.png")
        """
        path = Path(path)
        wanted = SUFFIXES.get(path.suffix.lower())
        if wanted is None and not path.suffix:
            raise ValueError(f"'{path}' has no extension: name the file {path}.png, or .jpg, .webp or .exr")
        if wanted == self.format:
            path.write_bytes(self.bytes)
        elif wanted == "exr":
            raise ValueError('render(format="exr") gives an image that can be saved as OpenEXR')
        else:
            image = self.pil()
            (image.convert("RGB") if wanted == "jpeg" else image).save(path)
        return path

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        if self.format in ("png", "jpeg"):
            return {f"image/{self.format}": self.bytes, "text/plain": repr(self)}
        if self.format == "exr":
            return {"text/plain": repr(self)}
        return {"image/png": self._repr_png_(), "text/plain": repr(self)}

    def _repr_png_(self) -> bytes | None:
        if self.format == "exr":
            return None
        if self.format == "png":
            return self.bytes
        out = io.BytesIO()
        self.pil().save(out, "PNG")
        return out.getvalue()
