"""Pictures that hold numbers: height maps and occupancy maps."""

from __future__ import annotations

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray

FULL_SCALE = 65535.0  # value of white in a picture with 16 bits


def read_grey(path: Path, most_px: int) -> FloatArray:
    """Read the grey (rows, columns) of a picture, 0 black to 1 white, its lowest row first.

    The size is checked before anything is unpacked: a small file can hold a very large picture.
    Raises: DescriptionError: no picture that can be read, or a side longer than `most_px`.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                if max(image.size) > most_px:
                    raise DescriptionError(
                        f"{path.name} has {image.width} x {image.height} pixels; "
                        f"at most {most_px} a side are read"
                    )
                is_wide = image.mode.startswith("I")
                grey = np.asarray(image if is_wide else image.convert("L"), dtype=np.float64)
    except (OSError, SyntaxError, ValueError, EOFError, struct.error, zlib.error,
            Image.DecompressionBombError) as error:  # fmt: skip
        raise DescriptionError(
            f"{path.name} is no picture that can be read: {error}; save it as PNG"
        ) from error
    flipped: FloatArray = np.flipud(grey) / (FULL_SCALE if is_wide else 255.0)
    return flipped
