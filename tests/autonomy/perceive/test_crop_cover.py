"""Crop pixels as cells of the ground."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.perceive.crop_cover import StemLeaves
from agribot.autonomy.perceive.plants import observe
from agribot.core.errors import PerceptionError
from agribot.core.messages import CameraFrame, CropCover, PlantClass, Scene
from tests.autonomy.perceive.drawn_field import CONFIG, GROUND, Disc, draw
from tests.autonomy.perceive.drawn_plants import draw_plants

PICTURE = np.zeros((480, 640, 3), dtype=np.uint8)


def scene_of(*discs: tuple[float, float, float, PlantClass]) -> Scene:
    frame = CameraFrame(t_s=1.0, index=0, image_rgb=PICTURE)
    return observe(frame, draw(*discs, height_ratio=0.3), GROUND, CONFIG, 1.2)


def cells(cover: CropCover, bits: bytes) -> set[tuple[float, float]]:
    """Middles of the cells whose bit is set, body frame."""
    count = cover.rows * cover.columns
    grid = np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=count)
    rows, columns = np.nonzero(grid.reshape(cover.rows, cover.columns))
    x_m = cover.x_body_m + (rows + 0.5) * cover.cell_m
    y_m = cover.y_body_m + (columns + 0.5) * cover.cell_m
    return set(zip(x_m.tolist(), y_m.tolist(), strict=True))


def test_a_row_that_closes_to_one_piece_is_no_plant_but_covers_its_ground() -> None:
    row = [(0.4 + 0.1 * i, 0.0, 0.13, PlantClass.CROP) for i in range(20)]
    scene = scene_of(*row)
    assert not [plant for plant in scene.plants if plant.plant is PlantClass.CROP]
    assert scene.crop_cover is not None
    covered = cells(scene.crop_cover, scene.crop_cover.crop)
    inside = [
        cell for cell in cells(scene.crop_cover, scene.crop_cover.seen)
        if 0.6 < cell[0] < 1.3 and abs(cell[1]) < 0.09
    ]  # fmt: skip
    assert len(inside) > 100
    assert set(inside) <= covered
    assert all(abs(y_m) < 0.13 + 0.03 for x_m, y_m in covered if x_m < 1.3)


def test_leaves_of_weeds_and_seams_of_the_ground_cover_nothing() -> None:
    class_map = draw((0.9, 0.1, 0.08, PlantClass.WEED))
    class_map.class_id[:, 250:252] = PlantClass.CROP
    frame = CameraFrame(t_s=1.0, index=0, image_rgb=PICTURE)
    cover = observe(frame, class_map, GROUND, CONFIG, 1.2).crop_cover
    assert cover is not None
    assert not any(cover.crop)


def test_a_leaf_that_the_network_misnames_goes_with_its_plant() -> None:
    weed = (0.9, 0.1, 0.1, PlantClass.WEED), (0.95, 0.17, 0.04, PlantClass.CROP)
    crop = (0.9, 0.1, 0.1, PlantClass.CROP), (0.95, 0.17, 0.04, PlantClass.WEED)
    on_weed, on_crop = scene_of(*weed).crop_cover, scene_of(*crop).crop_cover
    assert on_weed is not None and on_crop is not None
    assert not any(on_weed.crop)
    whole = cells(on_crop, on_crop.crop)
    assert any(math.dist(cell, (0.95, 0.17)) < 0.02 for cell in whole)


def test_a_patch_of_crop_is_where_it_stands_and_nothing_is_told_beyond_the_range() -> None:
    cover = scene_of((0.8, -0.2, 0.1, PlantClass.CROP)).crop_cover
    assert cover is not None
    covered = cells(cover, cover.crop)
    middle = np.mean(list(covered), axis=0)
    assert math.dist(middle, (0.8, -0.2)) < 0.04
    camera_m = GROUND.camera_xyz_body_m[:2]
    assert all(math.dist(cell, camera_m) < CONFIG.max_range_m for cell in cells(cover, cover.seen))
    assert len(cover.crop) < 2000  # ten of them a second are recorded


CROP, WEED = PlantClass.CROP, PlantClass.WEED


def cover_of_stems(*discs: Disc, called: PlantClass | None = None, seen: float = 0.9) -> CropCover:
    """The cover of plants whose stems a network finds, whose pixels are all `called` one class."""
    class_map = draw_plants(*discs, score=seen)
    if called is not None:
        class_map.class_id[class_map.class_id != PlantClass.SOIL] = called
    frame = CameraFrame(t_s=1.0, index=0, image_rgb=PICTURE)
    cover = observe(frame, class_map, GROUND, CONFIG, 1.2).crop_cover
    assert cover is not None
    return cover


def covers_place(cover: CropCover, bits: bytes, x_m: float, y_m: float) -> bool:
    return any(math.dist(cell, (x_m, y_m)) < 0.02 for cell in cells(cover, bits))


def test_leaves_that_are_called_weed_but_point_to_a_stem_of_crop_are_crop() -> None:
    """Carrots and onions look like weeds, pixel by pixel."""
    carrots = [(0.7 + 0.1 * i, 0.0, 0.05, CROP) for i in range(6)]
    cover = cover_of_stems(*carrots, (0.9, 0.3, 0.05, WEED), called=WEED)
    assert all(covers_place(cover, cover.crop, x_m, 0.0) for x_m, *_ in carrots)
    assert not covers_place(cover, cover.crop, 0.9, 0.3)
    assert not covers_place(cover, cover.unknown, 0.9, 0.3)


def test_a_thin_leaf_of_crop_covers_its_cells() -> None:
    class_map = draw_plants((0.9, 0.0, 0.05, CROP))
    is_leaf = class_map.class_id == CROP
    is_leaf[:, 1::2] = False  # nowhere three pixels thick
    class_map.class_id[~is_leaf] = PlantClass.SOIL
    frame = CameraFrame(t_s=1.0, index=0, image_rgb=PICTURE)
    cover = observe(frame, class_map, GROUND, CONFIG, 1.2).crop_cover
    assert cover is not None and covers_place(cover, cover.crop, 0.9, 0.0)


def test_vegetation_that_no_stem_explains_is_unknown() -> None:
    cover = cover_of_stems((0.9, 0.0, 0.05, WEED), seen=0.1)
    assert covers_place(cover, cover.unknown, 0.9, 0.0)
    assert not any(cover.crop)


def test_leaves_of_a_plant_beyond_the_edge_tell_nothing() -> None:
    edge_x_m = float(GROUND.x_body_m[-1, 256])
    cover = cover_of_stems((edge_x_m - 0.02, 0.0, 0.08, WEED))
    assert not any(cover.unknown)
    assert not covers_place(cover, cover.seen, edge_x_m + 0.03, 0.0)
    assert covers_place(cover, cover.seen, edge_x_m + 0.15, 0.0)


def test_each_cell_of_crop_tells_the_stems_that_its_leaves_point_to() -> None:
    plants = [(0.9, 0.0, 0.08, CROP), (0.9, 0.15, 0.08, CROP)]
    cover = cover_of_stems(*plants)
    stems = sorted(cover.stems_body_m, key=lambda stem_m: stem_m[1])
    assert stems == [pytest.approx(plant[:2], abs=0.005) for plant in plants]
    crop = sorted(cells(cover, cover.crop))
    assert len(cover.owners) == 2 * len(crop)
    owners = np.frombuffer(cover.owners, dtype=np.uint8).reshape(-1, 2)
    assert owners.min() >= 1
    for cell, own in zip(crop, owners, strict=True):
        for number in own:
            x_m, y_m = cover.stems_body_m[number - 1]
            assert math.dist(cell, (x_m, y_m)) < 0.08 + 0.04


def test_leaves_of_crop_that_point_to_a_weed_are_explained_by_no_stem() -> None:
    cover = cover_of_stems((0.9, 0.0, 0.06, WEED), called=CROP)
    assert covers_place(cover, cover.crop, 0.9, 0.0)
    assert not any(cover.owners)
    assert cover.stems_body_m == ()


def test_a_map_of_leaves_of_another_size_is_refused() -> None:
    leaves = StemLeaves(np.zeros((2, 2), dtype=np.int32), np.zeros((0, 2)))
    with pytest.raises(PerceptionError, match=r"\(2, 2\)"):
        GROUND.cover_grid.cover(np.zeros((384, 512), dtype=bool), leaves)
