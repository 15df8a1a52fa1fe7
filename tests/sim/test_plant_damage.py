"""What the whole robot does to plants: stems, leaves under tyres, what passes over them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig
from agribot.core.messages import DriveCommand, FloatArray, PlantClass, RobotCommand
from agribot.core.robot import Joint, Link, Origin, RobotSpec, Shape
from agribot.core.world import Plant, WorldSpec
from agribot.description.loader import load_robot
from agribot.sim.field_effects import PlantDamage
from agribot.sim.flora.crown import RADIUS_RATIO, find_crown_radius_m, make_leaf_places
from agribot.sim.flora.species import SPECIES, build_plant_lods
from agribot.sim.ground_surface import GroundSurface
from agribot.sim.plant_states import PlantStates
from agribot.sim.platform import SimPlatform
from agribot.sim.state import HISTORY_COLUMNS
from agribot.sim.underside import Part, build_underside
from tests import nightly

LOW_M = 0.06  # clearance of a small four-wheel rover


@dataclass
class Passage:
    crushed: set[int]
    brushed: set[int]
    by: list[int]


def _plant(x_m: float, y_m: float, size_m: float = 0.2, species: str = "sugar_beet") -> Plant:
    return Plant(
        species=species, plant=PlantClass.CROP, x_map_m=x_m, y_map_m=y_m, yaw_rad=0.0,
        size_m=size_m, seed=1, stem_radius_m=0.01,
    )  # fmt: skip


def _lowered(robot: RobotSpec, clearance_m: float) -> RobotSpec:
    """The rover with a plate of 0.5 x 0.5 m as its belly."""
    down_m = clearance_m + 0.01 - robot.base_height_m
    plate = Shape(kind="box", size_m=(0.5, 0.5, 0.02), origin=Origin(xyz_m=(0.0, 0.0, down_m)))
    links = (msgspec.structs.replace(robot.links[0], collisions=(plate,)), *robot.links[1:])
    return msgspec.structs.replace(robot, links=links)


def _at(robot: RobotSpec, x_m: float) -> FloatArray:
    row = np.zeros(HISTORY_COLUMNS)
    row[:4] = x_m, 0.0, robot.base_height_m, 1.0
    return row


def _pass(
    robot: RobotSpec,
    world: WorldSpec,
    plants: Sequence[Plant],
    *,
    tick_m: float = 0.008,
    ground: GroundSurface | None = None,
) -> Passage:
    """Drive East over plants, from -1.2 m to 1.2 m."""
    field = msgspec.structs.replace(world, plants=tuple(plants))
    damage = PlantDamage(robot, field, ground=ground)
    places = np.arange(-1.2, 1.2, tick_m).tolist()
    for k, (start, end) in enumerate(itertools.pairwise(places)):
        damage.update(0.02 * k, _at(robot, start), _at(robot, end))
    return Passage(damage.crushed, damage.brushed, damage.states.crushed_by.tolist())


@pytest.mark.parametrize("tick_m", [0.008, 0.1])
def test_a_belly_6_cm_up_crushes_beets_of_20_cm_and_says_so(
    rover: RobotSpec, meadow: WorldSpec, tick_m: float
) -> None:
    beets = [_plant(0.1 * k, y) for k, y in enumerate((0.0, 0.2, -0.2, 0.3, 0.6))]
    seen = _pass(_lowered(rover, LOW_M), meadow, beets, tick_m=tick_m)
    assert seen.crushed == {0, 1, 2}
    assert seen.by == [Part.BELLY] * 3 + [0, 0]
    assert seen.brushed == {3, 4}  # beside the plate: their leaves reach below it


@pytest.mark.parametrize(
    ("height_m", "is_touched", "is_crushed"),
    [(0.055, False, False), (0.065, True, False), (0.115, True, False), (0.125, True, True)],
)
def test_a_stem_bends_out_of_the_way_until_it_is_pressed_below_half_its_height(
    rover: RobotSpec, meadow: WorldSpec, height_m: float, is_touched: bool, is_crushed: bool
) -> None:
    seen = _pass(_lowered(rover, LOW_M), meadow, [_plant(0.0, 0.0, height_m)])
    assert bool(seen.crushed) == is_crushed
    assert bool(seen.crushed | seen.brushed) == is_touched


def test_the_packaged_robot_touches_no_beet_that_it_drives_astride(meadow: WorldSpec) -> None:
    robot = load_robot()
    seen = _pass(robot, meadow, [_plant(0.3 * k - 0.6, 0.0, 0.22) for k in range(5)])
    assert seen.crushed == seen.brushed == set()
    clearance_m = build_underside(robot).clearance_m
    assert clearance_m[clearance_m.shape[0] // 2, clearance_m.shape[1] // 2] > 0.25


def test_a_wheel_beside_the_stem_presses_the_leaves_on_its_track(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    """The share of the leaf area under a strip, by the integral over an even radial density."""
    radius_m, half_m = find_crown_radius_m("sugar_beet", 0.2), rover.drive.wheel_width_m / 2.0
    away_m = np.linspace(0.05, 0.15, 21)
    plants = [_plant(0.0, rover.drive.track_m / 2.0 - away, 0.2) for away in away_m.tolist()]
    damage = PlantDamage(rover, msgspec.structs.replace(meadow, plants=tuple(plants)))
    for start, end in itertools.pairwise(np.arange(-1.0, 1.0, 0.01).tolist()):
        damage.update(1.0, _at(rover, start), _at(rover, end))
    r, angle = np.meshgrid(np.linspace(0, radius_m, 400), np.linspace(0, 2 * np.pi, 400))
    across_m = (r * np.sin(angle))[None]
    expected = np.mean(np.abs(across_m - away_m[:, None, None]) < half_m)
    assert damage._crowns.pressed.mean() == pytest.approx(expected, rel=0.1)
    assert damage.crushed == set() and damage.brushed == set(range(21))


def test_tyres_on_both_sides_of_a_stem_crush_the_plant_that_one_alone_brushes(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    wide = msgspec.structs.replace(
        rover, drive=msgspec.structs.replace(rover.drive, wheel_width_m=0.3)
    )
    stem_m = rover.drive.track_m / 2.0 - 0.15 - 0.015  # beside the tyre's inner edge
    damage = PlantDamage(wide, msgspec.structs.replace(meadow, plants=(_plant(0.0, stem_m),)))
    beyond_m = stem_m - 0.015 - 0.15 - rover.drive.track_m / 2.0
    for y_m, expected in ((0.0, set[int]()), (beyond_m, {0})):
        for start, end in itertools.pairwise(np.arange(-1.0, 1.0, 0.02).tolist()):
            rows = _at(wide, start), _at(wide, end)
            for row in rows:
                row[1] = y_m
            damage.update(1.0 + y_m, *rows)
        assert damage.crushed == expected and damage.brushed == {0} - expected
    assert damage.states.crushed_by[0] == Part.WHEEL
    assert np.isnan(damage._hit_s[0])  # no tyre was on the stem


def test_what_hangs_from_a_boom_is_the_implement(rover: RobotSpec, meadow: WorldSpec) -> None:
    bar = Shape(
        kind="cylinder", size_m=(0.01, 1.4, 0.0), origin=Origin(rpy_rad=(math.pi / 2, 0, 0))
    )
    boom = Link(name="spray_boom_link", collisions=(bar,))
    joint = Joint(
        name="boom", kind="fixed", parent="base_link", child="spray_boom_link",
        origin=Origin(xyz_m=(-0.4, 0.0, 0.07 - rover.base_height_m)),
    )  # fmt: skip
    robot = msgspec.structs.replace(
        rover, links=(*rover.links, boom), joints=(*rover.joints, joint)
    )
    seen = _pass(robot, meadow, [_plant(0.0, 0.65), _plant(0.0, 1.2)])
    assert seen.crushed == {0} and seen.by == [Part.IMPLEMENT, 0]


def test_a_plant_on_a_ridge_meets_a_belly_that_passes_over_one_on_the_flat(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    height_m = np.zeros((81, 121))  # 5 cm apart, from -3 m and -2 m on
    height_m[40, :] = 0.12  # at y = 0
    ridge = GroundSurface(height_m, -3.0, -2.0, 0.05)
    plants = [_plant(0.0, 0.0, 0.15)]
    assert _pass(rover, meadow, plants).brushed == set()
    assert _pass(rover, meadow, plants, ground=ridge).brushed == {0}


def test_what_lies_is_neither_crushed_again_nor_touched(rover: RobotSpec) -> None:
    states = PlantStates(3)
    states.cut(0, 1.0, 0.0)
    states.crush(0, 2.0, Part.WHEEL, 0.0)
    states.crush(1, 3.0, Part.BELLY, 0.5)
    states.crush(1, 4.0, Part.WHEEL, 1.0)
    states.cut(1, 5.0, 2.0)
    states.spray(2, 6.0)
    assert states.fallen == (0, 1)
    assert states.crushed_by.tolist() == [0, Part.BELLY, 0]
    assert (states.find_fall_s(0), states.find_fall_s(1), states.way_rad[1]) == (1.0, 3.0, 0.5)
    assert math.isnan(states.find_fall_s(2)) and bool(states.is_standing[2])


def test_a_plant_that_an_earlier_run_crushed_lies_from_the_beginning(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    world = msgspec.structs.replace(meadow, plants=(_plant(1.0, 0.39), _plant(3.0, 0.39)))
    config = RunConfig(perception=PerceptionConfig(enabled=False))
    platform = SimPlatform(config, rover, world)
    platform.restore_plants({0: Part.BELLY}, ())
    for _ in range(250):
        batch = platform.read()
        platform.write(RobotCommand(t_s=batch.t_s, drive=DriveCommand(v_mps=0.8)))
    assert platform.crushed == {0, 1} and platform.plants.fallen == (0, 1)
    assert platform.plants.crushed_by.tolist() == [Part.BELLY, Part.WHEEL]


def test_the_underside_is_the_lowest_point_of_every_shape(rover: RobotSpec) -> None:
    clearance_m = build_underside(_lowered(rover, 0.11)).clearance_m
    assert clearance_m.min() == pytest.approx(0.11, abs=1e-9)
    assert np.isfinite(clearance_m).all()  # a whole plate: no holes between the points
    assert clearance_m.shape == pytest.approx((26, 26), abs=1)
    lying = Shape(
        kind="cylinder", size_m=(0.05, 0.6, 0.0), origin=Origin(rpy_rad=(math.pi / 2, 0, 0))
    )
    links = (msgspec.structs.replace(rover.links[0], collisions=(lying,)), *rover.links[1:])
    round_m = build_underside(msgspec.structs.replace(rover, links=links)).clearance_m
    assert round_m.min() == pytest.approx(rover.base_height_m - 0.05, abs=1e-3)
    assert round_m[0].min() > round_m.min() + 0.01  # its side is higher than its bottom


@nightly.one_by_one("species", [*SPECIES], in_suite=1)
def test_a_crown_reaches_as_far_as_the_leaves_of_the_mesh(species: str) -> None:
    """95 % of the leaf area lies within 95 % of the radius, in the mean of all plants."""
    for stage, ratio in zip(SPECIES[species].stages, RADIUS_RATIO[species], strict=True):
        within = []
        for variant in range(12):
            mesh = build_plant_lods(species, variant, stage)[0]
            corners = mesh.vertices_m[mesh.faces]
            sides = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
            area = np.linalg.norm(np.cross(*sides), axis=1)
            away = np.hypot(*corners.mean(axis=1)[:, :2].T)
            within.append(area[away < 0.95 * ratio].sum() / area.sum())
        assert np.mean(within) == pytest.approx(0.95, abs=0.06)


def test_the_places_of_the_leaves_lie_evenly_over_the_radius_in_every_direction() -> None:
    places = make_leaf_places()
    assert np.hypot(*places[:, :2].T).mean() == pytest.approx(0.5, abs=1e-9)
    assert np.abs(places[:, :2].mean(axis=0)).max() < 0.05
