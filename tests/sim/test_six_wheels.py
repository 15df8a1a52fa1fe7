"""Six and eight wheels in skid steer: all carry, all drive, and four stay what they were."""

from __future__ import annotations

from itertools import pairwise

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig
from agribot.core.errors import PlatformError
from agribot.core.messages import (
    MIDDLE_WHEEL_NAMES,
    DriveCommand,
    PlantClass,
    RobotCommand,
    WheelSample,
)
from agribot.core.robot import RobotSpec
from agribot.core.world import Plant, WorldSpec
from agribot.description.loader import load_robot
from agribot.description.turning import compute_yaw_multiplier
from agribot.description.worlds_sdf import load_world
from agribot.ros.messages import rosmsg
from agribot.ros.messages.sensor_topics import SensorTopicWriter
from agribot.sim.driven_physics import DrivenPhysics
from agribot.sim.field_effects import PlantDamage
from agribot.sim.physics import Physics
from agribot.sim.platform import SimPlatform
from agribot.sim.state import HISTORY_COLUMNS, TORQUE

WITHOUT_CAMERA = RunConfig(perception=PerceptionConfig(enabled=False))
STEP_NS, STEPS = 2_000_000, 50
# Where the packaged robot was after 2 s on `Farm`, before robots had more than four wheels.
RECORDED = (
    -2.0911124643345502, 0.7280209801772471, 0.2795475087996531, 0.6055020312253075,
    2.3808988975515183e-05, -6.588144987270351e-06, 0.7958437595230331, -0.10365134572379114,
)  # fmt: skip


def add_wheels(rover: RobotSpec, *places_x_m: float) -> RobotSpec:
    """The rover with a pair of wheels at each of these places between the corners."""
    names = MIDDLE_WHEEL_NAMES[2 * len(places_x_m)]
    joints = {joint.child: joint for joint in rover.joints}
    links, mounted = [], []
    for k, name in enumerate(names):
        side = f"{name.split('_')[0]}_wheel_R"
        place = joints[side].origin.xyz_m
        origin = msgspec.structs.replace(
            joints[side].origin, xyz_m=(places_x_m[k // 2], *place[1:])
        )
        mounted.append(
            msgspec.structs.replace(joints[side], name=f"{name}_joint", child=name, origin=origin)
        )
        links.append(msgspec.structs.replace(rover.link(side), name=name))
    return msgspec.structs.replace(
        rover,
        links=(*rover.links, *links),
        joints=(*rover.joints, *mounted),
        middle_wheels=names,
    )


@pytest.fixture(scope="module")
def six(rover: RobotSpec) -> RobotSpec:
    return add_wheels(rover, 0.0)


def drive(physics: Physics, v_mps: float, yaw_rate_radps: float, ticks: int = 20) -> None:
    for _ in range(ticks):
        physics.command(DriveCommand(v_mps=v_mps, yaw_rate_radps=yaw_rate_radps))
        physics.advance(STEPS)


def test_four_wheels_drive_as_they_did_before_there_were_more() -> None:
    physics = Physics(load_robot(), load_world("Farm"), STEP_NS)
    for k in range(20):
        physics.command(DriveCommand(v_mps=0.4, yaw_rate_radps=0.3 if k % 3 else -0.2))
        physics.advance(STEPS)
    assert physics.history.shape == (STEPS + 1, HISTORY_COLUMNS)
    assert physics.history[-1, :8].tolist() == pytest.approx(RECORDED, abs=1e-9)


@pytest.mark.parametrize("places_x_m", [(0.0,), (-0.1, 0.1)])
def test_every_wheel_carries_its_part_and_turns_with_its_side(
    rover: RobotSpec, meadow: WorldSpec, places_x_m: tuple[float, ...]
) -> None:
    robot = add_wheels(rover, *places_x_m)
    wheels = len(robot.wheel_names)
    physics = Physics(robot, meadow, STEP_NS)
    drive(physics, 0.4, 0.2)
    loads_n = physics._engine.views.xfrc_applied[2 : 2 + wheels, 2]
    assert loads_n == pytest.approx(robot.mass_kg * 9.81 / wheels, rel=0.2)
    row = physics.history[-1]
    speeds = row[HISTORY_COLUMNS:].reshape(5, -1)[1]
    left, right = robot.drive.wheel_speeds_radps(0.4, 0.2)
    assert speeds == pytest.approx([right, left] * len(places_x_m), rel=0.02)
    efforts_nm = row[HISTORY_COLUMNS:].reshape(5, -1)[2]
    assert np.abs(efforts_nm).min() > 0.0
    assert float(row[TORQUE][0]) > float(np.abs(row[28:32]).sum())


def test_the_middle_pair_turns_a_robot_faster_by_what_its_places_say(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    """They do not slide aside, so that all their traction turns the robot."""
    robot = add_wheels(rover, 0.0)
    base_m, track_m = rover.drive.wheelbase_m / 2.0, rover.drive.track_m / 2.0
    fitting = compute_yaw_multiplier([*[base_m, -base_m] * 2, 0.0, 0.0], track_m)
    fitted = msgspec.structs.replace(robot.drive, yaw_multiplier=fitting)
    physics = Physics(msgspec.structs.replace(robot, drive=fitted), meadow, STEP_NS)
    drive(physics, 0.0, 0.5, ticks=30)
    assert physics.history[-1, 12] == pytest.approx(0.5, rel=0.05)


def test_six_wheels_do_the_same_again_to_the_bit(six: RobotSpec, meadow: WorldSpec) -> None:
    runs = [Physics(six, meadow, STEP_NS) for _ in range(2)]
    for physics in runs:
        drive(physics, 0.3, -0.3, ticks=5)
    first, second = (physics.history.tobytes() for physics in runs)
    assert first == second


def test_a_motor_between_the_corners_dies_and_all_lose_their_power(
    six: RobotSpec, meadow: WorldSpec
) -> None:
    physics = Physics(six, meadow, STEP_NS)
    physics.limit_torque("left_wheel_M", 0.0)
    drive(physics, 0.4, 0.0)
    efforts_nm = physics.history[-1, HISTORY_COLUMNS:].reshape(5, -1)[2]
    assert (efforts_nm[0] != 0.0, efforts_nm[1]) == (True, 0.0)
    physics.switch_power(is_on=False)
    drive(physics, 0.4, 0.0, ticks=2)
    assert not physics.history[-1, HISTORY_COLUMNS:].reshape(5, -1)[2].any()
    with pytest.raises(PlatformError, match=r"no wheel 'wheel_7'; there are: .*left_wheel_M"):
        physics.limit_torque("wheel_7", 0.0)


def test_their_encoders_are_in_the_samples_and_the_joint_states(
    six: RobotSpec, meadow: WorldSpec
) -> None:
    platform = SimPlatform(WITHOUT_CAMERA, six, meadow)
    samples: list[WheelSample] = []
    for _ in range(60):
        batch = platform.read()
        samples += batch.wheels
        platform.write(RobotCommand(t_s=batch.t_s, drive=DriveCommand(v_mps=0.4)))
    last = samples[-1]
    assert len(last.middle) == 2
    assert last.middle[0].angle_rad == pytest.approx(last.angle_rad[0], rel=0.05)
    assert last.middle[1].speed_radps == pytest.approx(0.4 / 0.09, rel=0.1)
    assert all(b.middle[0].angle_rad >= a.middle[0].angle_rad for a, b in pairwise(samples))
    names = tuple(joint.name for joint in six.joints if joint.child in six.wheel_names)
    message = rosmsg.make_joint_state(last, names)
    assert list(message.name) == list(names)
    assert len(message.position) == len(message.velocity) == len(message.effort) == 6
    sent: list[bytes] = []
    writer = SensorTopicWriter(lambda _t, _n, data, _p: sent.append(data), six, None)  # type: ignore[arg-type]
    writer(0, msgspec.structs.replace(batch, imu=(), mag=(), gnss=(), wheels=(last,), battery=()))
    assert sent == [rosmsg.to_cdr(message)]
    writer.write_wheel_transforms(0, last)
    assert len(sent) == 2


def test_the_boards_firmware_refuses_more_than_four(six: RobotSpec, meadow: WorldSpec) -> None:
    class Nothing:
        def drive(self, dt_s: float, speed_radps: object) -> tuple[float, float, float, float]:
            raise AssertionError

    with pytest.raises(PlatformError, match="has 6 wheels; the firmware's board drives four"):
        DrivenPhysics(six, meadow, STEP_NS, Nothing())


def test_wheels_between_the_corners_crush_what_they_stand_on(
    six: RobotSpec, rover: RobotSpec, meadow: WorldSpec
) -> None:
    plant = Plant(
        species="sugar_beet", plant=PlantClass.CROP, x_map_m=0.0, y_map_m=0.39, yaw_rad=0.0,
        size_m=0.1, seed=1, stem_radius_m=0.01,
    )  # fmt: skip
    world = msgspec.structs.replace(meadow, plants=(plant,))
    row = np.zeros(HISTORY_COLUMNS)
    row[:7] = 0.0, 0.0, six.base_height_m, 1.0, 0.0, 0.0, 0.0
    crushed = [set[int](), set[int]()]
    for number, robot in enumerate((rover, six)):
        damage = PlantDamage(robot, world)
        damage.update(0.0, row, row)
        crushed[number] = damage.crushed
    assert crushed == [set(), {0}]
