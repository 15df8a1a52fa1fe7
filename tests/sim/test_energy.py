"""What driving costs the battery, as the motors' data sheets and a published machine say."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.core.world import SoilStrength
from agribot.lab.bench.ground import (
    ALONG,
    MACHINES,
    drive_slope,
    drive_world,
    make_ground,
    make_machine,
)
from agribot.sim.kernel import compute_battery_power
from agribot.sim.physics import Physics
from agribot.sim.sensors.battery import CAPACITY_J, ELECTRONICS_W, Battery
from agribot.sim.state import DRAWN, HISTORY_COLUMNS, Motor

FIRM = SoilStrength(soil_class="firm")
HUSKY_WH = 24.0 * 20.0
HUSKY_TYPICAL_H = 3.0
COMPUTERS_W = 40.0


def _motor(robot: RobotSpec, regeneration: float = 0.0) -> Motor:
    drive = robot.drive
    return Motor(
        drive.torque_constant_nmpa, drive.winding_ohm, drive.no_load_a,
        drive.gear_efficiency_ratio, drive.controller_efficiency_ratio, regeneration,
    )  # fmt: skip


def _row(drawn_j: float) -> FloatArray:
    row = np.zeros(HISTORY_COLUMNS)
    row[DRAWN] = drawn_j
    return row


def test_a_stalled_motor_costs_the_heat_of_its_winding(robot: RobotSpec) -> None:
    motor = _motor(robot)
    current_a = 5.0 / 0.83 / 0.302
    heat_w = 0.299 * current_a**2 / 0.95
    assert compute_battery_power(motor, 5.0, 0.0) == pytest.approx(heat_w)
    assert heat_w > 100.0
    assert compute_battery_power(motor, 0.0, 0.0) == 0.0


def test_driving_costs_more_than_the_work_and_a_turning_idle_motor_its_no_load_current(
    robot: RobotSpec,
) -> None:
    motor = _motor(robot)
    for torque_nm in (0.05, 0.2, 1.0):
        assert compute_battery_power(motor, torque_nm, 4.4) > torque_nm * 4.4 / (0.83 * 0.95)
        mirrored = compute_battery_power(motor, -torque_nm, -4.4)
        assert compute_battery_power(motor, torque_nm, 4.4) == pytest.approx(mirrored)
    assert 0.1 < compute_battery_power(motor, 0.0, 4.4) < 0.5


def test_braking_charges_nothing_unless_the_controller_recovers(robot: RobotSpec) -> None:
    assert compute_battery_power(_motor(robot), -0.5, 8.0) == 0.0
    recovered_w = compute_battery_power(_motor(robot, 0.7), -0.5, 8.0)
    assert -0.7 * 0.5 * 8.0 < recovered_w < 0.0


def test_climbing_costs_and_driving_downhill_does_not_charge(robot: RobotSpec) -> None:
    drawn_w = [drive_slope(robot, FIRM, degrees, ALONG).drawn_w for degrees in (0.0, 5.0, 15.0)]
    assert (np.diff(drawn_w) > 2.0).all()
    down = drive_slope(robot, FIRM, -15.0, ALONG)
    assert down.net_w < 0.0 <= down.drawn_w < drawn_w[0]


def test_the_battery_pays_for_what_the_motors_draw(robot: RobotSpec) -> None:
    idle, busy = Battery(), Battery()
    at_rest, at_work = idle.sample(10.0, _row(0.0)), busy.sample(10.0, _row(500.0))
    spent = (at_rest.charge_ratio - at_work.charge_ratio) * CAPACITY_J
    assert spent == pytest.approx(500.0)
    assert 1.0 - at_rest.charge_ratio == pytest.approx(10.0 * ELECTRONICS_W / CAPACITY_J)
    assert at_work.current_a > at_rest.current_a and at_work.voltage_v < at_rest.voltage_v


def test_husky_lasts_about_as_long_as_its_data_sheet_says(robot: RobotSpec) -> None:
    """24 V, 20 Ah, 3 h of typical use; motors of 8 A, several times that where they turn."""
    husky = make_machine(robot, MACHINES["husky"])
    limits = msgspec.structs.replace(husky.drive, max_speed_mps=1.0, max_yaw_rate_radps=1.0)
    husky = msgspec.structs.replace(husky, drive=limits)
    straight_w = drive_world(husky, make_ground(FIRM), 1.0, 0.0, 3.0).drawn_w
    turning_w = drive_world(husky, make_ground(FIRM), 0.0, 0.8, 3.0).drawn_w
    assert straight_w / 24.0 < 2 * 8.0
    assert 3.0 * straight_w < turning_w < 10.0 * straight_w
    typical_w = 0.8 * straight_w + 0.2 * turning_w + COMPUTERS_W
    assert HUSKY_WH / typical_w == pytest.approx(HUSKY_TYPICAL_H, rel=0.4)


def test_motors_of_larger_robots_draw_in_proportion(robot: RobotSpec) -> None:
    husky = make_machine(robot, MACHINES["husky"])
    mass = husky.mass_kg / robot.mass_kg
    own = Physics(robot, make_ground(FIRM), 2_000_000)._motor
    other = Physics(husky, make_ground(FIRM), 2_000_000)._motor
    size = husky.drive.wheel_radius_m / robot.drive.wheel_radius_m
    speed = 4.0
    small_w = compute_battery_power(own, 0.3, speed)
    assert compute_battery_power(other, 0.3 * mass * size, speed / size) == pytest.approx(
        mass * small_w, rel=0.02
    )
