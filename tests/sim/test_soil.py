"""Soil that gives way: slip, sinkage, ruts and their cost, as published laws and machines say."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.errors import DescriptionError
from agribot.core.robot import RobotSpec
from agribot.core.world import GripPatch, Soil, SoilClass, SoilStrength, WorldSpec
from agribot.lab.bench.ground import (
    ACROSS,
    ALONG,
    MACHINES,
    Drive,
    drive_slope,
    drive_world,
    make_ground,
    make_machine,
    measure_separation_ratio,
)
from agribot.sim.grip import build_friction_grid
from agribot.sim.ground_surface import build_ground_surface
from agribot.sim.physics import Physics
from agribot.sim.soil import SoilLaw, make_soil_law
from agribot.sim.state import ANGULAR, POSITION
from tests.sim.holding import hold

CLASSES: tuple[SoilClass, ...] = ("firm", "tilled", "soft")
FIRM, TILLED, SOFT = (SoilStrength(soil_class=name) for name in CLASSES)
STEPS_NS = (500_000, 1_000_000, 2_000_000, 5_000_000)


def _make_law(robot: RobotSpec, strength: SoilStrength, soil: Soil | None = None) -> SoilLaw:
    world = msgspec.structs.replace(make_ground(strength), soil=soil or Soil())
    ground = build_ground_surface(world)
    return make_soil_law(robot, world, 0.4, ground.make_sunk_grid())


def _first_pass(robot: RobotSpec, law: SoilLaw) -> tuple[float, float]:
    """Sinkage, m, and motion resistance over load of one wheel on untouched soil."""
    load_n = robot.mass_kg * 9.8 / 4.0
    sink_m = (law.sink_scale * load_n) ** law.sink_power
    power = law.exponent + 1.0
    pressing = law.width_m * law.modulus * sink_m**power / power / load_n
    return sink_m, pressing + robot.tyre.rolling_resistance_ratio


def _on_slope(robot: RobotSpec, strength: SoilStrength, degrees: float, yaw_rad: float) -> Drive:
    return drive_slope(robot, strength, degrees, yaw_rad)


def test_firm_soil_slips_by_a_tenth_to_a_fifth_at_the_traction_of_field_work(
    robot: RobotSpec,
) -> None:
    slips = [
        _on_slope(robot, FIRM, math.degrees(math.atan(traction)), ALONG).slip_ratio
        for traction in (0.35, 0.4, 0.45)
    ]
    assert 0.1 <= slips[0] < slips[1] < slips[2] <= 0.2


def test_along_a_slope_it_drifts_downhill_by_degrees(robot: RobotSpec) -> None:
    crab_deg = [
        math.degrees(_on_slope(robot, FIRM, degrees, ACROSS).crab_rad)
        for degrees in (5.0, 10.0, 15.0)
    ]
    assert 2.0 < crab_deg[2] < 4.0
    # Shear gives way more than in proportion.
    assert crab_deg[1] > 2.0 * crab_deg[0] and crab_deg[2] > 1.5 * crab_deg[1]


@pytest.mark.parametrize("strength", [FIRM, TILLED, SOFT])
def test_no_motor_works_against_another_on_soil(robot: RobotSpec, strength: SoilStrength) -> None:
    net_w = []
    for degrees in (0.0, 5.0, 10.0, 15.0):
        for yaw_rad in (ALONG, ACROSS):
            drive = _on_slope(robot, strength, degrees, yaw_rad)
            assert drive.gross_w == pytest.approx(drive.net_w, rel=0.05)
            if yaw_rad == ALONG:
                net_w.append(drive.net_w)
    assert (np.diff(net_w) > 1.0).all()


def test_motion_resistance_is_that_of_the_class(robot: RobotSpec) -> None:
    bands = {"firm": (0.04, 0.08), "tilled": (0.1, 0.2), "soft": (0.2, 0.35)}
    for name in CLASSES:
        ratios, sinks_m = [], []
        for moisture in (0.0, 0.5, 1.0):
            strength = SoilStrength(soil_class=name, moisture_ratio=moisture)
            sink_m, ratio = _first_pass(robot, _make_law(robot, strength))
            low, high = bands[name]
            assert low <= ratio <= high
            ratios.append(ratio)
            sinks_m.append(sink_m)
        # Water weakens.
        assert (np.diff(ratios) > 0.0).all() and (np.diff(sinks_m) > 0.0).all()


def test_wheels_sink_in_as_bekker_says_and_the_rear_ones_less(robot: RobotSpec) -> None:
    for strength in (TILLED, SOFT):
        rigid, soil = (
            Physics(robot, make_ground(kind), 2_000_000) for kind in (SoilStrength(), strength)
        )
        level_m = float(hold(rigid, 0.4, 0.0, 3.0)[-1, 2])
        height_m = float(hold(soil, 0.4, 0.0, 3.0)[-1, 2])
        sink_m, _ = _first_pass(robot, soil._soil)
        rear_m, front_m = soil._soil_state[:2, 0].mean(), soil._soil_state[2:, 0].mean()
        # Slip digs in a little more, and the rear wheels carry more: they push.
        assert front_m == pytest.approx(sink_m, rel=0.25)
        assert rear_m < 0.6 * front_m
        ruts_m = soil.ground.sunk_m.max() / 2.0
        assert level_m - height_m == pytest.approx((rear_m + front_m) / 2.0 + ruts_m, rel=0.35)


def test_the_second_pass_finds_the_rut_and_rolls_easier(robot: RobotSpec) -> None:
    for strength in (FIRM, TILLED, SOFT):
        physics = Physics(robot, make_ground(strength), 2_000_000)
        costs_j, depths_m = [], []
        for v in (0.4, -0.4, 0.4):
            rows = hold(physics, v, 0.0, 4.0)
            steady = rows[len(rows) // 3 : -len(rows) // 4]
            costs_j.append(float(np.ptp(steady[:, 40]) / abs(np.ptp(steady[:, 0]))))
            x_m = round((0.8 - physics.ground.x_min_m) / physics.ground.resolution_m)
            depths_m.append(physics.ground.sunk_m[:, x_m].max())
            hold(physics, 0.0, 0.0, 0.6)
        assert costs_j[0] > 1.04 * costs_j[1] > 1.04 * costs_j[2] > 0.0
        assert 0.0 < depths_m[0] <= depths_m[1] <= depths_m[2] < 1.6 * depths_m[0]


def test_ruts_lie_where_the_wheels_drove(robot: RobotSpec) -> None:
    physics = Physics(robot, make_ground(TILLED), 2_000_000)
    ground = physics.ground
    before_m = ground.height_m.copy()
    hold(physics, 0.4, 0.0, 3.0)
    lowered_m = before_m - ground.height_m
    np.testing.assert_allclose(lowered_m, ground.sunk_m, atol=1e-12)
    rows, _ = np.nonzero(lowered_m)
    y_m = ground.y_min_m + ground.resolution_m * rows
    off_m = np.abs(np.abs(y_m) - robot.drive.track_m / 2.0)
    assert off_m.max() < robot.drive.wheel_width_m / 2.0 + 2.0 * ground.resolution_m
    assert 0.002 < lowered_m.max() < 0.02


def test_rigid_ground_has_no_ruts_whatever_its_moisture(robot: RobotSpec) -> None:
    ends = []
    for moisture in (0.0, 1.0):
        world = make_ground(SoilStrength(moisture_ratio=moisture))
        physics = Physics(robot, world, 2_000_000)
        ends.append(hold(physics, 0.4, 0.5, 1.0)[-1])
        assert physics.ground.height_m.shape == (2, 2)
    assert (ends[0] == ends[1]).all()


@pytest.mark.parametrize("strength", [FIRM, TILLED])
@pytest.mark.parametrize("yaw_rad", [ALONG, ACROSS])
def test_parked_on_a_slope_of_soil_it_stays(
    robot: RobotSpec, strength: SoilStrength, yaw_rad: float
) -> None:
    physics = Physics(robot, make_ground(strength, 15.0, yaw_rad), 2_000_000)
    hold(physics, 0.4, 0.0, 1.0)
    hold(physics, 0.0, 0.0, 1.5)
    start = physics.history[-1, POSITION].copy()
    end = physics.advance(1500)[-1, POSITION]
    assert np.linalg.norm(end - start) / 3.0 < 0.1e-3


@pytest.mark.parametrize("name", CLASSES)
def test_length_of_the_step_changes_neither_turns_nor_places_on_soil(
    robot: RobotSpec, name: SoilClass
) -> None:
    strength = SoilStrength(soil_class=name, moisture_ratio=0.3)
    for v, yaw_rate in ((0.4, 0.0), (0.0, 0.8), (0.4, 0.4)):
        found = []
        for step_ns in STEPS_NS:
            physics = Physics(robot, make_ground(strength), step_ns)
            rows = hold(physics, v, yaw_rate, 2.0, steps=20_000_000 // step_ns)
            turned = rows[len(rows) // 2 :, ANGULAR][:, 2].mean()
            found.append((*rows[-1, POSITION][:2].tolist(), turned))
        way_m = max(2.0 * v, 1.0)
        for x_m, y_m, turned in found[1:]:
            assert math.hypot(x_m - found[0][0], y_m - found[0][1]) < 0.005 * way_m
            assert turned == pytest.approx(found[0][2], rel=0.005, abs=0.001)


@pytest.mark.parametrize("name", MACHINES)
def test_machines_turn_on_firm_soil_as_their_makers_measured(robot: RobotSpec, name: str) -> None:
    machine = MACHINES[name]
    skid = make_machine(robot, machine)
    assert skid.mass_kg == pytest.approx(machine.mass_kg)
    assert measure_separation_ratio(skid, FIRM) == pytest.approx(machine.multiplier, rel=0.05)


def test_water_stones_and_straw_take_friction_wherever_the_surface_lies(
    meadow: WorldSpec,
) -> None:
    patch = GripPatch(friction_ratio=0.5, x_min_m=1.0, y_min_m=-1.0, x_max_m=3.0, y_max_m=1.0)
    for soil in (Soil(wet_ratio=1.0), Soil(stones_ratio=1.0), Soil(residue_ratio=1.0)):
        bare = msgspec.structs.replace(meadow, grip=(patch,))
        covered = msgspec.structs.replace(bare, soil=soil)
        whole, left = build_friction_grid(bare).values, build_friction_grid(covered).values
        ratio = left / whole
        assert np.ptp(ratio) < 1e-12 and 0.6 < ratio.min() < 0.95
        assert np.ptp(whole) == pytest.approx(0.5)


def test_wet_ground_carries_less(robot: RobotSpec) -> None:
    dry, wet = (_make_law(robot, TILLED, Soil(wet_ratio=ratio)) for ratio in (0.0, 1.0))
    assert _first_pass(robot, wet) > _first_pass(robot, dry)


@pytest.mark.parametrize("strength", [SoilStrength(), FIRM])
def test_mud_slips_under_the_robot_from_now_on_until_it_ends(
    robot: RobotSpec, strength: SoilStrength
) -> None:
    physics = Physics(robot, make_ground(strength, 10.0), 2_000_000)
    climbed_m = []
    for ratio in (1.0, 0.1, 1.0):
        physics.set_mud(ratio)
        rows = hold(physics, 0.4, 0.0, 1.5)
        climbed_m.append(float(rows[-1, 0] - rows[len(rows) // 3, 0]))
    assert climbed_m[0] > 0.3 and climbed_m[1] < 0.1 and climbed_m[2] > 0.2


def test_in_the_deepest_mud_wheels_dig_in_but_never_to_their_hubs(robot: RobotSpec) -> None:
    physics = Physics(
        robot, make_ground(SoilStrength(soil_class="tilled", moisture_ratio=0.5)), 2_000_000
    )
    physics.set_mud(0.01)
    rows = hold(physics, 0.4, 0.0, 8.0)
    fallen_m = float(rows[0, 2] - rows[-1, 2])
    assert 0.0 < fallen_m < 0.7 * robot.drive.wheel_radius_m
    assert abs(float(rows[-1, 0] - rows[0, 0])) < 0.5


def test_impossible_moisture_is_refused_in_words(robot: RobotSpec) -> None:
    strength = SoilStrength(soil_class="soft", moisture_ratio=1.5)
    with pytest.raises(DescriptionError, match=r"moisture_ratio 1\.5: out of range; give 0 to 1"):
        Physics(robot, make_ground(strength), 2_000_000)


def test_turning_on_the_spot_is_dearer_than_driving_on_firm_ground(robot: RobotSpec) -> None:
    straight = drive_world(robot, make_ground(FIRM), 0.4, 0.0, 3.0)
    turning = drive_world(robot, make_ground(FIRM), 0.0, 1.0, 3.0)
    assert turning.net_w > 3.0 * straight.net_w
