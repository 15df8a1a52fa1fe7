"""Where something stands, the robot slows down, waits, and goes on when its way is free."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.control.obstacle_zone import ObstacleZone
from agribot.autonomy.control.supervise import Supervisor
from agribot.core.config import SafetyConfig
from agribot.core.facts import NotHeardYet, ObstacleInWay, ObstacleNearWay, SensorSilent
from agribot.core.keep_out import BodyBox
from agribot.core.messages import (
    STOP,
    DriveCommand,
    Goal,
    ObstacleSample,
    Path,
    RobotCommand,
    SensorBatch,
)
from tests.autonomy.control.kinematic_rover import TICK_S, Rover, Soil
from tests.autonomy.control.test_supervisor import goal
from tests.robot_parts import plain_rover

BODY = BodyBox(front_m=0.5, rear_m=0.4, half_width_m=0.4)
CONFIG = SafetyConfig(obstacle_stop_m=2.0, obstacle_slow_m=4.0)
STD_M = 0.05  # 2 sigma make each margin larger by 0.1 m
Points = tuple[tuple[float, float], ...]


def lead(xy_map_m: list[tuple[float, float]], yaw_rad: list[float]) -> Goal:
    """Make a goal on a path along points."""
    xy = np.array(xy_map_m)
    s_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    path = Path(
        xy_map_m=xy, yaw_map_rad=np.array(yaw_rad), curvature_radpm=np.zeros(len(xy)),
        row=np.zeros(len(xy), dtype=np.int64), s_m=s_m,
    )  # fmt: skip
    return msgspec.structs.replace(goal("running"), path=path)


STRAIGHT = lead([(0.02 * k, 0.0) for k in range(500)], [0.0] * 500)
ARC_RAD = np.linspace(0.0, math.pi / 2.0, 100)  # to the left, on a radius of 1 m
TURN = lead([(math.sin(a), 1.0 - math.cos(a)) for a in ARC_RAD], ARC_RAD.tolist())
PIVOT = lead([(0.0, 0.0)] * 50, np.linspace(0.0, math.pi / 2.0, 50).tolist())
BACK = lead([(-0.02 * k, 0.0) for k in range(500)], [0.0] * 500)


def look(points: Points, to: Goal = STRAIGHT) -> tuple[float | None, float | None]:
    """Return the way to what is in the way, and to what is near it."""
    zone = ObstacleZone(CONFIG, BODY, must_report=True)
    rover = Rover((0.0, 0.0, 0.0), Soil(), np.random.default_rng(0))
    zone.update(see(0.0, points), rover.estimate(), to)
    found = [fact if fact is None else fact.way_m for fact in (zone.stop, zone.slow)]
    return found[0], found[1]


def see(t_s: float, points: Points) -> SensorBatch:
    sample = ObstacleSample(t_s=t_s, sensor="lidar", std_m=STD_M, points_body_m=points)
    return SensorBatch(t_s=t_s, obstacles=(sample,))


@pytest.mark.parametrize(
    ("point", "stop_m", "slow_m"),
    [
        ((2.7, 0.0), 1.9, 1.9),  # its front, 0.5 m ahead, and 0.3 m of margin come there first
        ((3.5, 0.0), None, 2.7),
        ((4.9, 0.0), None, None),
        ((2.0, 0.65), 1.2, 1.2),  # beside the body by less than the margin
        ((2.0, -0.75), None, 1.2),
        ((2.0, 1.55), None, None),
        ((-0.8, 0.0), None, None),
    ],
)
def test_the_way_until_the_robot_would_touch_something_decides(
    point: tuple[float, float], stop_m: float | None, slow_m: float | None
) -> None:
    assert look((point,)) == (
        stop_m and pytest.approx(stop_m, abs=0.11), slow_m and pytest.approx(slow_m, abs=0.11)
    )  # fmt: skip


def test_what_counts_is_the_path_and_not_what_is_straight_ahead() -> None:
    assert look(((2.9, -0.9),), TURN)[0] is None, "it turns off before"
    assert look(((1.0, 1.75),), TURN)[0] == pytest.approx(1.52, abs=0.06)
    assert look(((0.0, 0.75),))[0] is None
    assert look(((0.0, 0.75),), PIVOT)[0] == 0.0, "its front comes round to it"
    assert look(((2.0, 0.0),), BACK) == (None, None)
    assert look(((-2.0, 0.0),), BACK)[0] == pytest.approx(1.3, abs=0.11)


class Watched:
    """A gate of a robot with a lidar, on a straight path."""

    def __init__(self) -> None:
        zone = ObstacleZone(CONFIG, BODY, must_report=True)
        self.gate = Supervisor(CONFIG, plain_rover(), obstacles=zone)
        self.rover = Rover((0.0, 0.0, 0.0), Soil(), np.random.default_rng(0))

    @property
    def state(self) -> str:
        return self.gate.gate.state

    def drive(
        self, points: Points | None, seconds: float = TICK_S, *, is_by_hand: bool = False
    ) -> tuple[float, object]:
        """Let it drive at 0.4 m/s, with these points ten times a second; None: it is silent."""
        sent = RobotCommand(t_s=0.0, drive=STOP)
        for _ in range(round(seconds / TICK_S)):
            self.rover.t_s += TICK_S
            batch = self.rover.batch()
            if points is not None and round(self.rover.t_s / TICK_S) % 5 == 0:
                seen = see(self.rover.t_s, points).obstacles
                batch = msgspec.structs.replace(batch, obstacles=seen)
            command = RobotCommand(t_s=self.rover.t_s, drive=DriveCommand(v_mps=0.4))
            sent, _ = self.gate.check(
                command, self.rover.estimate(), batch, STRAIGHT, is_by_hand=is_by_hand
            )
            self.rover.turn_wheels(sent.drive)
        return sent.drive.v_mps, self.gate.gate.fact


def test_it_slows_down_stands_and_goes_on_when_the_way_was_free_for_a_second() -> None:
    robot = Watched()
    assert robot.drive((), 1.0)[0] == 0.4
    speed_mps, fact = robot.drive(((3.5, 0.0),), 0.5)
    assert speed_mps == pytest.approx(0.2) and isinstance(fact, ObstacleNearWay)
    assert robot.state == "slowed"
    speed_mps, fact = robot.drive(((2.0, 0.0),), 0.5)
    assert speed_mps == 0.0 and isinstance(fact, ObstacleInWay)
    assert robot.gate.in_way == fact and robot.state == "held"
    assert robot.drive((), 0.8)[0] == 0.0
    assert robot.drive((), 1.0)[0] == 0.4


def test_a_hand_sees_for_itself() -> None:
    robot = Watched()
    robot.drive((), 1.0)
    assert robot.drive(((1.0, 0.0),), 0.5, is_by_hand=True)[0] == 0.4


def test_a_lidar_that_never_spoke_holds_the_start_and_one_that_falls_silent_stops_it() -> None:
    robot = Watched()
    assert robot.drive(None, 0.5) == (0.0, NotHeardYet("lidar"))
    bad = [check for check in robot.gate.gate.checks if not check.is_ok]
    assert robot.state == "checking" and [check.name for check in bad] in ([], ["lidar"])
    assert robot.drive((), 1.0)[0] == 0.4
    speed_mps, fact = robot.drive(None, 0.5)
    assert speed_mps == 0.0 and isinstance(fact, SensorSilent) and fact.parts == ("lidar",)
    assert robot.state == "stopped"


def test_a_setting_leaves_the_lidar_out_and_a_robot_without_one_lacks_nothing() -> None:
    blind = msgspec.structs.replace(CONFIG, stops_for_obstacles=False)
    for zone in (
        ObstacleZone(blind, BODY, must_report=True),
        ObstacleZone(CONFIG, BODY, must_report=False),
    ):
        rover = Rover((0.0, 0.0, 0.0), Soil(), np.random.default_rng(0))
        zone.update(SensorBatch(t_s=9.0), rover.estimate(), STRAIGHT)
        assert (zone.is_there, zone.unheard(), zone.silence(9.0)) == (False, None, None)
    zone = ObstacleZone(blind, BODY, must_report=True)
    zone.update(see(0.0, ((1.0, 0.0),)), rover.estimate(), STRAIGHT)
    assert zone.stop is None and zone.slow is None
