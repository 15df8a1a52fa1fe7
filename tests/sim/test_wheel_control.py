"""Wheels driven by torque: a PID per wheel, its limit, and motors that fail."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.errors import PlatformError
from agribot.core.messages import WHEEL_NAMES, DriveCommand, RobotCommand, WheelSample
from agribot.core.robot import Origin, RobotSpec, Shape
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim.physics import Physics
from agribot.sim.platform import SimPlatform
from agribot.sim.sensors.presets import WheelErrors
from agribot.sim.sensors.wheel_encoders import WheelEncoders
from agribot.sim.state import (
    ANGULAR,
    EFFORT,
    FAULT,
    HISTORY_COLUMNS,
    POSITION,
    TARGET,
    VELOCITY,
    WHEEL_ANGLE,
    WHEEL_SPEED,
    WORK,
)
from tests.sim.holding import hold
from tests.sim.test_drive_physics import slope

STEP_S = 0.002


def _with_drive(rover: RobotSpec, **changes: float) -> RobotSpec:
    return msgspec.structs.replace(rover, drive=msgspec.structs.replace(rover.drive, **changes))


@pytest.mark.parametrize("v", [0.0, 0.2, 0.4, 0.8])
@pytest.mark.parametrize("yaw_rate", [0.0, 0.3, 1.0])
def test_speed_on_soil_is_within_five_percent(
    rover: RobotSpec, meadow: WorldSpec, v: float, yaw_rate: float
) -> None:
    rows = hold(Physics(rover, meadow, 2_000_000, is_effort=True), v, yaw_rate, 3.0)[750:]
    assert rows[:, ANGULAR][:, 2].mean() == pytest.approx(yaw_rate, rel=0.05, abs=1e-3)
    speed = np.hypot(rows[:, VELOCITY][:, 0], rows[:, VELOCITY][:, 1])
    assert speed.mean() == pytest.approx(v, rel=0.05, abs=2e-3)
    assert rows[:, WHEEL_SPEED] == pytest.approx(rows[:, TARGET], abs=0.02)


def test_step_response_is_quick_and_calm(rover: RobotSpec, meadow: WorldSpec) -> None:
    jumpy = _with_drive(rover, max_accel_mps2=1e3)
    rows = hold(Physics(jumpy, meadow, 2_000_000, is_effort=True), 0.4, 0.0, 2.0)
    ratio = rows[:, WHEEL_SPEED] / (0.4 / rover.drive.wheel_radius_m)
    rise_s = np.argmax(ratio >= 0.9, axis=0) * STEP_S
    assert 0.005 < rise_s.max() < 0.15
    assert ratio.max() < 1.25
    settled = ratio[round(0.6 / STEP_S) :]
    assert np.abs(settled - 1.0).max() < 0.02


def test_integral_takes_out_what_friction_costs(rover: RobotSpec, meadow: WorldSpec) -> None:
    def error(i: float) -> float:
        robot = _with_drive(rover, pid_i_nmprad=i)
        rows = hold(Physics(robot, meadow, 2_000_000, is_effort=True), 0.0, 1.0, 3.0)
        return float(np.abs(rows[-1, TARGET] - rows[-1, WHEEL_SPEED]).max())

    # In a spin each tyre holds up to mu * load * radius: without an integral the wheels lag by
    # that torque over the gain.
    assert error(0.0) > 0.02
    assert error(20.0) < 0.1 * error(0.0)


@pytest.mark.parametrize("step_ns", [1_000_000, 5_000_000])
def test_gains_are_stable_on_any_step(rover: RobotSpec, meadow: WorldSpec, step_ns: int) -> None:
    physics = Physics(rover, meadow, step_ns, is_effort=True)
    for _ in range(150):
        physics.command(DriveCommand(v_mps=0.4, yaw_rate_radps=0.3))
        rows = physics.advance(20_000_000 // step_ns)
    ripple_radps = np.ptp(rows[:, WHEEL_SPEED], axis=0).max()
    assert ripple_radps < 0.005 * rows[:, WHEEL_SPEED].max()
    assert rows[-1, ANGULAR][2] == pytest.approx(0.3, rel=0.05)


def test_torque_never_exceeds_the_limit_and_limits_the_acceleration(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    weak = _with_drive(rover, torque_nm=0.3, max_accel_mps2=50.0)
    physics = Physics(weak, meadow, 2_000_000, is_effort=True)
    rows = hold(physics, 1.0, 0.0, 0.4)
    assert np.abs(rows[:, EFFORT]).max() == pytest.approx(0.3, abs=1e-12)
    felt_kg = weak.mass_kg + 4 * (0.0020959 + weak.drive.rotor_inertia_kgm2) / 0.09**2
    rolling_n = weak.tyre.rolling_resistance_ratio * weak.mass_kg * 9.8
    speed = rows[:, VELOCITY][:, 0]
    expected = (4 * 0.3 / 0.09 - rolling_n) / felt_kg
    assert (speed[199] - speed[99]) / 0.2 == pytest.approx(expected, rel=0.05)
    # And the integral has not wound up meanwhile: it overshoots little.
    assert hold(physics, 1.0, 0.0, 2.0)[:, VELOCITY][:, 0].max() < 1.1


def test_a_motor_behind_its_gear_gives_torque_times_ratio_times_efficiency(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    weak = _with_drive(
        rover, motor_torque_nm=0.03, gear_ratio=10.0, gear_efficiency_ratio=0.8, max_accel_mps2=50.0
    )
    rows = hold(Physics(weak, meadow, 2_000_000, is_effort=True), 1.0, 0.0, 0.4)
    assert np.abs(rows[:, EFFORT]).max() == pytest.approx(0.03 * 10.0 * 0.8, abs=1e-12)
    # The plugin's limit at the wheel still holds where it is the smaller one.
    strong = _with_drive(rover, motor_torque_nm=5.0, gear_ratio=10.0)
    assert strong.drive.wheel_torque_nm == rover.drive.torque_nm == 20.0
    assert rover.drive.wheel_torque_nm == 20.0  # no motor given


@pytest.mark.parametrize("is_effort", [False, True])
@pytest.mark.parametrize(
    ("gear_ratio", "slope_deg", "climbs"),
    [(10.0, 8.0, True), (10.0, 14.0, False), (16.0, 14.0, True)],
)
def test_a_bigger_gear_climbs_what_the_motor_alone_cannot(
    rover: RobotSpec, meadow: WorldSpec, is_effort: bool, gear_ratio: float, slope_deg: float,
    climbs: bool,
) -> None:  # fmt: skip
    # With 10:1 four wheels push 4 * 0.24 Nm / 0.089 m = 10.8 N, which m g (sin + 0.03 cos)
    # exceeds from 10.6 degrees on.
    weak = _with_drive(
        rover, motor_torque_nm=0.03, gear_ratio=gear_ratio, gear_efficiency_ratio=0.8
    )
    physics = Physics(weak, slope(meadow, slope_deg), 2_000_000, is_effort=is_effort)
    up_mps = hold(physics, 0.3, 0.0, 6.0)[-1, VELOCITY][0]
    assert up_mps > 0.25 if climbs else up_mps < 0.0


def test_ticks_count_on_the_motor_shaft(rover: RobotSpec) -> None:
    def step_rad(gear_ratio: float) -> float:
        drive = _with_drive(rover, gear_ratio=gear_ratio, encoder_ticks_per_rev=100).drive
        encoders = WheelEncoders(WheelErrors(quantised=True), drive)
        row = np.zeros(HISTORY_COLUMNS)
        angles = set()
        for k in range(2000):
            row[WHEEL_ANGLE] = k * 1e-5
            angles.add(encoders.sample((k + 1) * 0.01, row).angle_rad[0])
        return float(np.diff(sorted(angles)).max())

    assert step_rad(10.0) == pytest.approx(math.tau / 1000.0)
    assert step_rad(20.0) == pytest.approx(math.tau / 2000.0)


def test_parked_on_a_slope_torque_holds_it(rover: RobotSpec, meadow: WorldSpec) -> None:
    physics = Physics(rover, slope(meadow, 15.0), 2_000_000, is_effort=True)
    physics.advance(500)
    start = physics.history[-1, POSITION].copy()
    end = physics.advance(2500)[-1]
    assert np.linalg.norm(end[POSITION] - start) / 5.0 < 1e-3
    # Each wheel holds a quarter of m g sin(15 deg) at its rolling radius.
    hold_nm = rover.mass_kg * 9.8 * math.sin(math.radians(15.0)) / 4 * 0.0888
    assert end[EFFORT].mean() == pytest.approx(hold_nm, rel=0.06)


def test_torque_overcomes_rolling_resistance_and_work_adds_it_up(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    rows = hold(Physics(rover, meadow, 2_000_000, is_effort=True), 0.4, 0.0, 4.0)[1000:]
    rolling_nm = rover.tyre.rolling_resistance_ratio * rover.mass_kg * 9.8 * 0.09
    assert rows[:, EFFORT].sum(axis=1).mean() == pytest.approx(rolling_nm, rel=0.03)
    power_w = np.abs(rows[1:, EFFORT] * rows[1:, WHEEL_SPEED]).sum(axis=1)
    work_j = float(rows[-1, WORK][0] - rows[0, WORK][0])
    assert work_j == pytest.approx(power_w.sum() * STEP_S, rel=1e-9)


@pytest.mark.parametrize("is_effort", [False, True])
def test_a_dead_motor_shows_in_a_turn(rover: RobotSpec, meadow: WorldSpec, is_effort: bool) -> None:
    physics = Physics(rover, meadow, 2_000_000, is_effort=is_effort)
    assert not hold(physics, 0.2, 0.5, 3.0)[:, FAULT].any()
    physics.limit_torque("left_wheel_F", 0.0)
    rows = hold(physics, 0.2, 0.8, 2.0)
    dead = WHEEL_NAMES.index("left_wheel_F")
    assert np.flatnonzero(rows[-1, FAULT]).tolist() == [dead]
    assert not rows[: round(0.4 / STEP_S), FAULT].any()
    assert np.abs(rows[:, EFFORT][:, dead]).max() == 0.0
    physics.limit_torque("left_wheel_F", 20.0)
    assert not hold(physics, 0.2, 0.8, 1.0)[-1, FAULT].any()


def test_wheels_that_a_wall_holds_are_reported(rover: RobotSpec, meadow: WorldSpec) -> None:
    shape = Shape(kind="box", size_m=(0.2, 6.0, 1.0), origin=Origin(xyz_m=(0.0, 0.0, 0.5)))
    wall = Obstacle(
        name="wall", kind="wall", x_map_m=0.6, y_map_m=0.0, z_map_m=0.0, yaw_rad=0.0,
        shapes=(shape,),
    )  # fmt: skip
    weak = _with_drive(rover, torque_nm=0.4)  # less than the tyres hold
    physics = Physics(weak, msgspec.structs.replace(meadow, obstacles=(wall,)), 2_000_000)
    rows = hold(physics, 0.4, 0.0, 4.0)
    assert rows[-1, FAULT].all()
    assert not rows[:250, FAULT].any()


def test_platform_tells_efforts_targets_and_faults(rover: RobotSpec, meadow: WorldSpec) -> None:
    config = RunConfig(
        perception=PerceptionConfig(enabled=False),
        sim=SimConfig(sensors="ideal", actuation="effort"),
    )
    platform = SimPlatform(config, rover, meadow)
    platform.limit_torque("right_wheel_R", 0.0)
    seen: list[WheelSample] = []
    for _ in range(150):
        seen += platform.read().wheels
        platform.write(RobotCommand(t_s=0.0, drive=DriveCommand(yaw_rate_radps=0.8)))
    last = seen[-1]
    assert last.faults == ("right_wheel_R",)
    assert last.effort_nm is not None and last.target_radps is not None
    assert last.effort_nm[0] == 0.0 and abs(last.effort_nm[1]) > 0.1
    side_radps = 0.8 * rover.drive.effective_separation_m / 2 / 0.09
    assert last.target_radps == pytest.approx(
        (side_radps, -side_radps, side_radps, -side_radps), rel=1e-6
    )
    with pytest.raises(PlatformError, match="no wheel 'left'"):
        platform.limit_torque("left", 0.0)


def test_joint_states_come_fifty_times_a_second(rover: RobotSpec, meadow: WorldSpec) -> None:
    """A joint state is the newest sample of a tick: none may lack one."""
    config = RunConfig(perception=PerceptionConfig(enabled=False), sim=SimConfig(sensors="rtk"))
    platform = SimPlatform(config, rover, meadow)
    times = np.array([platform.read().wheels[-1].t_s for _ in range(500)])
    assert 1.0 / np.diff(times) == pytest.approx(50.0, abs=1.0)


def test_effort_runs_are_bit_identical(rover: RobotSpec, meadow: WorldSpec) -> None:
    def run() -> bytes:
        physics = Physics(rover, meadow, 2_000_000, is_effort=True)
        return hold(physics, 0.4, 0.5, 2.0).tobytes()

    assert run() == run()
