"""What networks are shown of fields as farms have them: relief, litter, all crops, seedlings."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agribot.cli.data.train_options import check_drawn_options
from agribot.core.errors import ConfigError
from agribot.core.geo import transform
from agribot.core.messages import PlantClass
from agribot.core.world import Relief, WorldSpec
from agribot.description.field_generator import generate_field, lay_parallel_rows
from agribot.description.loader import load_robot
from agribot.lab.train import sources
from agribot.lab.train.data import DataSet
from agribot.lab.train.farm import choose_plan, draw_row_crop, draw_turn
from agribot.lab.train.plant_truth import DrawnView, PlantTruth
from agribot.lab.train.rough_ground import roughen, stand_on
from agribot.lab.train.simulated import draw_random_field
from agribot.lab.train.sources import make_simulated_source
from agribot.sim.ground_surface import GroundSurface
from agribot.sim.random_scenes import (
    CROPS,
    DENSE,
    FIELD_WEEDS,
    ROUGH,
    STANDARD,
    add_posts,
    sample_field,
)
from tests import nightly
from tests.lab.train.command_line import parsed


def draw_worlds(count: int) -> list[WorldSpec]:
    worlds = []
    for seed in range(count):
        rng = np.random.default_rng([31, seed])
        worlds.append(roughen(sample_field(rng, ROUGH), (), ROUGH, rng))
    return worlds


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(60, id="60 fields"),
        pytest.param(120, id="120 fields", marks=pytest.mark.nightly),
    ],
)
def worlds(request: pytest.FixtureRequest) -> list[WorldSpec]:
    return draw_worlds(request.param)


def test_half_of_the_fields_have_the_relief_soil_and_light_of_a_preset(
    worlds: list[WorldSpec],
) -> None:
    rough = [world for world in worlds if world.relief.roughness_rms_m > 0.0]
    assert 0.38 < len(rough) / len(worlds) < 0.62
    for world in rough:
        assert 0.005 <= world.relief.roughness_rms_m <= 0.022
        assert world.relief.clods_per_m2 >= 4.0
        assert world.strength.soil_class != "rigid"
        assert world.soil.wet_ratio > 0.0
    assert all(world.relief == Relief() for world in worlds if world not in rough)
    heights_deg = [math.degrees(math.asin(world.light.to_sun[2])) for world in rough]
    assert min(heights_deg) < 30.0 and max(heights_deg) > 55.0
    assert max(world.soil.stones_ratio for world in rough) > 0.2  # the preset `hard`, too


def test_all_crops_and_weeds_occur_from_seedlings_on(worlds: list[WorldSpec]) -> None:
    crops = [p for world in worlds for p in world.plants if p.plant == PlantClass.CROP]
    species = {name: low_m for name, low_m, _ in CROPS} | {"carrot": 0.05, "onion": 0.08}
    for name, low_m in species.items():
        sizes_m = [plant.size_m for plant in crops if plant.species == name]
        assert min(sizes_m) < low_m, name
        assert max(sizes_m) > 2.0 * low_m, name
    weeds = {p.species for world in worlds for p in world.plants if p.plant == PlantClass.WEED}
    assert weeds == set(FIELD_WEEDS)


def test_ridges_run_under_the_rows_of_the_crop_and_some_have_wheel_tracks() -> None:
    reliefs = []
    for seed in range(40):
        rng = np.random.default_rng([32, seed])
        plan = choose_plan(rng, ROUGH)
        world = roughen(generate_field(plan, seed), lay_parallel_rows(plan.rows), ROUGH, rng)
        if not world.relief.rows:
            continue
        reliefs.append(world.relief)
        lines_m = np.array([row.start_map_m[0] for row in world.relief.rows])
        crops_m = [p.x_map_m for p in world.plants if p.plant == PlantClass.CROP]
        off_m = [np.abs(lines_m - x_m).min() for x_m in crops_m]
        assert np.percentile(off_m, 90) < 0.15
    assert max(relief.ridge_height_m for relief in reliefs) > 0.02
    tracked = [relief for relief in reliefs if relief.track_depth_m > 0.0]
    assert 0 < len(tracked) < len(reliefs)
    assert all(relief.track_gauge_m >= 0.5 for relief in tracked)


@nightly.all_or_first("seeds", range(40), in_suite=20)
def test_posts_stand_in_the_ground_near_the_crop_of_some_dense_fields(seeds: Sequence[int]) -> None:
    posts, with_posts = [], 0
    for seed in seeds:
        rng = np.random.default_rng([33, seed])
        field = sample_field(rng, DENSE)
        found = add_posts(field, DENSE, rng).obstacles[len(field.obstacles) :]
        with_posts += bool(found)
        crops_m = [(p.x_map_m, p.y_map_m) for p in field.plants if p.plant == PlantClass.CROP]
        for post in found:
            posts.append(post)
            assert min(math.dist(at_m, (post.x_map_m, post.y_map_m)) for at_m in crops_m) < 2.0
    assert 0.15 < with_posts / len(seeds) < 0.5
    for post in posts:
        (shape,) = post.shapes
        length_m = shape.size_m[1] if shape.kind == "cylinder" else shape.size_m[2]
        top_m, foot_m = post.z_map_m + length_m / 2.0, post.z_map_m - length_m / 2.0
        assert foot_m < -0.1 and 0.1 < top_m <= 1.2
    assert {post.kind for post in posts} == {"cylinder", "box"}


def test_a_variety_without_rough_fields_draws_no_number_more() -> None:
    rng, other = np.random.default_rng(5), np.random.default_rng(5)
    world = sample_field(rng)
    assert roughen(world, (), STANDARD, rng) is world
    assert add_posts(world, STANDARD, rng) is world
    sample_field(other)
    assert rng.random() == other.random()


def test_one_seed_gives_the_same_picture_of_the_same_rough_field() -> None:
    one, other = (list(draw_row_crop(np.random.default_rng([55, 5]), 2, ROUGH)) for _ in range(2))
    for (image, label, _), (image_again, label_again, _) in zip(one, other, strict=True):
        assert np.array_equal(image, image_again)
        assert np.array_equal(label, label_again)


@pytest.mark.parametrize(("rise", "lean"), [(0.0, 0.0), (0.1, 0.0), (0.0, -0.08), (-0.05, 0.06)])
def test_a_robot_on_a_plane_has_all_wheels_on_it(rise: float, lean: float) -> None:
    """`rise` and `lean` are the slopes of the plane along the robot and to its left."""
    yaw_rad, drive = 0.7, load_robot().drive
    east = rise * math.cos(yaw_rad) - lean * math.sin(yaw_rad)
    north = rise * math.sin(yaw_rad) + lean * math.cos(yaw_rad)
    axis_m = np.arange(-5.0, 5.01, 0.1)
    ground = GroundSurface(0.3 + axis_m * east + axis_m[:, None] * north, -5.0, -5.0, 0.1)
    pose = stand_on(ground, transform((1.0, -0.5, 0.0), (0.0, 0.0, yaw_rad)), drive)
    ahead_m, left_m = drive.wheelbase_m / 2.0, drive.track_m / 2.0
    for x, y in ((ahead_m, left_m), (ahead_m, -left_m), (-ahead_m, left_m), (-ahead_m, -left_m)):
        wheel_m = pose @ (x, y, 0.0, 1.0)
        below_m = 0.3 + wheel_m[0] * east + wheel_m[1] * north
        assert wheel_m[2] == pytest.approx(below_m, abs=2e-3)
    assert math.atan2(pose[1, 0], pose[0, 0]) == pytest.approx(yaw_rad, abs=0.01)


def test_each_set_of_a_rough_training_has_its_own_stream_and_variety(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here a picture shows nothing but the first number of its stream."""
    draw_set, varieties = sources.draw_set, {}

    def draw_quickly(
        args: argparse.Namespace, wanted: sources.WantedSet, *more: Any, **options: Any
    ) -> DataSet:
        varieties[wanted.name] = wanted.variety
        return draw_set(args, wanted._replace(drawer=draw_number), *more, **options)

    def number_of(stream: int) -> int:
        return int(next(draw_number(np.random.default_rng([0, stream, 0]), 1))[0].max())

    monkeypatch.setattr(sources, "draw_set", draw_quickly)
    words = ("--model", "agribot-sim", "--variety", "rough", "--images", "2", "--row-images", "1")
    few = ("--turn-images", "0", "--usual-images", "2", "--test-images", "2", "--precision", "int8")
    args = parsed(*words, *few, "--workers", "1", "--out", str(tmp_path))
    source = make_simulated_source(args, lambda line: None)
    assert source.train_images == 4 and "--usual-images 2 " in source.command
    taught = {int(picture.max()) for picture in source.pictures}
    assert {number_of(113), number_of(114)} < taught
    tests = {name: int(next(iter(read()))[0].max()) for name, read in source.tests.items()}
    streams = {
        "random-fields": 101, "farm": 102, "row-crops": 103, "turns": 106,
        "rough-fields": 107, "rough-rows": 108,
    }  # fmt: skip
    assert tests == {name: number_of(stream) for name, stream in streams.items()}
    usual = {"random-fields", "farm", "row-crops", "turns", "train-usual-rows", "train-usual-turns"}
    assert {name for name, variety in varieties.items() if variety is STANDARD} == usual
    assert {variety for name, variety in varieties.items() if name not in usual} == {ROUGH}


def draw_number(rng: np.random.Generator, views: int, variety: Any = None) -> Iterator[DrawnView]:
    number, label = rng.integers(256, dtype=np.uint8), np.full((48, 64), PlantClass.SOIL, np.uint8)
    none = PlantTruth(np.zeros((48, 64), np.uint16), np.zeros((0, 2)), np.zeros(0, np.uint8))
    for _ in range(views):
        yield DrawnView(np.full((48, 64, 3), number), label, none)


@nightly.by_day(
    "test_each_set_of_a_rough_training_has_its_own_stream_and_variety",
    "test_one_seed_gives_the_same_picture_of_the_same_rough_field",
)
@pytest.mark.slow
def test_a_network_of_rough_fields_is_judged_on_the_test_sets_of_all_and_on_rough_ones(
    tmp_path: Path,
) -> None:
    words = ("--model", "agribot-sim", "--variety", "rough", "--images", "2", "--row-images", "1")
    few = ("--turn-images", "0", "--usual-images", "2", "--test-images", "2", "--precision", "int8")
    args = parsed(*words, *few, "--out", str(tmp_path))
    source = make_simulated_source(args, lambda line: None)
    assert source.train_images == 4 and "--usual-images 2 " in source.command
    for name, stream, drawer in (("rows", 113, draw_row_crop), ("turns", 114, draw_turn)):
        drawn, _, _ = next(drawer(np.random.default_rng([args.seed, stream, 0]), 1))
        assert any(np.array_equal(drawn, picture) for picture in source.pictures), name
    usual = {"random-fields", "farm", "row-crops", "turns"}
    assert set(source.tests) == usual | {"rough-fields", "rough-rows"}
    image_rgb, _ = next(iter(source.tests["random-fields"]()))
    expected, _, _ = next(draw_random_field(np.random.default_rng([args.seed, 101, 0]), 1))
    assert np.array_equal(image_rgb, expected)


def test_more_usual_fields_are_refused_where_all_are_usual(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="leave it out with standard"):
        check_drawn_options(parsed("--usual-images", "2", "--out", str(tmp_path)))
