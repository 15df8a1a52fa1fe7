"""The rover on soil against the laws of a skidding vehicle."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.core.errors import DescriptionError, PlatformError
from agribot.core.messages import DriveCommand, FloatArray
from agribot.core.robot import Origin, RobotSpec, Shape
from agribot.core.world import HeightField, Obstacle, WorldSpec
from agribot.sim.physics import Physics
from agribot.sim.state import ANGULAR, POSITION, QUATERNION, VELOCITY, VELOCITY_GAIN, WHEEL_SPEED

TICK_S = 0.02
# Coulomb friction at four points: wheels of half track b and half base a turn the body by
# b^2 / (a^2 + b^2) of what their speeds say; the settings' diameter and separation add .9 / 1.2025.
SKID_RATIO = 0.3908**2 / (0.2519**2 + 0.3908**2)
RAW_YAW_RATIO = 0.18 / 0.2 * 0.65 / 0.7816 * SKID_RATIO


def _steady(physics: Physics, step_s: float, v: float, yaw_rate: float) -> tuple[float, float]:
    """Mean speed and yaw rate over 2 s after 1.5 s of run-up."""
    steps = round(TICK_S / step_s)
    distance_m = angle_rad = 0.0
    for tick in range(175):
        physics.command(DriveCommand(v_mps=v, yaw_rate_radps=yaw_rate))
        history = physics.advance(steps)
        if tick >= 75:
            distance_m += float(np.hypot(*(history[-1, :2] - history[0, :2])))
            angle_rad += float(history[1:, ANGULAR][:, 2].sum() * step_s)
    return distance_m / 2.0, angle_rad / 2.0


def slope(world: WorldSpec, degrees: float, yaw_rad: float = 0.0) -> WorldSpec:
    """The world on a plane that rises towards East."""
    east_m = np.linspace(-20.0, 20.0, 81)
    height_m = np.tile(math.tan(math.radians(degrees)) * east_m, (81, 1))
    field = HeightField(height_m=height_m, x_min_m=-20.0, y_min_m=-20.0, resolution_m=0.5)
    return msgspec.structs.replace(world, terrain=field, spawn_yaw_map_rad=yaw_rad)


def _wall(world: WorldSpec, x_map_m: float) -> WorldSpec:
    shape = Shape(kind="box", size_m=(0.2, 6.0, 1.0), origin=Origin(xyz_m=(0.0, 0.0, 0.5)))
    wall = Obstacle(
        name="wall", kind="wall", x_map_m=x_map_m, y_map_m=0.0, z_map_m=0.0, yaw_rad=0.0,
        shapes=(shape,),
    )  # fmt: skip
    return msgspec.structs.replace(world, obstacles=(wall,))


def test_told_geometry_turns_as_coulomb_friction_says(rover: RobotSpec, meadow: WorldSpec) -> None:
    physics = Physics(rover, meadow, 2_000_000, board=rover.drive.with_plugin_geometry())
    _, yaw_rate = _steady(physics, 0.002, 0.0, 1.0)
    assert abs(RAW_YAW_RATIO - 0.528) < 0.001
    assert yaw_rate == pytest.approx(RAW_YAW_RATIO, rel=0.03)


def test_told_geometry_drives_a_tenth_too_slow(rover: RobotSpec, meadow: WorldSpec) -> None:
    physics = Physics(rover, meadow, 2_000_000, board=rover.drive.with_plugin_geometry())
    v, yaw_rate = _steady(physics, 0.002, 0.5, 0.0)
    assert 0.440 <= v <= 0.451
    assert abs(yaw_rate) < 1e-6


@pytest.mark.parametrize("v", [0.0, 0.2, 0.5, 0.8])
@pytest.mark.parametrize("yaw_rate", [0.1, 0.5, 1.0])
def test_measured_geometry_does_what_it_is_told(
    rover: RobotSpec, meadow: WorldSpec, v: float, yaw_rate: float
) -> None:
    got_v, got_yaw_rate = _steady(Physics(rover, meadow, 2_000_000), 0.002, v, yaw_rate)
    assert got_yaw_rate == pytest.approx(yaw_rate, rel=0.025)
    # The tyre rolls on a radius 1.4 % smaller, and what turns it costs up to 0.2 % of slip.
    assert got_v == pytest.approx(v, rel=0.018, abs=1e-3)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, math.pi / 2, math.pi])
def test_parked_on_a_slope_it_hardly_creeps(
    rover: RobotSpec, meadow: WorldSpec, yaw_rad: float
) -> None:
    physics = Physics(rover, slope(meadow, 15.0, yaw_rad), 2_000_000)
    start = physics.history[-1, POSITION].copy()
    end = physics.advance(2500)[-1, POSITION]
    assert np.linalg.norm(end - start) / 5.0 < 0.6e-3


def test_it_slides_where_the_slope_is_steeper_than_the_friction(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    icy = msgspec.structs.replace(slope(meadow, 15.0), friction_ratio=0.1)
    physics = Physics(rover, icy, 2_000_000)
    speed = np.linalg.norm(physics.advance(500)[-1, VELOCITY])
    # a = g (sin - mu cos) after 1 s; rolling resistance is part of the friction.
    expected = 9.8 * (math.sin(math.radians(15.0)) - 0.1 * math.cos(math.radians(15.0)))
    assert speed == pytest.approx(expected, rel=0.05)


def test_it_climbs_fifteen_degrees(rover: RobotSpec, meadow: WorldSpec) -> None:
    v, _ = _steady(Physics(rover, slope(meadow, 15.0), 2_000_000), 0.002, 0.4, 0.0)
    horizontal = 0.4 * math.cos(math.radians(15.0))
    assert v == pytest.approx(horizontal, rel=0.04)


def test_two_runs_are_bit_identical(rover: RobotSpec, meadow: WorldSpec) -> None:
    def run() -> bytes:
        physics = Physics(rover, slope(meadow, 8.0), 2_000_000)
        rng = np.random.default_rng(5)
        states = []
        for _ in range(100):
            v, yaw_rate = rng.uniform(-0.5, 0.8), rng.uniform(-1.0, 1.0)
            physics.command(DriveCommand(v_mps=v, yaw_rate_radps=yaw_rate))
            states.append(physics.advance(10).copy())
        return np.concatenate(states).tobytes()

    assert run() == run()


def test_spawn_is_exact_and_at_rest(rover: RobotSpec, meadow: WorldSpec) -> None:
    world = msgspec.structs.replace(meadow, spawn_xy_map_m=(3.25, -7.5), spawn_yaw_map_rad=-2.0)
    physics = Physics(rover, world, 2_000_000)
    row = physics.history[-1].copy()
    w, x, y, z = row[QUATERNION]
    yaw_rad = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    assert row[:2] == pytest.approx([3.25, -7.5], abs=1e-9)
    assert yaw_rad == pytest.approx(-2.0, abs=1e-9)
    history = physics.advance(250)
    assert np.abs(history[:, VELOCITY]).max() < 1e-4
    # Standing on its wheels: only the tyres give, by the weight over their stiffness.
    sunk_m = rover.mass_kg * 9.8 / 4 / rover.tyre.normal_stiffness_npm
    assert history[-1, 2] == pytest.approx(rover.base_height_m - sunk_m, abs=2e-5)


def test_a_wall_stops_the_robot(rover: RobotSpec, meadow: WorldSpec) -> None:
    physics = Physics(rover, _wall(meadow, 2.0), 2_000_000)
    for _ in range(400):
        physics.command(DriveCommand(v_mps=0.5))
        row = physics.advance(10)[-1]
    front_wheel_m = 0.2519 + rover.drive.wheel_radius_m
    # The face of the wall is at 1.9 m; MuJoCo's contact gives a little.
    assert row[0] + front_wheel_m == pytest.approx(1.9, abs=0.02)


def test_an_obstacle_that_is_never_reached_changes_nothing(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    def run(world: WorldSpec) -> FloatArray:
        physics = Physics(rover, world, 2_000_000)
        for _ in range(100):
            physics.command(DriveCommand(v_mps=0.5, yaw_rate_radps=0.3))
            physics.advance(10)
        row: FloatArray = physics.history[-1].copy()
        return row

    assert np.array_equal(run(meadow), run(_wall(meadow, 3.0)))


def test_command_dies_after_the_timeout(rover: RobotSpec, meadow: WorldSpec) -> None:
    physics = Physics(rover, meadow, 2_000_000)
    physics.command(DriveCommand(v_mps=0.5))
    moving = physics.advance(250)[-1, VELOCITY][0]
    stopped = physics.advance(400)[-1, VELOCITY][0]
    assert moving == pytest.approx(0.493, abs=0.01)
    assert abs(stopped) < 1e-3


def test_ramps_keep_the_acceleration_within_limits(rover: RobotSpec, meadow: WorldSpec) -> None:
    physics = Physics(rover, meadow, 2_000_000)
    physics.command(DriveCommand(v_mps=0.8))
    speed = physics.advance(200)[:, WHEEL_SPEED] * rover.drive.wheel_radius_m
    limit = rover.drive.max_accel_mps2
    # Mean over 0.1 s: what a wheel lags behind at first, its servo makes good thereafter.
    assert np.max((speed[50:] - speed[:-50]) / 0.1) < 1.15 * limit
    assert speed[150] == pytest.approx(np.full(4, limit * 0.3), rel=0.1)


def test_speed_command_is_limited(rover: RobotSpec, meadow: WorldSpec) -> None:
    v, _ = _steady(Physics(rover, meadow, 2_000_000), 0.002, 5.0, 0.0)
    assert v == pytest.approx(rover.drive.max_speed_mps, rel=0.015)


def test_specific_force_at_rest_is_gravity_upwards(rover: RobotSpec, meadow: WorldSpec) -> None:
    physics = Physics(rover, slope(meadow, 10.0), 2_000_000)
    start = physics.history[-1, VELOCITY_GAIN].copy()
    gain = physics.advance(500)[-1, VELOCITY_GAIN] - start
    tilt = math.radians(10.0)
    assert gain == pytest.approx([9.8 * math.sin(tilt), 0.0, 9.8 * math.cos(tilt)], abs=0.02)


def test_specific_force_of_a_turn_includes_the_lever_arm(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    joints = tuple(
        msgspec.structs.replace(j, origin=Origin(xyz_m=(0.2, 0.06, 0.1))) if "imu" in j.name else j
        for j in rover.joints
    )
    physics = Physics(msgspec.structs.replace(rover, joints=joints), meadow, 2_000_000)
    for _ in range(100):
        physics.command(DriveCommand(yaw_rate_radps=1.0))
        physics.advance(10)
    before = physics.history[-1].copy()
    physics.command(DriveCommand(yaw_rate_radps=1.0))
    after = physics.advance(200)[-1]
    mean = (after[VELOCITY_GAIN] - before[VELOCITY_GAIN]) / 0.4
    # Pulled towards the axis, which is behind and to the right of the IMU.
    inwards = -(after[ANGULAR][2] ** 2)
    assert mean == pytest.approx([inwards * 0.2, inwards * 0.06, 9.8], rel=0.02)


def test_specific_force_of_spinning_up_pulls_the_imu_along(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    joints = tuple(
        msgspec.structs.replace(j, origin=Origin(xyz_m=(0.2, 0.0, 0.0))) if "imu" in j.name else j
        for j in rover.joints
    )
    physics = Physics(msgspec.structs.replace(rover, joints=joints), meadow, 2_000_000)
    physics.command(DriveCommand(yaw_rate_radps=1.0))
    gain = physics.advance(100)[-1, VELOCITY_GAIN]
    assert gain[1] == pytest.approx(physics.history[-1, ANGULAR][2] * 0.2, rel=0.02)


def test_rotor_inertia_is_felt_as_mass(rover: RobotSpec, meadow: WorldSpec) -> None:
    drive = msgspec.structs.replace(rover.drive, torque_nm=0.3, max_accel_mps2=50.0)
    physics = Physics(msgspec.structs.replace(rover, drive=drive), meadow, 2_000_000)
    physics.command(DriveCommand(v_mps=1.0))
    speed = physics.advance(200)[:, VELOCITY][:, 0]
    radius_m = drive.wheel_radius_m
    felt_kg = rover.mass_kg + 4 * (0.0020959 + drive.rotor_inertia_kgm2) / radius_m**2
    rolling_n = rover.tyre.rolling_resistance_ratio * rover.mass_kg * 9.8
    expected = (4 * drive.torque_nm / radius_m - rolling_n) / felt_kg
    assert (speed[200] - speed[100]) / 0.2 == pytest.approx(expected, rel=0.05)


def test_divergence_is_an_error_that_says_what_to_do(
    rover: RobotSpec, meadow: WorldSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    stiff = msgspec.structs.replace(rover.tyre, normal_stiffness_npm=math.inf)
    with pytest.raises(PlatformError, match=r"diverged.*sim\.step_s"):
        Physics(msgspec.structs.replace(rover, tyre=stiff), meadow, 2_000_000)
    assert list(tmp_path.iterdir()) == []


def test_overturning_is_an_error(rover: RobotSpec, meadow: WorldSpec) -> None:
    grip = msgspec.structs.replace(
        rover.tyre, friction_longitudinal_ratio=9.0, friction_lateral_ratio=9.0
    )
    cliff = msgspec.structs.replace(slope(meadow, 70.0, math.pi / 2), friction_ratio=9.0)
    with pytest.raises(PlatformError, match="overturned"):
        Physics(msgspec.structs.replace(rover, tyre=grip), cliff, 2_000_000).advance(1000)


def test_wheel_that_turns_about_a_wrong_axis_is_refused(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    joints = tuple(
        msgspec.structs.replace(j, axis=(0.0, 0.0, 1.0)) if j.kind == "continuous" else j
        for j in rover.joints
    )
    with pytest.raises(DescriptionError, match="axle"):
        Physics(msgspec.structs.replace(rover, joints=joints), meadow, 2_000_000)
