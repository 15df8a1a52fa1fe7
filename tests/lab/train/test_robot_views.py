from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from agribot.cli.data.train import run
from agribot.core.errors import ConfigError
from agribot.core.messages import PlantClass
from agribot.description.field_generator import generate_field
from agribot.lab.train.farm import choose_plan, choose_turn_pose, draw_row_crop, draw_turn
from agribot.sim.random_scenes import CROPS, WEEDS, WIDE
from tests import nightly
from tests.lab.train.command_line import parsed


def test_one_seed_gives_the_same_views_of_the_same_rows() -> None:
    one, other = (list(draw_row_crop(np.random.default_rng(4), 2)) for _ in range(2))
    for (image, label, _), (image_again, label_again, _) in zip(one, other, strict=True):
        assert np.array_equal(image, image_again)
        assert np.array_equal(label, label_again)
    assert not np.array_equal(one[0][0], one[1][0])


@nightly.all_or_first("seeds", range(6), in_suite=3)
def test_a_robot_on_a_row_sees_its_crop_in_the_middle_of_the_picture(seeds: Sequence[int]) -> None:
    middles, sides = [], []
    for seed in seeds:
        for _, label, _ in draw_row_crop(np.random.default_rng([6, seed]), 2):
            crop = label == PlantClass.CROP
            middles.append(crop[:, 240:400].mean())
            sides.append((crop[:, 80:240].mean() + crop[:, 400:560].mean()) / 2.0)
    assert np.mean(middles) > 1.2 * np.mean(sides)


def test_robots_that_turn_look_anywhere_with_crop_in_reach() -> None:
    rng = np.random.default_rng(3)
    world = generate_field(choose_plan(rng), 5)
    crops_m = np.array([(p.x_map_m, p.y_map_m) for p in world.plants if p.plant == PlantClass.CROP])
    poses = [choose_turn_pose(rng, world) for _ in range(400)]
    headings = np.array([math.atan2(pose[1, 0], pose[0, 0]) for pose in poses])
    quarters, _ = np.histogram(headings, 4, (-math.pi, math.pi))
    assert quarters.min() > 60
    for pose in poses:
        assert np.hypot(*(crops_m - pose[:2, 3]).T).min() < 2.5


def test_one_seed_gives_the_same_views_of_the_same_turn() -> None:
    one, other = (list(draw_turn(np.random.default_rng(4), 2)) for _ in range(2))
    for (image, label, _), (image_again, label_again, _) in zip(one, other, strict=True):
        assert np.array_equal(image, image_again)
        assert np.array_equal(label, label_again)


def test_plans_vary_and_keep_to_the_species_of_their_variety() -> None:
    rng = np.random.default_rng(0)
    plans = [choose_plan(rng) for _ in range(60)]
    assert {plan.crop.species for plan in plans} == {name for name, *_ in CROPS}
    assert {name for plan in plans for name in plan.weeds.species} == set(WEEDS)
    spacings_m = [plan.crop.spacing_m for plan in plans]
    assert min(spacings_m) < 0.2 and max(spacings_m) > 1.5
    wide = {choose_plan(rng, variety=WIDE).crop.species for _ in range(60)}
    assert {"carrot", "onion"} <= wide


@pytest.mark.parametrize(
    "words",
    [("--row-images", "5"), ("--turn-images", "-1"), ("--row-images", "3", "--turn-images", "2")],
)
def test_more_images_of_the_robot_than_images_are_refused(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=words[0]):
        run(parsed("--images", "4", *words, "--out", str(tmp_path)))
