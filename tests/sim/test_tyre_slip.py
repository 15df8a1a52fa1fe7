"""What the packaged robot's wheels do to the soil and to each other, as mechanics says."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.messages import WHEEL_NAMES, FloatArray
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim.physics import Physics
from agribot.sim.state import (
    ANGULAR,
    EFFORT,
    POSITION,
    QUATERNION,
    TARGET,
    VELOCITY,
    WHEEL_SPEED,
)
from tests.sim.holding import hold
from tests.sim.test_drive_physics import slope

GRAVITY_MPS2 = 9.8
UPHILL, ACROSS, DOWNHILL = 0.0, math.pi / 2, math.pi
# Clearpath's `wheel_separation_multiplier`, found on the machines; wheelbase, track, radius in m.
MEASURED_MULTIPLIERS = {
    "Husky": (1.875, 0.5120, 0.5708, 0.1651),
    "Jackal": (1.5, 0.2620, 0.3756, 0.0980),
}


def _powers_w(rows: FloatArray) -> tuple[float, float]:
    """Mean of what the four motors give and take together, and of their magnitudes."""
    power_w = rows[:, EFFORT] * rows[:, WHEEL_SPEED]
    return float(power_w.sum(axis=1).mean()), float(np.abs(power_w).sum(axis=1).mean())


def _in_body(rows: FloatArray) -> tuple[float, float]:
    """Mean speed of base_link forward and to its left, along its own axes."""
    w, x, y, z = rows[:, QUATERNION].T
    vx, vy, vz = rows[:, VELOCITY].T
    forward = vx * (1 - 2 * (y * y + z * z)) + vy * 2 * (x * y + w * z) + vz * 2 * (x * z - w * y)
    left = vx * 2 * (x * y - w * z) + vy * (1 - 2 * (x * x + z * z)) + vz * 2 * (y * z + w * x)
    return float(forward.mean()), float(left.mean())


def _slip_stiffness_n(robot: RobotSpec) -> float:
    """Force of the four tyres per unit of slip."""
    return 4.0 * robot.tyre.bristle_stiffness_npm * robot.tyre.relaxation_length_m


def _rolling_radius_m(robot: RobotSpec) -> float:
    sunk_m = robot.mass_kg * GRAVITY_MPS2 / 4 / robot.tyre.normal_stiffness_npm
    return robot.drive.wheel_radius_m - sunk_m


@pytest.mark.parametrize("is_effort", [False, True])
@pytest.mark.parametrize("yaw_rad", [UPHILL, ACROSS, DOWNHILL])
def test_no_motor_works_against_another_on_any_slope(
    robot: RobotSpec, meadow: WorldSpec, yaw_rad: float, is_effort: bool
) -> None:
    climb_mps = 0.4 * math.cos(yaw_rad) if yaw_rad != ACROSS else 0.0
    rolled_w = robot.tyre.rolling_resistance_ratio * robot.mass_kg * GRAVITY_MPS2 * 0.4
    net_w = []
    for degrees in (0.0, 5.0, 10.0, 15.0):
        physics = Physics(robot, slope(meadow, degrees, yaw_rad), 2_000_000, is_effort=is_effort)
        net, gross = _powers_w(hold(physics, 0.4, 0.0, 6.0)[-500:])
        assert gross == pytest.approx(abs(net), rel=0.02)
        lifted_w = robot.mass_kg * GRAVITY_MPS2 * math.sin(math.radians(degrees)) * climb_mps
        # Besides: half a watt at most for what slips, and for sliding down a trifle across a slope.
        assert net == pytest.approx(lifted_w + rolled_w, rel=0.04, abs=0.1)
        net_w.append(net)
    # Steeper is dearer uphill and cheaper otherwise.
    assert (np.diff(net_w) > 0.0).all() if yaw_rad == UPHILL else (np.diff(net_w) < 0.0).all()


def test_slip_is_the_force_over_the_slip_stiffness(robot: RobotSpec, meadow: WorldSpec) -> None:
    for degrees, slip in ((0.0, 0.0), (10.0, 0.015), (15.0, 0.022)):
        rows = hold(Physics(robot, slope(meadow, degrees), 2_000_000), 0.4, 0.0, 4.0)[-500:]
        push_n = robot.mass_kg * GRAVITY_MPS2 * math.sin(math.radians(degrees))
        push_n += 0.0 if degrees else 0.03 * robot.mass_kg * GRAVITY_MPS2
        assert push_n / _slip_stiffness_n(robot) == pytest.approx(slip, abs=0.003)
        rolled_mps = rows[:, WHEEL_SPEED].mean() * _rolling_radius_m(robot)
        assert 1.0 - _in_body(rows)[0] / rolled_mps == pytest.approx(slip, abs=0.003)


def test_across_a_slope_it_crabs_downhill_by_its_weight_over_the_slip_stiffness(
    robot: RobotSpec, meadow: WorldSpec
) -> None:
    for degrees in (5.0, 10.0, 15.0):
        # Facing North on a plane that rises to the East: its left is downhill.
        rows = hold(Physics(robot, slope(meadow, degrees, ACROSS), 2_000_000), 0.4, 0.0, 4.0)
        forward_mps, left_mps = _in_body(rows[-500:])
        pull_n = robot.mass_kg * GRAVITY_MPS2 * math.sin(math.radians(degrees))
        assert left_mps / forward_mps == pytest.approx(pull_n / _slip_stiffness_n(robot), abs=1e-3)


@pytest.mark.parametrize("is_effort", [False, True])
@pytest.mark.parametrize("yaw_rad", [UPHILL, ACROSS, DOWNHILL])
def test_stopped_on_a_slope_after_driving_it_stays(
    robot: RobotSpec, meadow: WorldSpec, yaw_rad: float, is_effort: bool
) -> None:
    physics = Physics(robot, slope(meadow, 15.0, yaw_rad), 2_000_000, is_effort=is_effort)
    hold(physics, 0.4, 0.0, 1.0)
    hold(physics, 0.0, 0.0, 1.5)
    start = physics.history[-1, POSITION].copy()
    end = physics.advance(1500)[-1, POSITION]
    assert np.linalg.norm(end - start) / 3.0 < 0.02e-3


@pytest.mark.parametrize("is_effort", [False, True])
def test_length_of_the_step_changes_nothing_that_the_robot_does(
    robot: RobotSpec, meadow: WorldSpec, is_effort: bool
) -> None:
    def steady(step_ns: int, v: float, yaw_rate: float) -> tuple[float, ...]:
        physics = Physics(robot, meadow, step_ns, is_effort=is_effort)
        rows = hold(physics, v, yaw_rate, 2.5, steps=20_000_000 // step_ns)
        rows = rows[len(rows) // 2 :]
        assert np.ptp(rows[:, WHEEL_SPEED], axis=0).max() < 0.01
        return *_in_body(rows), rows[:, ANGULAR][:, 2].mean()

    for v, yaw_rate in ((0.8, 0.0), (0.0, 1.0), (0.5, 0.5)):
        reference = steady(1_000_000, v, yaw_rate)
        for step_ns in (500_000, 2_000_000, 5_000_000):
            assert steady(step_ns, v, yaw_rate) == pytest.approx(reference, abs=0.0005)


def test_motors_are_as_heavy_as_motors_are(robot: RobotSpec, meadow: WorldSpec) -> None:
    """Rotors of 12 and 24 V gear motors of 20 to 250 W: 10 to 1400 g cm^2 in their data sheets."""
    rotor_kgm2 = robot.drive.rotor_inertia_kgm2 / robot.drive.gear_ratio**2
    assert 1e-6 < rotor_kgm2 < 1.4e-4
    # What a push feels: a third more than the robot weighs, mostly by its wheels.
    weak = msgspec.structs.replace(robot.drive, torque_nm=0.2, max_accel_mps2=50.0)
    physics = Physics(msgspec.structs.replace(robot, drive=weak), meadow, 2_000_000)
    rows = hold(physics, 0.8, 0.0, 0.4)
    accel_mps2 = (rows[199, VELOCITY][0] - rows[99, VELOCITY][0]) / 0.2
    push_n = 4 * 0.2 / 0.09 - robot.tyre.rolling_resistance_ratio * robot.mass_kg * GRAVITY_MPS2
    assert 1.2 < push_n / accel_mps2 / robot.mass_kg < 1.5


@pytest.mark.parametrize("is_effort", [False, True])
@pytest.mark.parametrize("step_ns", [2_000_000, 5_000_000])
def test_a_motor_at_its_limit_does_not_chatter(
    robot: RobotSpec, meadow: WorldSpec, step_ns: int, is_effort: bool
) -> None:
    weak = msgspec.structs.replace(robot.drive, torque_nm=0.3, max_accel_mps2=50.0)
    physics = Physics(
        msgspec.structs.replace(robot, drive=weak), meadow, step_ns, is_effort=is_effort
    )
    rows = hold(physics, 0.8, 0.0, 2.0, steps=20_000_000 // step_ns)
    speed, target = rows[:, WHEEL_SPEED], rows[:, TARGET]
    assert np.abs(rows[:, EFFORT]).max() == pytest.approx(0.3, rel=1e-6)
    assert speed.max() < 1.15 * target.max()
    assert speed[-1] == pytest.approx(target[-1], rel=0.01)
    # It speeds up once and comes back from its overshoot once.
    turns = np.diff(np.sign(np.diff(speed[:, 0])))
    assert np.count_nonzero(turns) < 12


def test_coasting_down_a_slope_loses_to_rolling_only_what_rolling_takes(
    robot: RobotSpec, meadow: WorldSpec
) -> None:
    physics = Physics(robot, slope(meadow, 10.0, DOWNHILL), 2_000_000)
    for name in WHEEL_NAMES:
        physics.limit_torque(name, 0.0)
    start = physics.history[-1].copy()
    row = physics.advance(1500)[-1]
    fallen_m, way_m = start[2] - row[2], np.linalg.norm(row[POSITION] - start[POSITION])
    wheel_kgm2 = robot.link(WHEEL_NAMES[0]).inertia_kgm2[0] + robot.drive.rotor_inertia_kgm2
    moving_j = robot.mass_kg * float(row[VELOCITY] @ row[VELOCITY]) / 2.0
    moving_j += wheel_kgm2 * float(row[WHEEL_SPEED] @ row[WHEEL_SPEED]) / 2.0
    weight_n = robot.mass_kg * GRAVITY_MPS2
    rolled_j = robot.tyre.rolling_resistance_ratio * weight_n * math.cos(math.radians(10.0)) * way_m
    assert moving_j + rolled_j == pytest.approx(weight_n * fallen_m, rel=0.01)
    assert moving_j > 4.0 * rolled_j > 0.0


@pytest.mark.parametrize("machine", MEASURED_MULTIPLIERS)
def test_machines_turn_as_their_makers_measured(
    rover: RobotSpec, meadow: WorldSpec, machine: str
) -> None:
    multiplier, wheelbase_m, track_m, radius_m = MEASURED_MULTIPLIERS[machine]
    drive = msgspec.structs.replace(
        rover.drive, wheel_radius_m=radius_m, track_m=track_m, wheelbase_m=wheelbase_m,
        yaw_multiplier=multiplier,
    )  # fmt: skip
    scale = (wheelbase_m / rover.drive.wheelbase_m, track_m / rover.drive.track_m)
    joints = []
    for joint in rover.joints:
        x_m, y_m, z_m = joint.origin.xyz_m
        origin = msgspec.structs.replace(
            joint.origin, xyz_m=(x_m * scale[0], y_m * scale[1], z_m + radius_m - 0.09)
        )
        is_wheel = joint.child in WHEEL_NAMES
        joints.append(msgspec.structs.replace(joint, origin=origin) if is_wheel else joint)
    skid = msgspec.structs.replace(rover, drive=drive, joints=tuple(joints))
    for v in (0.0, 0.4):
        rows = hold(Physics(skid, meadow, 2_000_000), v, 0.6, 2.5)[-500:]
        assert rows[:, ANGULAR][:, 2].mean() == pytest.approx(0.6, rel=0.05)
