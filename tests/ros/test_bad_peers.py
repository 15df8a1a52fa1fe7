"""Peers that send nonsense to a whole simulated robot: it stays in its limits and says why."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.errors import BridgeError
from agribot.ros.requests import Requests, Twist, read_twist_cdr

TICK_S = 0.02


def twist(v_mps: float, yaw_rate_radps: float = 0.0) -> Twist:
    return (v_mps, 0.0, 0.0, 0.0, 0.0, yaw_rate_radps)


class Robot:
    """A session on the empty plain; the peer's clock is the test's own and may jump."""

    def __init__(self, folder: Path) -> None:
        settings = ["perception.enabled=false", "record.enabled=false", "duration_s=30"]
        self.session = simulate(config.load("farm", settings), folder)
        self.said: list[str] = []
        self.clock_s = 0.0
        self.requests = Requests(
            self.session.inbox,
            allow_drive=True,
            report=self.said.append,
            now_s=lambda: self.clock_s,
        )
        self.ticks = self.session.ticks()
        self.speeds_mps: list[float] = []
        self.reasons: set[str] = set()

    def live(self, ticks: int, *twists: Twist) -> None:
        """In each tick the peer sends all twists, evenly spaced."""
        for _ in range(ticks):
            for sent in twists:
                self.requests.request_twist(sent, "a peer")
                self.clock_s += TICK_S / len(twists)
            record = next(self.ticks)
            self.reasons.add(record.reason)
            drive, truth = record.command.drive, self.session.simulator.truth()
            assert abs(drive.v_mps) <= self.session.config.safety.max_speed_mps
            assert abs(drive.yaw_rate_radps) <= self.session.config.safety.max_yaw_rate_radps
            self.speeds_mps.append(truth.v_mps)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    running = Robot(tmp_path)
    with running.session:
        running.live(50)
        yield running


def test_a_twist_that_is_no_number_stops_a_moving_robot(robot: Robot) -> None:
    robot.live(100, twist(0.3))
    assert robot.speeds_mps[-1] > 0.2
    robot.live(75, twist(math.nan))
    assert abs(robot.speeds_mps[-1]) < 0.02
    assert any("not finite" in line for line in robot.said)
    assert any("finite" in reason for reason in robot.reasons), robot.reasons


def test_ten_thousand_wild_twists_a_second_stay_within_the_limits(robot: Robot) -> None:
    robot.live(100, *(twist((-1.0) ** (k % 3) * 50.0, 90.0) for k in range(200)))
    limit_mps = robot.session.config.safety.max_speed_mps
    assert max(map(abs, robot.speeds_mps)) <= 1.2 * limit_mps
    assert any("faster than 200 Hz" in line for line in robot.said)
    assert any(robot.reasons - {""})


def test_a_flood_that_ends_leaves_the_robot_standing(robot: Robot) -> None:
    robot.live(100, *(twist(0.3) for _ in range(200)))
    assert robot.speeds_mps[-1] > 0.2
    robot.live(100)
    assert abs(robot.speeds_mps[-1]) < 0.02


def test_a_clock_that_jumps_neither_moves_nor_locks_the_robot(robot: Robot) -> None:
    for jump_s in (3600.0, -7200.0):
        robot.live(50, twist(0.3))
        robot.clock_s += jump_s
        robot.live(50, twist(0.3))
        assert robot.speeds_mps[-1] > 0.2
        robot.live(100)
        assert abs(robot.speeds_mps[-1]) < 0.02


def test_bytes_that_are_no_twist_are_refused_with_their_number() -> None:
    for data in (b"", b"\0" * 51, b"\xff" * 52, b"\x00\x01\x00\x00"):
        with pytest.raises(BridgeError, match=f"{len(data)} bytes are not geometry_msgs/Twist"):
            read_twist_cdr(data)
