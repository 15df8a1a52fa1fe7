"""Wheels over crops and nozzles over weeds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.core.errors import PlatformError
from agribot.core.implement.kind import ImplementEffect, WetsLeaves
from agribot.core.messages import FloatArray, ImplementCommand, PlantClass
from agribot.core.robot import RobotSpec
from agribot.core.world import Plant, WorldSpec
from agribot.sim.field_effects import PlantDamage
from agribot.sim.flora.crown import find_crown_radius_m
from agribot.sim.footprints import Footprints, build_plant_grid, mark_swept
from agribot.sim.implements.kinds import fit_effect
from agribot.sim.state import HISTORY_COLUMNS


def _plant(x_m: float, y_m: float, plant: PlantClass = PlantClass.CROP) -> Plant:
    return Plant(
        species="sugar_beet", plant=plant, x_map_m=x_m, y_map_m=y_m, yaw_rad=0.0, size_m=0.2,
        seed=1, stem_radius_m=0.01,
    )  # fmt: skip


def _at(robot: RobotSpec, x_m: float, y_m: float, yaw_rad: float = 0.0) -> FloatArray:
    row = np.zeros(HISTORY_COLUMNS)
    row[:7] = x_m, y_m, robot.base_height_m, math.cos(yaw_rad / 2), 0, 0, math.sin(yaw_rad / 2)
    return row


def _world(world: WorldSpec, plants: Sequence[Plant]) -> WorldSpec:
    return msgspec.structs.replace(world, plants=tuple(plants))


def _drive(damage: PlantDamage, robot: RobotSpec, y_m: float, tick_m: float) -> set[int]:
    """Straight along East from -2 m to 2 m."""
    places = np.arange(-2.0, 2.0, tick_m)
    for k, (start, end) in enumerate(itertools.pairwise(places.tolist())):
        damage.update(0.02 * k, _at(robot, start, y_m), _at(robot, end, y_m))
    return damage.crushed


@pytest.mark.parametrize("tick_m", [0.004, 0.016, 0.2])
def test_crops_under_the_wheel_tracks_are_crushed_and_no_others(
    rover: RobotSpec, meadow: WorldSpec, tick_m: float
) -> None:
    # Wheel centre at 0.3908 m, 5 cm wide, stem 1 cm: 0.3558 .. 0.4258 m.
    lateral_m = [0.0, 0.35, 0.36, 0.39, 0.42, 0.43, -0.35, -0.36, -0.42, -0.43]
    world = _world(meadow, [_plant(0.013 * k, y) for k, y in enumerate(lateral_m)])
    assert _drive(PlantDamage(rover, world), rover, 0.0, tick_m) == {2, 3, 4, 7, 8}


def test_weeds_are_not_crop_damage(rover: RobotSpec, meadow: WorldSpec) -> None:
    world = _world(meadow, [_plant(0.0, 0.39, PlantClass.WEED), _plant(0.5, 0.39)])
    assert _drive(PlantDamage(rover, world), rover, 0.0, 0.016) == {1}


def test_a_field_without_crops_has_no_damage(rover: RobotSpec, meadow: WorldSpec) -> None:
    assert _drive(PlantDamage(rover, meadow), rover, 0.0, 0.1) == set()


def test_turning_on_the_spot_crushes_what_the_wheels_sweep(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    radius_m = math.hypot(0.2519, 0.3908)
    ring = [_plant(radius_m * math.cos(a), radius_m * math.sin(a)) for a in (0.1, 1.7, 3.0, 5.0)]
    world = _world(meadow, [*ring, _plant(0.0, 0.0), _plant(0.6, 0.0)])
    damage = PlantDamage(rover, world)
    for k in range(320):
        damage.update(0.02 * k, _at(rover, 0, 0, 0.01 * k), _at(rover, 0, 0, 0.01 * (k + 1)))
    assert damage.crushed == {0, 1, 2, 3}


def test_a_wheel_that_skids_sideways_crushes_what_is_between(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    world = _world(meadow, [_plant(0.2519, 0.57), _plant(0.2519, 0.65)])
    damage = PlantDamage(rover, world)
    damage.update(0.02, _at(rover, 0.0, 0.0), _at(rover, 0.0, 0.2))
    assert damage.crushed == {0}


@given(
    seed=st.integers(0, 10_000),
    yaw_rad=st.floats(-3.0, 3.0),
    x_m=st.floats(-3.0, 3.0),
    y_m=st.floats(-3.0, 3.0),
)
def test_grid_finds_the_same_plants_as_a_search_over_all(
    seed: int, yaw_rad: float, x_m: float, y_m: float
) -> None:
    xy = np.random.default_rng(seed).uniform(-2.0, 2.0, (200, 2))
    grid = build_plant_grid(xy, np.full(200, 0.02))
    feet = Footprints(np.array([[0.3, 0.1]]), 0.25, 0.1, 0.28)
    row = np.zeros(HISTORY_COLUMNS)
    row[:7] = x_m, y_m, 0.28, math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)
    hit_s = np.full(200, np.nan)
    mark_swept(row, row, feet, np.ones(1, dtype=bool), grid, hit_s, 1.0)
    turn = np.array(
        [[math.cos(yaw_rad), -math.sin(yaw_rad)], [math.sin(yaw_rad), math.cos(yaw_rad)]]
    )
    local = (xy - (x_m, y_m)) @ turn - (0.3, 0.1)
    beyond = np.maximum(np.abs(local) - (0.25, 0.1), 0.0)
    assert np.array_equal(~np.isnan(hit_s), np.hypot(*beyond.T) <= 0.02)


def _fit(robot: RobotSpec, world: WorldSpec) -> ImplementEffect:
    return fit_effect(robot.implement, world, robot.base_height_m)


def _spray(
    sprayer: ImplementEffect, robot: RobotSpec, nozzles: dict[int, tuple[bool, ...]], ticks: int
) -> None:
    """1 cm per tick of 20 ms along East from 0; commands by tick."""
    for k in range(ticks):
        if k in nozzles:
            sprayer.command(0.02 * k, ImplementCommand(sections_on=nozzles[k]))
        sprayer.update(
            0.02 * (k + 1), _at(robot, 0.01 * k, 0.0), _at(robot, 0.01 * (k + 1), 0.0), 0.02
        )


def test_an_open_nozzle_sprays_its_own_strip(rover: RobotSpec, meadow: WorldSpec) -> None:
    # Boom at x = -0.4 m; the third nozzle of eight is at y = +0.15 m and 0.1 m wide.
    lateral_m = [0.09, 0.11, 0.19, 0.21, -0.15]
    world = _world(meadow, [_plant(0.0, y, PlantClass.WEED) for y in lateral_m])
    sprayer = _fit(rover, world)
    only_third = tuple(k == 2 for k in range(8))
    _spray(sprayer, rover, {0: only_third}, 100)
    assert set(sprayer.treated) == {1, 2}
    # The fan is 4 cm long: the first drop falls 2 cm before the boom is above, at 0.38 m.
    assert sprayer.treated[1] == pytest.approx(0.38 / 0.01 * 0.02, abs=0.021)


def test_valves_follow_after_their_latency(rover: RobotSpec, meadow: WorldSpec) -> None:
    sprayer = _fit(rover, meadow)
    _spray(sprayer, rover, {0: (True,) * 8, 10: (False,) * 8}, 100)
    # Open for 10 ticks, 0.1 s late at both ends; eight strips of 0.1 m.
    assert sprayer.worked_m2 == pytest.approx(8 * 0.1 * 10 * 0.01, rel=1e-6)


def test_no_drop_falls_before_the_latency_is_over(rover: RobotSpec, meadow: WorldSpec) -> None:
    world = _world(meadow, [_plant(-0.4, 0.15, PlantClass.WEED)])
    sprayer = _fit(rover, world)
    sprayer.command(0.0, ImplementCommand(sections_on=(True,) * 8))
    for k in range(10):
        sprayer.update(0.02 * (k + 1), _at(rover, 0, 0), _at(rover, 0, 0), 0.02)
    # The first tick that begins 0.1 s after the command.
    assert sprayer.treated == {0: pytest.approx(0.12)}


def test_an_empty_command_closes_all_nozzles(rover: RobotSpec, meadow: WorldSpec) -> None:
    sprayer = _fit(rover, meadow)
    _spray(sprayer, rover, {0: (True,) * 8, 10: ()}, 100)
    assert sprayer.worked_m2 == pytest.approx(0.08, rel=1e-6)


def test_wrong_number_of_nozzles_is_refused(rover: RobotSpec, meadow: WorldSpec) -> None:
    with pytest.raises(PlatformError, match="3 nozzles; the robot has 8"):
        _fit(rover, meadow).command(0.0, ImplementCommand(sections_on=(True, True, False)))


def test_a_crop_is_hit_on_its_heart_and_a_weed_on_its_middle(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    """The third nozzle wets y from 0.10 to 0.20 m; a heart is a disc of 2 cm."""
    crops = [_plant(0.0, y, PlantClass.CROP) for y in (0.075, 0.085, 0.215, 0.225)]
    weeds = [_plant(0.3, y, PlantClass.WEED) for y in (0.085, 0.215)]
    sprayer = _fit(rover, _world(meadow, [*crops, *weeds]))
    _spray(sprayer, rover, {0: tuple(k == 2 for k in range(8))}, 100)
    assert set(sprayer.treated) == {1, 2}


def test_the_share_of_wet_leaves_is_that_of_the_crown_under_the_spray(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    under, half, beside = (_plant(0.0, y, PlantClass.CROP) for y in (0.15, 0.1, 0.6))
    radius_m = find_crown_radius_m(under.species, under.size_m)
    sprayer = _fit(rover, _world(meadow, [under, half, beside]))
    assert isinstance(sprayer, WetsLeaves)
    _spray(sprayer, rover, {0: tuple(k in (2, 3) for k in range(8))}, 100)  # y from 0.0 to 0.2 m
    wet = sprayer.wet_leaves
    assert set(wet) == {0, 1} and radius_m > 0.1
    assert msgspec.json.encode([wet, sprayer.offsets_m]), "both go into the file of the mission"
    # Leaf area is spread evenly over the radius: 0.1 / radius of it is within 10 cm of the stem.
    assert 0.1 / radius_m <= wet[1] < 1.0
    _spray(sprayer, rover, {0: (True,) * 8}, 100)
    assert sprayer.wet_leaves[0] > 0.9
    assert 0.0 < sprayer.wet_leaves[2] < 0.5


def test_the_offset_of_a_weed_is_its_distance_from_the_middle_of_the_nozzle(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    places = [(0.0, 0.15), (0.1, 0.18), (0.2, 0.22), (0.3, 0.26)]
    sprayer = _fit(rover, _world(meadow, [_plant(x, y, PlantClass.WEED) for x, y in places]))
    assert isinstance(sprayer, WetsLeaves)
    _spray(sprayer, rover, {0: tuple(k == 2 for k in range(8))}, 100)
    assert sprayer.offsets_m == {
        0: pytest.approx(0.0, abs=1e-6), 1: pytest.approx(0.03), 2: pytest.approx(0.07),
    }  # fmt: skip


def test_an_offset_along_the_way_counts_from_where_the_nozzle_opened(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    sprayer = _fit(rover, _world(meadow, [_plant(-0.36, 0.15, PlantClass.WEED)]))
    assert isinstance(sprayer, WetsLeaves)
    # Opens 0.1 s after tick 5, 10 cm on; the boom is 0.4 m behind.
    _spray(sprayer, rover, {5: tuple(k == 2 for k in range(8))}, 40)
    assert sprayer.offsets_m == {0: pytest.approx(0.06, abs=0.001)}
