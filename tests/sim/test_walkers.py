"""People and animals that walk through the simulated field: met, felt and seen."""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.messages import DriveCommand, FloatArray, RobotCommand
from agribot.core.robot import Origin, RobotSpec, Shape
from agribot.core.world import Obstacle, Walker, Waypoint, WorldSpec
from agribot.sim.camera_sensor import CameraSensor
from agribot.sim.engine import NEAR_M
from agribot.sim.ground_surface import GroundSurface
from agribot.sim.platform import SimPlatform
from agribot.sim.state import HISTORY_COLUMNS
from agribot.sim.walkers import PersonWatch, place_walkers

POST = Shape(kind="cylinder", size_m=(0.2, 1.8, 0.0), origin=Origin(xyz_m=(0.0, 0.0, 0.9)))


class Drive(NamedTuple):
    platform: SimPlatform
    way: FloatArray
    touched: list[str]
    felt_s: list[float]


def _walker(*places: tuple[float, float, float], kind: str = "person_walking") -> Walker:
    """A post that is at x, y at a time; places are (t_s, x_m, y_m)."""
    waypoints = tuple(Waypoint(t_s=t, x_map_m=x, y_map_m=y, yaw_rad=0.0) for t, x, y in places)
    return Walker(name="guest", kind=kind, shapes=(POST,), waypoints=waypoints, loops=False)


def _drive(robot: RobotSpec, world: WorldSpec, v_mps: float, duration_s: float) -> Drive:
    config = RunConfig(perception=PerceptionConfig(enabled=False), sim=SimConfig(sensors="ideal"))
    platform = SimPlatform(config, robot, world)
    way, touched, felt_s = [], [], []
    for _ in range(round(duration_s * config.tick_hz)):
        batch = platform.read()
        platform.write(RobotCommand(t_s=batch.t_s, drive=DriveCommand(v_mps=v_mps)))
        way.append(platform._physics.history[-1].copy())
        touched.append(platform.find_touched() or "")
        felt_s += [sample.t_s for sample in batch.bumper]
    return Drive(platform, np.array(way), touched, felt_s)


def test_a_robot_that_meets_a_person_feels_it_and_is_stopped(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    """The person steps into its way, 2 m ahead, and stays."""
    world = msgspec.structs.replace(meadow, walkers=(_walker((0, 2, -4), (2, 2, 0)),))
    drive = _drive(rover, world, 0.5, 5.0)
    assert set(drive.touched) == {"", "guest"}
    # Its front wheels are 0.25 + 0.09 m ahead of its middle, the person's skin at 1.8 m.
    assert drive.way[-1, 0] < 1.65
    assert drive.felt_s[0] > 2.0
    assert drive.platform.person_distance_min_m == 0.0


def test_an_obstacle_that_stands_still_is_named_when_it_is_touched(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    post = Obstacle(
        name="guest", kind="post", x_map_m=1.0, y_map_m=0.0, z_map_m=0.0, yaw_rad=0.0,
        shapes=(POST,),
    )  # fmt: skip
    walker = _walker((0, 1, 3))  # of the same name, near and still
    world = msgspec.structs.replace(meadow, obstacles=(post,), walkers=(walker,))
    drive = _drive(rover, world, 0.5, 3.0)
    assert set(drive.touched) == {"", "guest"}
    assert drive.platform.person_distance_min_m == pytest.approx(3.0 - 0.4158 - 0.2, abs=0.05)


def test_a_person_who_walks_into_a_parked_robot_pushes_it(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    world = msgspec.structs.replace(meadow, walkers=(_walker((0, -3, 0), (4, 1, 0)),))
    drive = _drive(rover, world, 0.0, 4.0)
    first = drive.touched.index("guest")
    assert 0.02 * first == pytest.approx((3.0 - 0.2 - 0.34) / 1.0, abs=0.1)
    assert drive.way[-1, 0] > 0.3
    assert np.abs(np.diff(drive.way[:, 0])).max() < 0.05  # pushed, not thrown


def test_a_walker_out_of_reach_changes_no_bit_of_the_motion(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    far = _walker((0, 1, NEAR_M + 1.5), (3, 1, 20))
    with_walker = _drive(rover, msgspec.structs.replace(meadow, walkers=(far,)), 0.5, 3.0)
    alone = _drive(rover, meadow, 0.5, 3.0)
    np.testing.assert_array_equal(with_walker.way, alone.way)
    assert alone.platform.person_distance_min_m is None


def test_a_meeting_repeats_bit_by_bit(rover: RobotSpec, meadow: WorldSpec) -> None:
    world = msgspec.structs.replace(meadow, walkers=(_walker((0, 1.5, -2), (3, 1.5, 1)),))
    first, second = (_drive(rover, world, 0.5, 3.0) for _ in range(2))
    assert "guest" in first.touched
    np.testing.assert_array_equal(first.way, second.way)


@pytest.mark.parametrize(
    ("place", "expected_m"),
    [
        ((2.0, 0.0, 0.0), 2.0 - 0.3419 - 0.2),
        ((0.0, -2.0, 0.3), 2.0 - 0.4158 - 0.2),
        ((2.0, 2.0, 0.0), math.hypot(2.0 - 0.5419, 2.0 - 0.6158)),
        ((0.1, 0.1, 0.0), 0.0),
    ],
)
def test_the_distance_of_a_person_is_from_outline_to_outline(
    rover: RobotSpec, meadow: WorldSpec, place: tuple[float, float, float], expected_m: float
) -> None:
    x_m, y_m, turned_rad = place
    shape = Shape(kind="box", size_m=(0.4, 0.4, 1.8))
    person = Obstacle(
        name="p", kind="person_standing", x_map_m=x_m, y_map_m=y_m, z_map_m=0.9, yaw_rad=0.0,
        shapes=(shape,),
    )  # fmt: skip
    house = msgspec.structs.replace(person, name="h", kind="house", x_map_m=0.0, y_map_m=0.0)
    watch = PersonWatch(rover, msgspec.structs.replace(meadow, obstacles=(person, house)))
    watch.update(0.0, 0.0, 0.0, 0.0)
    assert watch.least_m == pytest.approx(expected_m, abs=0.002)
    # The whole scene turned about the robot is the same scene.
    cos, sin = math.cos(turned_rad), math.sin(turned_rad)
    turned = msgspec.structs.replace(
        person, x_map_m=cos * x_m - sin * y_m, y_map_m=sin * x_m + cos * y_m, yaw_rad=turned_rad
    )
    again = PersonWatch(rover, msgspec.structs.replace(meadow, obstacles=(turned,)))
    again.update(0.0, 0.0, 0.0, turned_rad)
    assert again.least_m == pytest.approx(expected_m, abs=0.002)


def test_a_hare_is_no_person(rover: RobotSpec, meadow: WorldSpec) -> None:
    hare = _walker((0, 1, 0), kind="hare")
    watch = PersonWatch(rover, msgspec.structs.replace(meadow, walkers=(hare,)))
    watch.update(0.0, 0.0, 0.0, 0.0)
    assert not watch.has_persons and watch.least_m is None


def test_a_walker_follows_the_ground() -> None:
    slope = GroundSurface(np.array([[0.0, 1.0], [0.0, 1.0]]), 0.0, 0.0, 10.0)
    (pose,) = place_walkers((_walker((0, 0, 0), (10, 10, 0)),), slope, 5.0)
    assert pose[:3, 3] == pytest.approx((5.0, 0.0, 0.5))


def test_a_walker_is_drawn_where_it_is_at_that_time(rover: RobotSpec, meadow: WorldSpec) -> None:
    camera = rover.camera
    assert camera is not None
    small = msgspec.structs.replace(camera, width_px=160, height_px=120)
    row = np.zeros(HISTORY_COLUMNS)
    row[2:4] = 1.0, 1.0  # level, a metre up, looking East

    def find_column(world: WorldSpec, t_s: float) -> float | None:
        feed = CameraSensor(rover, small, world, None)
        empty = CameraSensor(rover, small, meadow, None).sample(t_s, row).image_rgb
        seen = (feed.sample(t_s, row).image_rgb != empty).any(axis=2)
        return float(np.nonzero(seen)[1].mean()) if seen.any() else None

    world = msgspec.structs.replace(meadow, walkers=(_walker((0, 5, 2), (4, 5, -2)),))
    for t_s, y_m in ((0.0, 2.0), (2.0, 0.0), (3.0, -1.0)):
        expected = (small.width_px - 1) / 2.0 - small.focal_px * y_m / 5.0
        assert find_column(world, t_s) == pytest.approx(expected, abs=2.0)
