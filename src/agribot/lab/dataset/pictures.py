"""Pictures from cameras, phones and the web: one array of red, green and blue each."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from agribot.core.errors import AgribotError
from agribot.core.messages import ByteArray
from agribot.core.pixel_depth import find_depth, narrow_pixels

SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp"}
# 16 bits a channel and grey: Pillow keeps these apart from its 8-bit modes.
DEEP_MODES = {"I;16", "I;16B", "I;16L", "I;16N", "I"}
LARGEST_PX = 250_000_000
Image.MAX_IMAGE_PIXELS = LARGEST_PX // 2  # Pillow warns of more, and refuses twice as many


MISNAMED = "name is not text in UTF-8; rename it"


class PictureError(AgribotError):
    """A file is no picture that can be read; the message names the file and the reason."""


def is_text(name: str) -> bool:
    """Return whether a file's name is valid text: one from a foreign archive may not be."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def show_name(name: str) -> str:
    """Make text of a name that may be none."""
    return name.encode(errors="backslashreplace").decode()


def read_picture(path: Path, most_px: int = LARGEST_PX) -> ByteArray:
    """Read (height, width, 3) uint8, upright as its EXIF tag says; alpha is dropped.

    Of deeper pixels the upper eight of their bits are kept (`core.pixel_depth`).

    Raises: PictureError.
    """
    with _open(path, most_px) as image:
        try:
            upright = ImageOps.exif_transpose(image) or image
            return _to_rgb(upright, path)
        except (OSError, SyntaxError, ValueError, MemoryError) as error:
            raise PictureError(
                f"{path}: cannot be decoded ({_explain(error)}); copy it anew"
            ) from error


def resize_nearest(class_id: ByteArray, shape: tuple[int, ...]) -> ByteArray:
    """Resize the class map to (height, width), by the pixel that covers each centre."""
    rows, columns = (
        ((np.arange(size) + 0.5) * (source / size)).astype(np.int64)
        for size, source in zip(shape, class_id.shape, strict=True)
    )
    resized: ByteArray = class_id[rows[:, None], columns[None, :]]
    return resized


def open_mask(path: Path) -> Image.Image:
    """Open a mask as stored, upright; the meaning of its values belongs to the data set.

    Raises: PictureError.
    """
    with _open(path) as image:
        try:
            image.load()
            return (ImageOps.exif_transpose(image) or image).copy()
        except (OSError, SyntaxError, ValueError, MemoryError) as error:
            raise PictureError(
                f"{path}: cannot be decoded ({_explain(error)}); copy it anew"
            ) from error


def _open(path: Path, most_px: int = LARGEST_PX) -> Image.Image:
    try:
        if path.stat().st_size == 0:
            raise PictureError(f"{path}: is empty (0 bytes); copy it anew")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(path)
    except Image.DecompressionBombError as error:
        raise PictureError(f"{path}: has too many pixels; cut it into pieces ({error})") from error
    except (OSError, SyntaxError, ValueError) as error:
        raise PictureError(f"{path}: is not a picture ({_explain(error)}); leave it out") from error
    if image.width * image.height > most_px:
        image.close()
        raise PictureError(
            f"{path}: {image.width} x {image.height} pixels are more than the limit of "
            f"{most_px / 1e6:g} million; cut it into pieces"
            + (", or raise --megapixels" if most_px < LARGEST_PX else "")
        )
    return image


def _to_rgb(image: Image.Image, path: Path) -> ByteArray:
    if image.mode in DEEP_MODES:
        values = np.asarray(image).astype(np.int64)
        return np.repeat(narrow_pixels(values, find_depth(values))[..., None], 3, axis=2)
    if image.mode == "F":
        raise PictureError(f"{path}: holds floating-point values; save it with 8 or 16 bits")
    return np.asarray(image.convert("RGB"))


def _explain(error: BaseException) -> str:
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    return text.split(" '/")[0]
