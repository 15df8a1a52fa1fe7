"""Pictures from files, as pixels."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray


def read_pictures(paths: Iterable[Path | io.BytesIO]) -> Iterator[ByteArray]:
    """Read pictures (H, W, 3).

    Raises: ConfigError: one cannot be read.
    """
    for path in paths:
        try:
            with Image.open(path) as image:
                yield np.asarray(image.convert("RGB"))
        except (OSError, UnidentifiedImageError) as error:
            raise ConfigError(f"a picture cannot be read ({error}); leave it out") from error


def reduce_width(image_rgb: ByteArray, most_px: int) -> ByteArray:
    """Reduce a picture (H, W, 3) that is wider than `most_px` to that width."""
    height, width = image_rgb.shape[:2]
    if width <= most_px:
        return image_rgb
    size = (most_px, max(1, round(height * most_px / width)))
    return np.asarray(Image.fromarray(image_rgb).resize(size, Image.Resampling.BOX))
