"""The rover on hills, ridges and things that lie in its way."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.filter.slope import slide_m
from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.messages import DriveCommand, FloatArray, RobotCommand
from agribot.core.robot import Origin, RobotSpec, Shape
from agribot.core.world import HeightField, Obstacle, WorldSpec
from agribot.sim.platform import SimPlatform
from agribot.sim.truth import Truth

RESOLUTION_M = 0.1
EAST_M = np.arange(-12.0, 12.0, RESOLUTION_M)


def _terrain(world: WorldSpec, height_m: FloatArray, yaw_deg: float = 0.0) -> WorldSpec:
    field = HeightField(height_m=height_m, x_min_m=-12.0, y_min_m=-12.0, resolution_m=RESOLUTION_M)
    return msgspec.structs.replace(world, terrain=field, spawn_yaw_map_rad=math.radians(yaw_deg))


def _plane(world: WorldSpec, slope_deg: float, yaw_deg: float) -> WorldSpec:
    """Rises towards East."""
    height_m = np.tile(math.tan(math.radians(slope_deg)) * EAST_M, (len(EAST_M), 1))
    return _terrain(world, height_m, yaw_deg)


def _drive(
    rover: RobotSpec, world: WorldSpec, v: float, seconds: float, yaw_rate: float = 0.0
) -> list[Truth]:
    config = RunConfig(perception=PerceptionConfig(enabled=False), sim=SimConfig(sensors="ideal"))
    platform = SimPlatform(config, rover, world)
    truths = []
    for _ in range(round(seconds / 0.02)):
        platform.read()
        drive = DriveCommand(v_mps=v, yaw_rate_radps=yaw_rate)
        platform.write(RobotCommand(t_s=0.0, drive=drive))
        truths.append(platform.truth())
    return truths


@pytest.mark.parametrize("slope_deg", [15.0, 20.0])
@pytest.mark.parametrize("yaw_deg", [0.0, 45.0, 90.0, 180.0])
def test_attitude_is_that_of_the_ground(
    rover: RobotSpec, meadow: WorldSpec, slope_deg: float, yaw_deg: float
) -> None:
    truth = _drive(rover, _plane(meadow, slope_deg, yaw_deg), 0.0, 0.5)[-1]
    rise = math.tan(math.radians(slope_deg))
    yaw = math.radians(yaw_deg)
    # The slope along the heading, and across it at the pitched body.
    pitch = -math.atan(rise * math.cos(yaw))
    roll = math.asin(-math.sin(yaw) * math.sin(math.radians(slope_deg)) / math.cos(pitch))
    assert math.degrees(truth.pitch_rad) == pytest.approx(math.degrees(pitch), abs=0.6)
    assert math.degrees(truth.roll_rad) == pytest.approx(math.degrees(roll), abs=0.6)


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 180.0, -90.0])
def test_parked_on_twenty_degrees_it_creeps_less_than_a_millimetre_per_second(
    rover: RobotSpec, meadow: WorldSpec, yaw_deg: float
) -> None:
    truths = _drive(rover, _plane(meadow, 20.0, yaw_deg), 0.0, 6.0)
    start, end = truths[50], truths[-1]
    moved_m = math.hypot(end.x_map_m - start.x_map_m, end.y_map_m - start.y_map_m)
    assert moved_m / 5.0 < 1e-3


def test_along_a_slope_it_slips_downhill_only_while_it_turns(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    """A sliding tyre holds no side force of its own: turning costs height, straight does not."""
    world = _plane(meadow, 15.0, 90.0)
    straight = _drive(rover, world, 0.4, 6.0)
    climbed_m = straight[-1].y_map_m - straight[0].y_map_m
    assert climbed_m == pytest.approx(0.4 * 5.8, rel=0.05)
    assert abs(straight[-1].x_map_m) < 0.05 * climbed_m
    # Four whole turns on the spot, which on the level end where they began.
    turning = _drive(rover, world, 0.0, 8.0 * math.pi, 1.0)
    assert turning[-1].x_map_m < -0.05


def test_a_crossed_ridge_pitches_it_up_and_down_and_leaves_it_level(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    # 0.2 m high, flanks of 16 degrees at their steepest.
    ridge_m = 0.2 * np.exp(-(((EAST_M - 2.0) / 0.6) ** 2))
    steepest = math.degrees(math.atan(np.max(np.gradient(ridge_m, RESOLUTION_M))))
    assert 15.0 < steepest < 17.0
    truths = _drive(rover, _terrain(meadow, np.tile(ridge_m, (len(EAST_M), 1))), 0.4, 11.0)
    pitch = np.degrees([truth.pitch_rad for truth in truths])
    # The wheelbase of half a metre evens out the steepest place by a few degrees.
    assert -steepest < pitch.min() < -0.75 * steepest
    assert 0.75 * steepest < pitch.max() < steepest
    assert np.argmin(pitch) < np.argmax(pitch)
    assert abs(pitch[-1]) < 0.2
    assert truths[-1].x_map_m > 3.8
    assert abs(truths[-1].y_map_m) < 1e-3


def test_one_side_over_a_bump_rolls_it(rover: RobotSpec, meadow: WorldSpec) -> None:
    height_m = np.zeros((len(EAST_M), len(EAST_M)))
    left = EAST_M > 0.0
    bump_m = 0.1 * np.exp(-(((EAST_M - 2.0) / 0.5) ** 2))
    height_m[left] = bump_m
    truths = _drive(rover, _terrain(meadow, height_m), 0.4, 10.0)
    roll = np.degrees([truth.roll_rad for truth in truths])
    # Both left wheels on the flanks: about 7 cm under half of a track of 0.78 m.
    assert 3.0 < roll.max() < math.degrees(math.atan(0.1 / 0.78))
    assert roll.min() > -0.5
    assert abs(roll[-1]) < 0.2


def test_a_board_on_the_ground_is_a_bump_and_a_kerb_is_a_wall(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    def over(height_m: float) -> list[Truth]:
        shape = Shape(
            kind="box",
            size_m=(0.3, 4.0, height_m),
            origin=Origin(xyz_m=(0.0, 0.0, height_m / 2)),
        )
        thing = Obstacle(
            name="thing", kind="board", x_map_m=1.5, y_map_m=0.0, z_map_m=0.0, yaw_rad=0.0,
            shapes=(shape,),
        )  # fmt: skip
        return _drive(rover, msgspec.structs.replace(meadow, obstacles=(thing,)), 0.3, 9.0)

    board, kerb = over(0.015), over(0.15)
    pitch = np.degrees([truth.pitch_rad for truth in board])
    # The front wheels rise by the board's height over the wheelbase, then the rear ones.
    lifted = math.degrees(math.atan(0.015 / 0.5038))
    assert pitch.min() == pytest.approx(-lifted, rel=0.5)
    assert pitch.max() == pytest.approx(lifted, rel=0.5)
    assert board[-1].x_map_m > 2.2
    assert kerb[-1].x_map_m == pytest.approx(1.35 - 0.342, abs=0.08)


@pytest.mark.parametrize("yaw_deg", [90.0, -90.0])
@pytest.mark.parametrize("yaw_rate_radps", [0.6, -0.6])
def test_half_a_turn_on_ten_degrees_ends_where_the_pose_filter_expects(
    rover: RobotSpec, meadow: WorldSpec, yaw_deg: float, yaw_rate_radps: float
) -> None:
    """Against the same turn on the level, which shows lag and slip without a slope."""
    slope = math.radians(10.0)
    ends_m, expected_m = [], np.zeros(2)
    for slope_deg in (0.0, 10.0):
        truths = _drive(
            rover, _plane(meadow, slope_deg, yaw_deg), 0.3, math.pi / 0.6, yaw_rate_radps
        )
        xy_m = np.array([(truth.x_map_m, truth.y_map_m) for truth in truths])
        ends_m.append(xy_m[-1] - xy_m[0])
    yaw_rad = np.unwrap([truth.yaw_map_rad for truth in truths])
    for at_rad, turn_rad in zip(yaw_rad[1:], np.diff(yaw_rad), strict=True):
        cos, sin = math.cos(at_rad), math.sin(at_rad)
        # The plane rises to the East.
        up_body = (math.sin(slope) * cos, -math.sin(slope) * sin, math.cos(slope))
        forward_m, left_m = slide_m(float(turn_rad), up_body, rover.drive.wheelbase_m)
        expected_m += (cos * forward_m - sin * left_m, sin * forward_m + cos * left_m)
    slid_m = ends_m[1] - ends_m[0]
    assert slid_m == pytest.approx(expected_m, abs=0.12)
    assert -slid_m[0] > 0.25
