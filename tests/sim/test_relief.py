"""The relief of the ground: what it is made of, how it shakes the robot, and how it is seen."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.geo import LINK_FROM_OPTICAL, Datum, transform
from agribot.core.messages import DriveCommand, FloatArray, PlantClass, Row
from agribot.core.robot import CameraSpec
from agribot.core.world import HeightField, Light, Plant, Relief, WorldSpec
from agribot.description.loader import load_robot
from agribot.sim.attitude import read_roll_pitch_yaw
from agribot.sim.camera import CameraRenderer
from agribot.sim.camera.renderer import Rendering
from agribot.sim.ground_surface import GroundSurface, build_ground_surface
from agribot.sim.physics import Physics
from agribot.sim.relief import (
    LONGEST_M,
    SHORTEST_M,
    TILE_PERIODS_M,
    TILE_SAMPLES,
    make_rough_tile,
)
from tests import nightly

STEP_NS = 2_000_000
TILLED = Relief(seed=1, roughness_rms_m=0.014, clods_per_m2=25.0, clod_height_m=0.04)
ROW = Row(index=0, start_map_m=(-6.0, 0.0), end_map_m=(6.0, 0.0))
CAMERA = CameraSpec(
    link="camera_link", width_px=320, height_px=240, hfov_rad=1.0, rate_hz=10.0,
    noise_std=0.0, clip_near_m=0.02, clip_far_m=50.0,
)  # fmt: skip


def _world(relief: Relief, **changes: object) -> WorldSpec:
    bare = WorldSpec(name="rough", datum=Datum(lat_deg=21.0, lon_deg=73.0), relief=relief)
    return msgspec.structs.replace(bare, **changes)


def _look(
    world: WorldSpec,
    down_deg: float,
    surface: GroundSurface | None = None,
    *,
    height_m: float = 0.9,
) -> tuple[Rendering, FloatArray]:
    map_from_camera = transform((0.0, 0.0, height_m), (0.0, math.radians(down_deg), 0.3))
    map_from_camera = map_from_camera @ LINK_FROM_OPTICAL
    renderer = CameraRenderer(world, threads=1, ground=surface)
    return renderer.render(map_from_camera, CAMERA, noise_seed=None), map_from_camera


def _back_project(picture: Rendering, map_from_camera: FloatArray) -> FloatArray:
    """Return the map places (height, width, 3) that the depth image shows."""
    row, column = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    right = (column - (CAMERA.width_px - 1) / 2.0) / CAMERA.focal_px
    down = (row - (CAMERA.height_px - 1) / 2.0) / CAMERA.focal_px
    rays = np.stack([right, down, np.ones_like(right)], axis=-1) * picture.depth_m[..., None]
    places: FloatArray = rays @ map_from_camera[:3, :3].T + map_from_camera[:3, 3]
    return places


def test_the_displacement_psd_of_rough_ground_falls_with_the_square_of_the_wave_number() -> None:
    tile = make_rough_tile(5, 0)
    period_m = TILE_PERIODS_M[0]
    assert tile.std() == pytest.approx(1.0)
    for axis in (0, 1):
        power = np.mean(np.abs(np.fft.rfft(tile, axis=axis)) ** 2, axis=1 - axis)
        waves_per_m = np.arange(len(power)) / period_m
        kept = (waves_per_m > 2.0 / LONGEST_M) & (waves_per_m < 0.5 / SHORTEST_M)
        slope = np.polyfit(np.log(waves_per_m[kept]), np.log(power[kept]), 1)[0]
        assert slope == pytest.approx(-2.0, abs=0.3)
        assert power[waves_per_m > 1.1 / SHORTEST_M].sum() < 1e-6 * power.sum()
    assert tile.shape == (TILE_SAMPLES, TILE_SAMPLES)


def test_the_ground_has_the_roughness_that_it_is_told() -> None:
    ground = build_ground_surface(_world(Relief(seed=2, roughness_rms_m=0.01)))
    inner = ground.height_m[100:-100, 100:-100]
    assert inner.std() == pytest.approx(0.01, rel=0.2)
    assert np.all(ground.height_m[0] == 0.0) and np.all(ground.height_m[:, -1] == 0.0)


def test_the_same_seed_makes_the_same_ground_wherever_the_field_ends() -> None:
    near = build_ground_surface(_world(TILLED))
    far_plant = Plant(
        species="sugar_beet", plant=PlantClass.CROP, x_map_m=14.0, y_map_m=9.0, yaw_rad=0.0,
        size_m=0.2, seed=1,
    )  # fmt: skip
    wide = build_ground_surface(_world(TILLED, plants=(far_plant,)))
    places = np.random.default_rng(0).uniform(-2.0, 6.0, (500, 2))
    assert np.allclose(near.sample_heights(places), wide.sample_heights(places), atol=1e-9)
    other = build_ground_surface(_world(msgspec.structs.replace(TILLED, seed=2)))
    assert not np.allclose(near.sample_heights(places), other.sample_heights(places), atol=1e-3)


def test_a_world_without_relief_keeps_the_grid_of_its_terrain() -> None:
    field = HeightField(
        height_m=np.arange(12.0).reshape(3, 4), x_min_m=-1.0, y_min_m=-2.0, resolution_m=0.5
    )
    ground = build_ground_surface(_world(Relief(seed=9), terrain=field))
    assert not ground.is_fine
    assert np.array_equal(ground.height_m, field.height_m)


def test_relief_lies_on_the_terrain() -> None:
    slope = HeightField(
        height_m=np.tile(np.linspace(0.0, 3.0, 31), (31, 1)), x_min_m=-15.0, y_min_m=-15.0,
        resolution_m=1.0,
    )  # fmt: skip
    places = np.random.default_rng(1).uniform(-6.0, 6.0, (500, 2))
    on_slope = build_ground_surface(_world(TILLED, terrain=slope)).sample_heights(places)
    plain = build_ground_surface(_world(TILLED)).sample_heights(places)
    assert np.allclose(on_slope - plain, 0.1 * (places[:, 0] + 15.0), atol=1e-9)


def test_ridges_run_under_rows_and_tracks_astride_them() -> None:
    relief = Relief(
        ridge_height_m=0.06, track_depth_m=0.03, track_gauge_m=0.7, track_width_m=0.12, rows=(ROW,)
    )
    ground = build_ground_surface(_world(relief))
    across = ground.sample_heights(np.array([[0.0, 0.0], [0.0, 0.5], [0.0, -0.5]]))
    assert across[0] - across[1:] == pytest.approx([0.06, 0.06], abs=1e-3)
    smooth = msgspec.structs.replace(relief, track_depth_m=0.0)
    sides = np.array([[1.0, 0.35], [1.0, -0.35]])
    sunk = build_ground_surface(_world(smooth)).sample_heights(sides) - ground.sample_heights(sides)
    assert sunk == pytest.approx([0.03, 0.03], abs=1e-3)


def test_no_clod_lies_on_a_wheel_track() -> None:
    relief = Relief(
        seed=3, clods_per_m2=80.0, clod_height_m=0.05, track_depth_m=0.01, track_gauge_m=0.7,
        track_width_m=0.3, rows=(ROW,),
    )  # fmt: skip
    ground = build_ground_surface(_world(relief))
    x_m = np.linspace(-5.0, 5.0, 400)
    track = ground.sample_heights(np.column_stack([x_m, np.full(400, 0.35)]))
    beside = ground.sample_heights(np.column_stack([x_m, np.full(400, 2.0)]))
    assert track.max() < 0.0
    assert beside.max() > 0.02


@pytest.mark.parametrize("seed", [1, 2])
def test_a_tilled_field_tilts_the_robot_by_one_to_two_degrees(seed: int) -> None:
    physics = Physics(load_robot(), _world(msgspec.structs.replace(TILLED, seed=seed)), STEP_NS)
    tilt = []
    for _ in range(500):
        physics.command(DriveCommand(v_mps=0.4, yaw_rate_radps=0.1))
        tilt.append(read_roll_pitch_yaw(physics.advance(20)[-1])[:2])
    rms_deg = np.degrees(np.std(tilt[25:], axis=0))
    assert 0.7 < rms_deg[0] < 2.3 and 0.9 < rms_deg[1] < 2.6
    assert 1.0 < math.hypot(*rms_deg) / math.sqrt(2.0) < 2.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_robot_put_down_on_rough_ground_stands_still(seed: int) -> None:
    physics = Physics(load_robot(), _world(msgspec.structs.replace(TILLED, seed=seed)), STEP_NS)
    start = physics.history[-1, :3].copy()
    after = physics.advance(250)
    assert np.abs(after[:, :3] - start).max() < 1e-3
    assert np.abs(after[-1, 7:10]).max() < 2e-3
    assert np.hypot(*start[:2]) < 0.02


@nightly.one_by_one("down_deg", [45.0, 89.0], in_suite=1)
def test_the_camera_sees_the_heights_that_the_wheels_feel(down_deg: float) -> None:
    world = _world(TILLED)
    ground = build_ground_surface(world)
    picture, map_from_camera = _look(world, down_deg, ground)
    places = _back_project(picture, map_from_camera)[picture.depth_m < 1.6]
    error_m = np.abs(places[:, 2] - ground.sample_heights(places[:, :2]))
    assert np.quantile(error_m, 0.98) < 0.004
    assert np.median(error_m) < 0.001


def test_the_shadow_of_a_clod_lies_away_from_the_sun() -> None:
    heights = np.zeros((401, 401))
    heights[196:205, 196:205] = 0.06
    ground = GroundSurface(heights, -4.0, -4.0, 0.02, is_fine=True)
    light = Light(to_sun=(math.sqrt(0.75), 0.0, 0.5))
    world = _world(Relief(), light=light)
    renderer = CameraRenderer(world, threads=1, ground=ground)
    map_from_camera = transform((0.0, 0.0, 0.9), (0.0, math.radians(89.9), 0.0)) @ LINK_FROM_OPTICAL
    picture = renderer.render(map_from_camera, CAMERA, noise_seed=None)
    places = _back_project(picture, map_from_camera)
    grey = picture.image_rgb.mean(axis=2)
    beside = np.abs(places[..., 1]) < 0.06
    west = grey[beside & (places[..., 0] > -0.17) & (places[..., 0] < -0.12)].mean()
    east = grey[beside & (places[..., 0] < 0.17) & (places[..., 0] > 0.12)].mean()
    assert west < 0.75 * east


def test_a_stem_behind_a_clod_has_the_label_of_soil() -> None:
    heights = np.zeros((401, 401))
    plant = Plant(
        species="sugar_beet", plant=PlantClass.CROP, x_map_m=1.0, y_map_m=0.0, yaw_rad=0.0,
        size_m=0.1, seed=1,
    )  # fmt: skip
    world = _world(Relief(), plants=(plant,))
    map_from_camera = transform((0.0, 0.0, 0.15), (0.0, math.radians(8.0), 0.0)) @ LINK_FROM_OPTICAL

    def count_crop() -> int:
        ground = GroundSurface(heights, -4.0, -4.0, 0.02, is_fine=True)
        renderer = CameraRenderer(world, threads=1, ground=ground)
        picture = renderer.render(map_from_camera, CAMERA, noise_seed=None)
        return int((picture.class_id == int(PlantClass.CROP)).sum())

    open_px = count_crop()
    heights[190:212, 235:239] = 0.09  # a wall of clods in front of the plant
    assert 0 < count_crop() < 0.7 * open_px


@pytest.mark.parametrize(
    ("height_m", "down_deg", "allowed_ratio"),
    [
        (0.9, 45.0, 1e-3),
        pytest.param(0.9, 89.0, 1e-3, marks=pytest.mark.nightly),
        pytest.param(0.28, 0.0, 0.04, marks=pytest.mark.nightly),  # far off, heights are means
    ],
)
def test_plants_before_rough_ground_change_nothing_of_what_is_seen_between_them(
    height_m: float, down_deg: float, allowed_ratio: float
) -> None:
    rng = np.random.default_rng(4)
    plants = tuple(
        Plant(
            species="sugar_beet", plant=PlantClass.CROP, x_map_m=x, y_map_m=y, yaw_rad=0.0,
            size_m=0.15, seed=1,
        )
        for x, y in rng.uniform((-0.6, -1.0), (3.0, 1.0), (60, 2)).tolist()
    )  # fmt: skip
    bare = _look(_world(TILLED), down_deg, height_m=height_m)[0]
    planted = _look(_world(TILLED, plants=plants), down_deg, height_m=height_m)[0]
    between = np.isfinite(planted.depth_m) & (planted.instance < 0)
    assert 0.05 < between.mean() < 0.8
    change = np.abs(planted.depth_m[between] / bare.depth_m[between] - 1.0)
    assert np.quantile(change, 0.99) < allowed_ratio


def test_rough_ground_has_no_holes_up_to_the_horizon() -> None:
    for down_deg in (0.0, 20.0):
        picture, _ = _look(_world(TILLED), down_deg, height_m=0.28)
        row = np.arange(CAMERA.height_px) - (CAMERA.height_px - 1) / 2.0
        below_rad = np.arctan2(row, CAMERA.focal_px) + math.radians(down_deg)
        assert np.all(np.isfinite(picture.depth_m[below_rad > 0.03]))
        assert not np.any(np.isfinite(picture.depth_m[below_rad < -0.05]))


def test_wheel_ruts_show_in_the_next_picture() -> None:
    world = _world(TILLED)
    ground = build_ground_surface(world)
    renderer = CameraRenderer(world, threads=1, ground=ground)
    map_from_camera = transform((0.0, 0.0, 0.9), (0.0, math.radians(89.0), 0.0)) @ LINK_FROM_OPTICAL
    before = renderer.render(map_from_camera, CAMERA, noise_seed=None)
    middle = (
        int(-ground.y_min_m / ground.resolution_m),
        int(-ground.x_min_m / ground.resolution_m),
    )
    ground.height_m[middle[0] - 4 : middle[0] + 4, middle[1] - 4 : middle[1] + 4] -= 0.03
    renderer.follow_ground(0.0, 0.0)
    after = renderer.render(map_from_camera, CAMERA, noise_seed=None)
    changed = np.flatnonzero(np.any(before.image_rgb != after.image_rgb, axis=2).any(axis=1))
    assert 10 < len(changed) < CAMERA.height_px
    deeper = after.depth_m - before.depth_m
    assert np.quantile(deeper, 0.999) == pytest.approx(0.03, abs=0.006)
