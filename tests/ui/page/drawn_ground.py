"""A photograph of a field as mapviz has it, a .geo file with its tile, to be imported as a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from agribot.core.geo import MapFrame

SIDE_PX = 768
GRASS, SOIL, CROP = (118, 140, 84), (134, 104, 74), (58, 122, 46)


def write_pyramid(
    folder: Path, frame: MapFrame, side_m: float, middle_m: tuple[float, float]
) -> Path:
    """Write a picture of a square of the field; rows lie a metre apart."""
    reach = np.linspace(-side_m / 2.0, side_m / 2.0, SIDE_PX)
    x, y = np.meshgrid(middle_m[0] + reach, middle_m[1] - reach)
    layer = folder / "layer0"
    layer.mkdir(parents=True)
    Image.fromarray(draw_field(x, y)).save(layer / "tile00000x00000.png")
    north, west, _ = frame.geodetic_from_map(x[0, 0], y[0, 0])
    south, east, _ = frame.geodetic_from_map(x[-1, -1], y[-1, -1])
    scale = (east - west) / SIDE_PX, (north - south) / SIDE_PX
    file = folder / f"{folder.name}.geo"
    file.write_text(
        f"image_path: .\nimage_width: {SIDE_PX}\nimage_height: {SIDE_PX}\ntile_size: {SIDE_PX}\n"
        "datum: wgs84\nprojection: geographic\n"
        f"tiepoint: [0, 0, {north!r}, {west!r}]\npixel_scale: [{scale[0]!r}, {scale[1]!r}]\n",
        encoding="utf-8",
    )
    return file


def draw_field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Six rows of round plants on soil, and grass around it."""
    pixels = np.full((*x.shape, 3), GRASS, dtype=float)
    pixels[(x > 0.2) & (x < 6.8) & (y > 1.4) & (y < 12.6)] = SOIL
    beside, along = x - np.round(x), y - np.round(y / 0.4) * 0.4
    is_row = (x > 0.5) & (x < 6.5) & (y > 1.8) & (y < 12.2)
    pixels[is_row & (np.hypot(beside, along) < 0.18)] = CROP
    pixels += np.random.default_rng(3).normal(0.0, 9.0, (*x.shape, 1))
    return np.clip(pixels, 0.0, 255.0).astype(np.uint8)
