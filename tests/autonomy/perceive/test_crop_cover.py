"""Crop pixels, told as cells of the ground."""

from __future__ import annotations

import math

import numpy as np

from agribot.autonomy.perceive.plants import observe
from agribot.core.messages import CameraFrame, CropCover, PlantClass, Scene
from tests.autonomy.perceive.drawn_field import CONFIG, GROUND, draw

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
