"""Blades in the simulated soil: what they cut, when, and how the soil holds them back."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.errors import PlatformError
from agribot.core.implement.hoe import HoeSpec
from agribot.core.messages import (
    DriveCommand,
    FloatArray,
    ImplementCommand,
    PlantClass,
    RobotCommand,
)
from agribot.core.robot import RobotSpec
from agribot.core.world import Plant, WorldSpec
from agribot.sim.implements.hoe import HoeEffect
from agribot.sim.platform import SimPlatform
from agribot.sim.state import HISTORY_COLUMNS

HOE = HoeSpec(
    x_body_m=0.0, section_count=2, section_spacing_m=0.5, section_width_m=0.4, latency_s=0.0,
    lift_m=0.04, depth_m=0.02, stroke_s=0.3, draught_npm2=750.0,
)  # fmt: skip
TICK_S = 0.02
DOWN = ImplementCommand(sections_on=(True, True))
UP = ImplementCommand(sections_on=(False, False))


def _world(meadow: WorldSpec, kind: PlantClass, every_m: float = 0.02) -> WorldSpec:
    """A line of plants along East, under the left blade."""
    plants = tuple(
        Plant(
            species="x", plant=kind, x_map_m=every_m * k, y_map_m=0.25, yaw_rad=0.0, size_m=0.1,
            seed=0, stem_radius_m=0.001,
        )
        for k in range(200)
    )  # fmt: skip
    return msgspec.structs.replace(meadow, plants=plants)


def _row(x_m: float, v_mps: float) -> FloatArray:
    row = np.zeros(HISTORY_COLUMNS)
    row[:7] = x_m, 0.0, 0.28, 1.0, 0.0, 0.0, 0.0
    row[7] = v_mps
    return row


def _drive(effect: HoeEffect, commands: dict[int, ImplementCommand], v_mps: float) -> None:
    """Two seconds along East from 0; commands by tick."""
    for k in range(100):
        if k in commands:
            effect.command(TICK_S * k, commands[k])
        way_m = v_mps * TICK_S
        before, after = _row(way_m * k, v_mps), _row(way_m * (k + 1), v_mps)
        effect.update(TICK_S * (k + 1), before, after, TICK_S)


def _touched_m(effect: HoeEffect, every_m: float = 0.02) -> tuple[float, float]:
    places = [every_m * index for index in effect.treated]
    return min(places), max(places)


def test_a_crop_is_cut_at_any_depth_and_a_weed_only_near_the_whole_of_it(
    meadow: WorldSpec,
) -> None:
    crops = HoeEffect(HOE, _world(meadow, PlantClass.CROP), 0.28)
    weeds = HoeEffect(HOE, _world(meadow, PlantClass.WEED), 0.28)
    for effect in (crops, weeds):
        _drive(effect, {0: DOWN, 50: UP}, 0.5)
    first_cut_m, last_cut_m = _touched_m(crops)
    first_m, last_m = _touched_m(weeds)
    # Six centimetres of stroke in 0.3 s, four of them above the ground: 0.2 s at 0.5 m/s.
    assert first_cut_m == pytest.approx(0.1, abs=0.03)
    assert first_m == pytest.approx(0.14, abs=0.03) and first_m > first_cut_m
    assert last_cut_m == pytest.approx(0.5 + 0.05, abs=0.03)
    assert last_m < last_cut_m


def test_a_raised_hoe_touches_nothing_and_holds_nothing_back(meadow: WorldSpec) -> None:
    effect = HoeEffect(HOE, _world(meadow, PlantClass.CROP), 0.28)
    _drive(effect, {0: UP}, 0.5)
    assert not effect.treated and effect.worked_m2 == 0.0 and effect.pull() is None


def test_a_blade_that_stands_or_crawls_uproots_nothing(meadow: WorldSpec) -> None:
    for v_mps in (0.0, 0.05):
        effect = HoeEffect(HOE, _world(meadow, PlantClass.WEED), 0.28)
        _drive(effect, {0: DOWN}, v_mps)
        assert not effect.treated and effect.worked_m2 == 0.0


def test_an_empty_command_lifts_all_blades(meadow: WorldSpec) -> None:
    effect = HoeEffect(HOE, meadow, 0.28)
    _drive(effect, {0: DOWN, 50: ImplementCommand()}, 0.5)
    assert effect.pull() is None


def test_the_soil_pulls_against_the_way_by_depth_and_width_and_not_at_rest(
    meadow: WorldSpec,
) -> None:
    effect = HoeEffect(HOE, meadow, 0.28)
    _drive(effect, {0: DOWN}, 1.0)
    pull = effect.pull()
    assert pull is not None
    full_n = 750.0 * 0.02 * 2 * 0.4
    assert pull.force_map_n[0] == pytest.approx(-full_n, rel=0.02)
    assert pull.force_map_n[1:] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert pull.place_map_m == pytest.approx((2.0, 0.0, 0.0), abs=1e-6)
    half = ImplementCommand(sections_on=(True, False), setpoints={"depth_m": 0.01})
    effect.command(2.0, half)
    for k in range(40):
        effect.update(2.0 + TICK_S * (k + 1), _row(2.0, 1.0), _row(2.0, 1.0), TICK_S)
    one = effect.pull()
    assert one is not None
    assert one.force_map_n[0] == pytest.approx(-full_n / 4.0, rel=0.02)
    assert one.place_map_m[1] == pytest.approx(0.25)  # the left one: it pulls the robot round
    effect.update(3.0, _row(2.0, 0.0), _row(2.0, 0.0), TICK_S)
    still = effect.pull()
    assert still is not None and still.force_map_n[0] == 0.0


@pytest.mark.parametrize("depth_m", [0.03, 0.0, -0.01, math.nan])
def test_a_depth_that_the_blades_do_not_reach_is_refused(meadow: WorldSpec, depth_m: float) -> None:
    effect = HoeEffect(HOE, meadow, 0.28)
    with pytest.raises(PlatformError, match=r"reach 0\.02 m"):
        effect.command(0.0, msgspec.structs.replace(DOWN, setpoints={"depth_m": depth_m}))


def test_blades_in_the_soil_cost_the_motors_what_the_draught_is(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    robot = msgspec.structs.replace(rover, implement=HOE)
    torque_nm: dict[bool, float] = {}
    for is_down in (False, True):
        settings = RunConfig(
            perception=PerceptionConfig(enabled=False), sim=SimConfig(sensors="ideal")
        )
        platform = SimPlatform(settings, robot, meadow)
        told = RobotCommand(
            t_s=0.0, drive=DriveCommand(v_mps=0.4), implement=DOWN if is_down else UP
        )
        efforts = []
        for tick in range(200):
            batch = platform.read()
            platform.write(told)
            if tick >= 100:
                efforts += [sum(wheel.effort_nm or ()) for wheel in batch.wheels]
        torque_nm[is_down] = float(np.mean(efforts))
        platform.close()
    draught_n = 750.0 * 0.02 * 2 * 0.4 * 0.4 / math.hypot(0.4, 0.1)
    more_n = (torque_nm[True] - torque_nm[False]) / robot.drive.wheel_radius_m
    assert more_n == pytest.approx(draught_n, rel=0.1)
