"""What `agribot live` draws: the network's classes over the picture, figures in a strip below."""

from __future__ import annotations

import io
import textwrap
from typing import Any

import numpy as np

from agribot.core.messages import ByteArray

STRIP_PX = 28  # height of the strip below the picture
JPEG_QUALITY = 88
NOTICE_PX, LINE_CHARS = (640, 480), 60
WIDEST_PX = 1280  # width of a picture on the page; a wider one is shown smaller


def draw_overlay(image_rgb: ByteArray, seen: Any, words: str) -> bytes:
    """Draw weeds red and crops green over a picture (H, W, 3), with words below; as JPEG."""
    from agribot.autonomy.perceive.pictures import enlarge
    from agribot.lab.train.figures import tint

    shown = _shrink(image_rgb)
    found = enlarge(seen.class_id, seen.confidence, shown.shape[:2])
    return encode_with_words(tint(shown, found.class_id), words)


def encode_with_words(image_rgb: ByteArray, words: str) -> bytes:
    """Encode a picture (H, W, 3) as JPEG, with words in a strip below it."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = image_rgb.shape[:2]
    picture = Image.new("RGB", (width, height + STRIP_PX))
    picture.paste(Image.fromarray(image_rgb), (0, 0))
    font = ImageFont.load_default(max(10, min(16, width // 38)))
    ImageDraw.Draw(picture).text((8, height + STRIP_PX // 2), words, "white", font, anchor="lm")
    return _encode(picture)


def draw_notice(words: str) -> bytes:
    """Draw words alone, as JPEG: what a page shows before the first picture and at the end."""
    from PIL import Image, ImageDraw, ImageFont

    picture = Image.new("RGB", NOTICE_PX, "#222")
    text = textwrap.fill(words, LINE_CHARS)
    middle = (NOTICE_PX[0] / 2, NOTICE_PX[1] / 2)
    font = ImageFont.load_default(18)
    ImageDraw.Draw(picture).multiline_text(middle, text, "white", font, anchor="mm", align="center")
    return _encode(picture)


def _encode(picture: Any) -> bytes:
    encoded = io.BytesIO()
    picture.save(encoded, format="JPEG", quality=JPEG_QUALITY)
    return encoded.getvalue()


def _shrink(image_rgb: ByteArray) -> ByteArray:
    from PIL import Image

    height, width = image_rgb.shape[:2]
    if width <= WIDEST_PX:
        return image_rgb
    size = (WIDEST_PX, round(height * WIDEST_PX / width))
    shown: ByteArray = np.asarray(Image.fromarray(image_rgb).resize(size, Image.Resampling.BOX))
    return shown
