"""Photographs of drawn rows whose judgement follows from geometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.core.messages import ByteArray, PlantClass

SOIL_RGB, PLANT_RGB, WEED_RGB = (120, 90, 70), (40, 160, 40), (60, 180, 40)
SIDE_PX, HORIZON_PX, MIDDLE_PX = 512, -60, 256
SPACING = 0.5  # columns between two rows for each picture row below the horizon

Mask = npt.NDArray[np.bool_]


def place_row(row: float, v_px: float, middle_px: float = MIDDLE_PX) -> float:
    """Return the column in which a row of the field is seen; row 0 runs down the middle."""
    return middle_px + row * SPACING * (v_px - HORIZON_PX)


def draw_rows(
    rows: tuple[float, ...], width_px: int, colour: object, ground: Image.Image
) -> Image.Image:
    """Draw rows as lines of one width over the whole picture."""
    draw = ImageDraw.Draw(ground)
    for row in rows:
        ends = [(place_row(row, v_px), v_px) for v_px in (0, SIDE_PX)]
        draw.line(ends, fill=colour, width=width_px)  # type: ignore[arg-type]
    return ground


def draw_field(crop: tuple[float, ...], weeds: tuple[float, ...] = ()) -> ByteArray:
    """Draw bands of crop and, in another green, of weeds, along rows of the field."""
    picture = Image.new("RGB", (SIDE_PX, SIDE_PX), SOIL_RGB)
    draw_rows(weeds, 9, WEED_RGB, picture)
    return np.asarray(draw_rows(crop, 13, PLANT_RGB, picture))


def draw_labels(rows: tuple[float, ...], side_px: int = SIDE_PX) -> Image.Image:
    """Draw the rows white on black, in another size if one is given."""
    label = draw_rows(rows, 5, 255, Image.new("L", (SIDE_PX, SIDE_PX)))
    return label.resize((side_px, side_px))


def write_rows(
    folder: Path, pictures: dict[str, ByteArray], rows: tuple[float, ...], side_px: int = 256
) -> Path:
    """Write pictures with the same labelled rows."""
    for name, picture in pictures.items():
        for part, image in (
            ("images", Image.fromarray(picture)), ("labels", draw_labels(rows, side_px)),
        ):  # fmt: skip
            (folder / part).mkdir(parents=True, exist_ok=True)
            image.save(folder / part / f"{name}.png")
    return folder


class ColourNetwork:
    """Names pixels by their colour: plants crop or, the lighter ones, weed."""

    map_shape = (SIDE_PX, SIDE_PX)
    finds_plants = False

    def __init__(self, crop: PlantClass = PlantClass.CROP, weed: PlantClass = PlantClass.WEED):
        self._names = ((PLANT_RGB, crop), (WEED_RGB, weed))

    def segment(self, image_rgb: ByteArray) -> ClassMap:
        class_id = np.full(image_rgb.shape[:2], PlantClass.SOIL, dtype=np.uint8)
        for colour, name in self._names:
            class_id[(image_rgb == colour).all(axis=2)] = name
        sure = np.full(class_id.shape, 255, dtype=np.uint8)
        return ClassMap(class_id=class_id, confidence=sure, scale_px=(1.0, 1.0))
