"""A robot with a map of the crop from an earlier run: its place, its row, and where it was put."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.filter.history import Motion
from agribot.autonomy.estimate.filter.stem_map import StemMap
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.sensors.plant_belief import PlantBelief
from agribot.autonomy.estimate.sensors.plant_places import SURE, TURN_RAD
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.facts import NoFixesYet, PlantsElsewhere, WhichRow
from agribot.core.messages import ControlMission, Estimate, FloatArray, SensorBatch
from agribot.core.pose import Pose2
from tests import nightly
from tests.asking import ask
from tests.autonomy.estimate.noisy_rover import M8N, Recording, record
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import batches, error
from tests.autonomy.estimate.row_plants import Faults, grow, scenes_of
from tests.finding import holds, is_like

# Eight rows that run North, a metre apart; the robot drives the fourth.
FIELD = FieldConfig(
    first_row_start_map_m=(0.0, 0.0), row_yaw_deg=90.0, row_length_m=12.0, row_count=8,
    start_map_m=(3.0, -1.0), start_yaw_deg=90.0,
)  # fmt: skip
ANYWHERE = msgspec.structs.replace(FIELD, start_map_m=None, start_yaw_deg=None)
# Small, as the search for a place costs as much as there are plants.
SMALL = msgspec.structs.replace(ANYWHERE, row_count=5, row_length_m=8.0)
ONE_OFF = msgspec.structs.replace(FIELD, start_map_m=(2.0, -1.0))
PLANTED = Faults(bare_ratio=0.1)
REGULAR = Faults(planting_std_m=0.0, bare_ratio=0.0)
START, SPACING_M = (3.0, -1.0, math.pi / 2), 0.25
MAP_STD_M, UNMAPPED_RATIO = 0.02, 0.05
HERE_M = 0.15


def straight(t_s: float) -> tuple[float, float]:
    """Stand for three seconds, then drive along the row."""
    return (0.0, 0.0) if t_s < 3.0 else (0.5, 0.0)


class Drive(NamedTuple):
    recording: Recording
    estimates: list[Estimate]
    into: Localizer


def drive(
    seed: int, field: FieldConfig, faults: Faults = PLANTED, *, has_map: bool = True,
    has_gnss: bool = True, mapped: FloatArray | None = None,
    start: tuple[float, float, float] = START, resume: bool = False, duration_s: float = 20.0,
) -> Drive:  # fmt: skip
    """Drive a row that an earlier run mapped; with `resume` a person believes the plants."""
    rng = np.random.default_rng(seed + 2000)
    plants = grow(field, SPACING_M, faults, rng)
    recording = record(straight, duration_s, seed=seed, errors=M8N, start=start)
    if not has_gnss:
        recording = msgspec.structs.replace(recording, fixes=())
    seen = scenes_of(recording, plants, faults, rng)
    into = Localizer(EstimateConfig(), field, robot())
    if has_map:
        into.take_plants(StemMap(_map(plants, rng) if mapped is None else mapped))
    estimates, at = list[Estimate](), 0
    for batch in batches(recording):
        asked = bool(estimates) and holds(estimates[-1].contradiction_fact, PlantsElsewhere)
        if asked and resume:
            estimates.append(into.update(_resume(batch)))
        else:
            estimates.append(into.update(batch))
        while at < len(seen) and seen[at].ready_s <= batch.t_s + 1e-9:
            into.observe(seen[at])
            at += 1
    return Drive(recording, estimates, into)


def _map(plants: FloatArray, rng: np.random.Generator) -> FloatArray:
    kept = plants[rng.random(len(plants)) >= UNMAPPED_RATIO]
    mapped: FloatArray = kept + MAP_STD_M * rng.standard_normal(kept.shape)
    return mapped


def _resume(batch: SensorBatch) -> SensorBatch:
    event = ask(ControlMission(action="resume"), "a person", t_s=batch.t_s)
    return msgspec.structs.replace(batch, requests=(event,))


def off(driven: Drive, after_s: float = 0.0) -> FloatArray:
    """Errors East, North and of the heading while the robot says it knows its place, (N, 3)."""
    rows = [
        error(driven.recording, each) for each in driven.estimates if each.ok and each.t_s > after_s
    ]
    return np.array(rows).reshape(-1, 3)


def rms(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean()))


@nightly.all_or_first("seeds", range(10), in_suite=1)
def test_mapped_plants_tell_a_cheap_receiver_its_place_along_the_row(
    seeds: Sequence[int],
) -> None:
    along, without = [], []
    for seed in seeds:
        along.append(off(drive(seed, FIELD), after_s=13.0)[:, 1])
        without.append(off(drive(seed, FIELD, has_map=False), after_s=13.0)[:, 1])
    assert rms(np.concatenate(along)) < 0.05
    assert rms(np.concatenate(without)) > 2.0 * rms(np.concatenate(along))


@nightly.all_or_first("seeds", range(10), in_suite=1)
def test_put_down_one_row_aside_in_mid_field_the_plants_tell_which_row_it_is(
    seeds: Sequence[int],
) -> None:
    for seed in seeds:
        driven = drive(seed, ONE_OFF, resume=True)
        assert np.abs(off(driven)[-1, :2]).max() < HERE_M
        asked = [each.contradiction_fact for each in driven.estimates if each.contradiction_fact]
        assert asked
        assert all(isinstance(each, WhichRow | PlantsElsewhere) for each in asked)
        assert all(getattr(each, "side", "") == "right" for each in asked)
        aside = PlantsElsewhere(ANY, ANY, ANY, ANY, 1.0, "right")  # rows are a metre apart
        assert any(is_like(each, aside, within=0.055) for each in asked)


def test_without_a_map_the_same_robot_goes_on_in_the_row_in_which_it_believes_to_be() -> None:
    driven = drive(0, ONE_OFF, has_map=False, duration_s=12.0)
    assert abs(off(driven)[-1, 0]) > 0.8


@nightly.all_or_first("seeds", range(10), in_suite=1)
def test_set_down_anywhere_without_gnss_it_finds_itself_and_is_never_sure_of_a_wrong_place(
    seeds: Sequence[int],
) -> None:
    found = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        start = (float(rng.integers(0, 8)), float(rng.uniform(-1.0, 3.0)), math.pi / 2)
        deviation = off(drive(seed, ANYWHERE, has_gnss=False, start=start))
        found += bool(len(deviation))
        assert not len(deviation) or np.abs(deviation[:, :2]).max() < 2.0 * HERE_M
    assert found >= 0.5 * len(seeds)


def test_places_move_along_the_way_as_the_heading_turns_it_that_the_plants_have_shown() -> None:
    """Two pieces of way by a compass that is 6 degrees off, where the row is not known."""
    off_rad, rng = math.radians(6.0), np.random.default_rng(2)
    plants = grow(SMALL, SPACING_M, PLANTED, rng)
    recording = record(straight, 13.0, seed=2, errors=M8N, start=(2.0, 0.0, math.pi / 2))
    belief = PlantBelief(StemMap(plants))
    for scene in scenes_of(recording, plants, PLANTED, rng):
        x_m, y_m, yaw_rad = recording.pose(scene.t_s)
        way_m = Pose2(0.0, 0.0, -off_rad).rotate(x_m - 2.0, y_m)
        then = Motion(scene.t_s, *way_m, yaw_rad - math.pi / 2, 0.5, 0.0)
        turns_rad = [step * TURN_RAD for step in range(-5, 6)]
        belief.add(scene, then, yaw_rad - off_rad, (x_m, y_m, 2.3), turns_rad, None)
    best = belief.places[0]
    assert best.share > SURE
    assert math.hypot(best.x_map_m - x_m, best.y_map_m - y_m) < 2.0 * HERE_M
    assert math.degrees(best.turn_rad) == pytest.approx(6.0, abs=1.5)


def test_where_all_plants_stand_like_all_others_it_says_that_it_does_not_know() -> None:
    driven = drive(
        3, SMALL, REGULAR, has_gnss=False, start=(3.0, 2.0, math.pi / 2), duration_s=14.0
    )
    assert not any(each.ok for each in driven.estimates)
    assert holds(driven.estimates[-1].fact, NoFixesYet)


@nightly.by_day(
    "test_where_all_plants_stand_like_all_others_it_says_that_it_does_not_know",
)
def test_on_a_map_of_another_field_it_takes_nothing_for_its_place() -> None:
    other = grow(FIELD, SPACING_M, PLANTED, np.random.default_rng(9))
    driven = drive(4, ANYWHERE, has_gnss=False, mapped=other, duration_s=14.0)
    assert not any(each.ok for each in driven.estimates)
