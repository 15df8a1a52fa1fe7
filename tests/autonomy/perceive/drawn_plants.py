"""Plants drawn as a perfect plant network would see them: their pixels, stems and ways."""

from __future__ import annotations

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import ground_to_pixels
from agribot.autonomy.perceive.stems import CELL_PX, SQUARE_PX, PlantMaps
from agribot.core.messages import FloatArray, PlantClass
from tests.autonomy.perceive.drawn_field import BODY_FROM_CAMERA, CAMERA, MAP_SHAPE, Disc, draw

PEAK_SIGMA_PX = 4.8
CELLS = (MAP_SHAPE[0] // CELL_PX, MAP_SHAPE[1] // CELL_PX)


def draw_plants(*discs: Disc, height_ratio: float = 0.3, score: float = 0.9) -> ClassMap:
    """Draw plants as `draw` does, with their stems on the ground under the middles of the discs."""
    class_map = draw(*discs, height_ratio=height_ratio)
    stems_px = find_stems_px(*discs)
    kinds = [plant for *_, plant in discs]
    plants = make_maps(number_pixels(*discs, height_ratio=height_ratio), stems_px, kinds, score)
    return msgspec.structs.replace(class_map, plants=plants)


def number_pixels(*discs: Disc, height_ratio: float = 0.3) -> npt.NDArray[np.int64]:
    """Number the pixels (h, w) by the disc that they show, -1 where they show none."""
    number = np.full(MAP_SHAPE, -1)
    for index, disc in enumerate(discs):
        number[draw(disc, height_ratio=height_ratio).class_id != PlantClass.SOIL] = index
    return number


def find_stems_px(*discs: Disc) -> FloatArray:
    """Find the pixels of the class map, u and v (N, 2), where the discs' middles stand."""
    places_m = np.array([disc[:2] for disc in discs]).reshape(-1, 2)
    image_px = ground_to_pixels(places_m, CAMERA.matrix(), BODY_FROM_CAMERA)
    ratio = np.array([MAP_SHAPE[1] / CAMERA.width_px, MAP_SHAPE[0] / CAMERA.height_px])
    stems_px: FloatArray = (image_px + 0.5) * ratio - 0.5
    return stems_px


def make_maps(
    number: npt.NDArray[np.int64], stems_px: FloatArray, kinds: list[PlantClass], score: float
) -> PlantMaps:
    """Make the maps of plants with these pixels (h, w), stems (N, 2) and classes."""
    rows, columns = np.indices(CELLS)
    centre_px = np.stack([columns, rows]) * CELL_PX + 1.5
    in_cells = number.reshape(CELLS[0], CELL_PX, CELLS[1], CELL_PX).max(axis=(1, 3))
    way_px = np.zeros((2, *CELLS), dtype=np.float32)
    own_cells = np.abs(stems_px[:, :, None, None] - centre_px).max(axis=1) <= CELL_PX / 2
    for index, stem_px in enumerate(stems_px):
        to_stem_px = stem_px[:, None, None] - centre_px
        is_its = (in_cells == index) & ~own_cells.any(axis=0) | own_cells[index]
        way_px = np.where(is_its, to_stem_px, way_px).astype(np.float32)
    heat = draw_heat(stems_px, kinds, score)
    return PlantMaps(stem_score=np.rint(255.0 * heat).astype(np.uint8), way_px=way_px)


def draw_heat(stems_px: FloatArray, kinds: list[PlantClass], score: float) -> FloatArray:
    """Draw a peak of this score about each stem (N, 2), of its class."""
    heat = np.zeros((2, MAP_SHAPE[0] // SQUARE_PX, MAP_SHAPE[1] // SQUARE_PX))
    rows, columns = np.indices(heat.shape[1:])
    own = np.floor((stems_px + 0.5) / SQUARE_PX)
    for (column, row), kind in zip(own.tolist(), kinds, strict=True):
        if 0 <= row < heat.shape[1] and 0 <= column < heat.shape[2]:
            gap_px = np.hypot(rows - row, columns - column) * SQUARE_PX
            peak = score * np.exp(-((gap_px / PEAK_SIGMA_PX) ** 2) / 2.0)
            heat[kind] = np.maximum(heat[kind], peak)
    return heat
