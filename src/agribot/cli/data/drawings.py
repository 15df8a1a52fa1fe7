"""Pictures of a class map: colour mask, overlay and three panels side by side."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.core.messages import ByteArray
from agribot.lab.train.figures import tint
from agribot.record.report import write_file

MASK_RGB = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]], dtype=np.uint8)
PANEL_WIDTH_PX = 640  # width of a panel; a wider picture is shrunk
TITLE_HEIGHT_PX = 22
_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".tif": "TIFF"}
TITLES = ("picture", "red: weed, green: crop", "confidence: dark is unsure")


def write_drawings(
    image_rgb: ByteArray, found: PictureClasses, stem: Path, kinds: Sequence[str], form: str
) -> list[Path]:
    """Write files `stem`-mask, -overlay and -panel of a picture (H, W, 3).

    Raises: RecordingError: one cannot be written.
    """
    made = []
    for kind in kinds:
        if kind == "mask":
            picture = MASK_RGB[found.class_id]
        elif kind == "overlay":
            picture = tint(image_rgb, found.class_id)
        else:
            picture = draw_panel(image_rgb, found)
        path = name_drawing(stem, kind, form)
        data = io.BytesIO()
        # Other formats ignore the quality.
        Image.fromarray(picture).save(data, format=_FORMATS[path.suffix], quality=92)
        write_file(path, data.getvalue())
        made.append(path)
    return made


def name_drawing(stem: Path, kind: str, form: str) -> Path:
    # A lossy mask would hold colours that are no class.
    suffix = "png" if kind == "mask" and form == "jpg" else form
    return stem.with_name(f"{stem.name}-{kind}.{suffix}")


def draw_panel(image_rgb: ByteArray, found: PictureClasses) -> ByteArray:
    """Draw picture, overlay and confidence side by side, with titles: (H, W, 3)."""
    # The least possible confidence, a third, is black.
    sure = ((found.confidence.astype(np.float32) - 85.0) * 1.5).clip(0, 255).astype(np.uint8)
    parts = (image_rgb, tint(image_rgb, found.class_id), np.repeat(sure[..., None], 3, axis=2))
    height, width = found.class_id.shape
    shown_width = min(width, PANEL_WIDTH_PX)
    shown_height = max(1, round(height * shown_width / width))
    sheet = Image.new("RGB", (3 * shown_width, shown_height + TITLE_HEIGHT_PX), "white")
    draw = ImageDraw.Draw(sheet)
    for index, (part, title) in enumerate(zip(parts, TITLES, strict=True)):
        small = Image.fromarray(part).resize((shown_width, shown_height), Image.Resampling.BILINEAR)
        sheet.paste(small, (index * shown_width, TITLE_HEIGHT_PX))
        draw.text((index * shown_width + 6, 5), title, fill="black")
    return np.asarray(sheet)
