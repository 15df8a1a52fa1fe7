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
