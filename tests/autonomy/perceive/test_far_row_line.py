"""The row line of a front camera: many rows drawn to the horizon, whose place is known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.far_view import FOLIAGE_M
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.row_line import find_row_line, see_row_line
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import PlantClass, RowLine
from tests import nightly
from tests.autonomy.perceive.drawn_field import CAMERA

SHAPE, HEIGHT_M, DOWN_RAD, PITCH_M = (240, 320), 0.9, math.radians(25.0), 0.5
SPACING_M, RADIUS_M, FARTHEST_M = 0.25, 0.07, 7.0


def open_ground(
    tilt_rad: float = 0.0, spacing_m: float | None = PITCH_M, down_rad: float = DOWN_RAD
) -> GroundLookup:
    pose = transform((0.3, 0.0, HEIGHT_M), (0.0, down_rad + tilt_rad, 0.0)) @ LINK_FROM_OPTICAL
    return GroundLookup(CAMERA, pose, SHAPE, 2.5, spacing_m)


FRONT = open_ground()


def draw_rows(
    rng: np.random.Generator,
    offset_m: float,
    heading_rad: float,
    ground: GroundLookup = FRONT,
    *,
    weeds: int = 60,
    missing_ratio: float = 0.15,
    bend_per_m: float = 0.0,
    pitch_m: float = PITCH_M,
) -> ClassMap:
    """Draw crop on rows that the robot stands `offset_m` left of, and weeds that are taken for it.

    Leaves float at FOLIAGE_M.
    """
    rows = np.arange(-8, 9) * pitch_m - offset_m
    along_m = np.arange(-1.0, FARTHEST_M + 1.0, SPACING_M)
    left_m, ahead_m = (part.ravel() for part in np.meshgrid(rows, along_m))
    ahead_m = ahead_m + rng.normal(0.0, 0.03, ahead_m.shape)
    left_m = left_m + rng.normal(0.0, 0.02, left_m.shape) + bend_per_m * ahead_m**2 / 2.0
    kept = np.append(rng.random(ahead_m.shape) >= missing_ratio, np.ones(weeds, dtype=bool))
    cos, sin = math.cos(-heading_rad), math.sin(-heading_rad)
    x_m = np.append(cos * ahead_m - sin * left_m, rng.uniform(0.4, FARTHEST_M, weeds))
    y_m = np.append(sin * ahead_m + cos * left_m, rng.uniform(-3.0, 3.0, weeds))
    return draw(ground, x_m[kept], y_m[kept])


def draw(ground: GroundLookup, x_m: np.ndarray, y_m: np.ndarray) -> ClassMap:
    camera_m = ground.camera_xyz_body_m
    nearer = 1.0 - FOLIAGE_M / camera_m[2]
    at_x_m = camera_m[0] + (ground.x_body_m - camera_m[0]) * nearer
    at_y_m = camera_m[1] + (ground.y_body_m - camera_m[1]) * nearer
    class_id = np.full(SHAPE, PlantClass.SOIL, dtype=np.uint8)
    for x, y in zip(x_m, y_m, strict=True):
        rows = np.abs(at_x_m[:, 0] - x) <= RADIUS_M  # a level camera: as far ahead all along
        if math.hypot(x, y) <= FARTHEST_M:
            is_leaf = np.hypot(at_x_m[rows] - x, at_y_m[rows] - y) <= RADIUS_M
            class_id[rows] = np.where(is_leaf, np.uint8(PlantClass.CROP), class_id[rows])
    return ClassMap(
        class_id=class_id,
        confidence=np.full(SHAPE, 220, dtype=np.uint8),
        scale_px=(480 / SHAPE[0], 640 / SHAPE[1]),
    )


def find_errors(line: RowLine, offset_m: float, heading_rad: float) -> tuple[float, float]:
    """Find how far a line is off the nearest row, in metres and radians."""
    assert line.offset_m is not None
    assert line.heading_rad is not None
    off_m = line.offset_m - offset_m - line.at_ahead_m * math.sin(heading_rad)
    return off_m - PITCH_M * round(off_m / PITCH_M), line.heading_rad - heading_rad


@nightly.all_or_first("seeds", range(60), in_suite=6)
@pytest.mark.parametrize("spacing_m", [PITCH_M, None])
def test_rows_to_the_horizon_are_as_good_as_they_say(
    spacing_m: float | None, seeds: Sequence[int]
) -> None:
    ground, sigmas = open_ground(spacing_m=spacing_m), []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        offset_m, heading_rad = rng.uniform(-0.2, 0.2), rng.normal(0.0, math.radians(7.0))
        line = find_row_line(draw_rows(rng, offset_m, heading_rad), ground, 1.0)
        if line is not None:
            off_m, turned_rad = find_errors(line, offset_m, heading_rad)
            sigmas.append((off_m / line.offset_std_m, turned_rad / line.heading_std_rad))
            assert line.offset_std_m < 0.08
            assert line.heading_std_rad < math.radians(4.0)
    assert len(sigmas) >= 0.9 * len(seeds)
    assert (np.abs(sigmas) < 3.0).all()


def test_a_camera_tilted_by_rough_ground_still_sees_rows_where_they_are() -> None:
    tilt_rad = math.radians(4.0)
    rng = np.random.default_rng(3)
    class_map = draw_rows(rng, 0.1, 0.1, open_ground(tilt_rad))
    seen = see_row_line(class_map, FRONT, 1.0)
    assert seen is not None
    assert seen.tilt_rad == pytest.approx(tilt_rad, abs=math.radians(1.5))
    off_m, turned_rad = find_errors(seen.line, 0.1, 0.1)
    assert abs(off_m) < 0.05
    assert abs(turned_rad) < math.radians(2.0)


def test_rows_that_bend_are_told_where_the_robot_is_and_not_where_they_go() -> None:
    bend_per_m = 0.04
    line = find_row_line(
        draw_rows(np.random.default_rng(4), 0.0, 0.0, bend_per_m=bend_per_m), FRONT, 1.0
    )
    assert line is not None
    assert line.offset_m is not None
    assert line.heading_rad is not None
    # Ahead the row leads to the left, so that the robot heads right of it there.
    assert line.heading_rad == pytest.approx(-bend_per_m * line.at_ahead_m, abs=math.radians(2.5))
    assert line.offset_m == pytest.approx(-bend_per_m * line.at_ahead_m**2 / 2.0, abs=0.05)


def draw_straight_rows(lefts_m: Sequence[float]) -> ClassMap:
    """Draw rows without weeds or gaps along the robot's way, each `lefts_m` left of it."""
    along_m = np.arange(0.4, FARTHEST_M, SPACING_M)
    left_m, ahead_m = (part.ravel() for part in np.meshgrid(lefts_m, along_m))
    return draw(FRONT, ahead_m, left_m)


def test_a_row_drilled_off_its_place_is_where_its_plants_are() -> None:
    lefts_m = [PITCH_M * k + (0.04 if k == 0 else 0.0) for k in range(-6, 7)]
    line = find_row_line(draw_straight_rows(lefts_m), FRONT, 1.0)
    assert line is not None
    assert line.offset_m == pytest.approx(-0.04, abs=0.015)


def test_beside_the_field_the_nearest_row_with_plants_is_found() -> None:
    line = find_row_line(draw_straight_rows([0.44 + PITCH_M * k for k in range(6)]), FRONT, 1.0)
    assert line is not None
    assert line.offset_m == pytest.approx(-0.44, abs=0.03)


def test_plants_strewn_about_are_no_rows_to_the_horizon() -> None:
    rng, found = np.random.default_rng(0), 0
    for _ in range(12):
        class_map = draw(FRONT, rng.uniform(0.4, 7.0, 250), rng.uniform(-3.0, 3.0, 250))
        found += find_row_line(class_map, FRONT, 1.0) is not None
    assert found <= 3


@pytest.mark.parametrize("plant", list(PlantClass))
def test_a_front_picture_of_nothing_but_one_class_shows_no_row(plant: PlantClass) -> None:
    class_map = ClassMap(
        class_id=np.full(SHAPE, plant, dtype=np.uint8),
        confidence=np.full(SHAPE, 255, dtype=np.uint8),
        scale_px=(2.0, 2.0),
    )
    assert find_row_line(class_map, FRONT, 0.0) is None


@pytest.mark.parametrize(
    ("leaf", "soil"),
    [((60, 140, 40), (120, 95, 70)), ((140, 140, 140), (120, 100, 120))],
    ids=["daylight", "purple"],
)
def test_green_shows_rows_that_the_network_does_not_know_whatever_the_white_balance(
    leaf: tuple[int, int, int], soil: tuple[int, int, int]
) -> None:
    drawn = draw_rows(np.random.default_rng(5), 0.1, 0.05)
    is_plant = drawn.class_id == PlantClass.CROP
    blind = ClassMap(
        class_id=np.full(SHAPE, PlantClass.SOIL, dtype=np.uint8),
        confidence=drawn.confidence,
        scale_px=drawn.scale_px,
    )
    image_rgb = np.where(is_plant[..., None], leaf, soil).astype(np.uint8)
    assert find_row_line(blind, FRONT, 0.0) is None
    line = find_row_line(blind, FRONT, 0.0, image_rgb.repeat(2, axis=0).repeat(2, axis=1))
    assert line is not None
    off_m, turned_rad = find_errors(line, 0.1, 0.05)
    assert abs(off_m) < 0.05
    assert abs(turned_rad) < math.radians(2.0)


def test_a_camera_that_looks_down_has_no_far_view() -> None:
    assert open_ground(down_rad=math.radians(50.0)).far_view is None
    assert FRONT.far_view is not None
