"""Where the robot is bound for, as topics: of a mission over rows, and of drives beside it."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core import topics
from agribot.core.config import FieldConfig
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import Goal, TickRecord
from agribot.core.topics import Topic
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.messages.topic_writer import TopicWriter
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import FARM_START, MISSION, at
from tests.autonomy.plan.test_mission_states import Ride
from tests.record import record_samples as samples
from tests.robot_parts import plain_rover

ROWS = lay_rows(FieldConfig(row_count=2, row_length_m=4.0))
DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022)
FIRST, SECOND = ((1.0, 2.0), (1.0, 6.0)), ((2.0, 2.0), (2.0, 6.0))


class Listener:
    """Decodes what a feed writes, topic by topic."""

    def __init__(self) -> None:
        self.heard: dict[str, list[Any]] = {}
        robot = samples.robot(with_camera=False)
        self._feed = TopicWriter(self._write, robot, DATUM, samples.URDF, CameraLog(robot, 1.0, 80))

    def take(self, goal: Goal, t_s: float, x_m: float, y_m: float) -> None:
        record = samples.tick(0, np.random.default_rng(0))
        batch = msgspec.structs.replace(record.batch, t_s=t_s)
        placed = msgspec.structs.replace(at(x_m, y_m, t_s), yaw_map_rad=math.pi / 2)
        self._feed(TickRecord(batch=batch, scenes=(), estimate=placed, status=goal.status,
                              tracking=None, command=record.command))  # fmt: skip

    def places(self) -> list[tuple[float, float]]:
        """The goal fixes in the map, to the centimetre."""
        frame = MapFrame(DATUM)
        found = []
        for fix in self.heard.get(topics.GOAL_FIX.name, []):
            east_m, north_m, _ = frame.map_from_geodetic(fix.latitude, fix.longitude, DATUM.alt_m)
            found.append((round(east_m, 2), round(north_m, 2)))
        return found

    def last(self, topic: Topic) -> float:
        return float(self.heard[topic.name][-1].data)

    def _write(self, topic: Topic, _log_ns: int, data: bytes, _publish_ns: int) -> None:
        if topic in (topics.GOAL_FIX, topics.DISTANCE, topics.BEARING, topics.ANGLE):
            message = load_types().deserialize_cdr(data, topic.ros_type)
            self.heard.setdefault(topic.name, []).append(message)


@pytest.fixture
def ride() -> Ride:
    path = plan_rows(ROWS, FARM_START, plain_rover(), MISSION)
    return Ride(Mission(PaperTask(lambda _: path, ROWS, go_to=lambda *_: path), MISSION))


def test_in_a_row_it_is_the_rows_end_and_in_a_turn_the_next_rows_start(ride: Ride) -> None:
    listener = Listener()
    ride.settle()
    length_m = float(ride.mission.path.s_m[-1])  # type: ignore[union-attr]
    for s_m in np.arange(0.0, length_m, 0.02):
        x_m, y_m = ride.place(float(s_m))
        goal = ride.be_at(x_m, y_m)
        listener.take(goal, ride.t_s, x_m, y_m)
        assert goal.status.waypoints_reached == 0
        if goal.status.row == 0 and y_m > 2.5:
            bound = goal.status.goal_map_m
            assert bound is not None
            assert bound == pytest.approx(FIRST[1], abs=0.02)
    ends = [FIRST[0], FIRST[1], SECOND[1], SECOND[0]]
    assert len(listener.places()) in (4, 5)  # the end of the path lies beyond the last row
    for place, end in zip(listener.places(), ends, strict=False):
        assert place == pytest.approx(end, abs=0.03)


def test_distance_bearing_and_angle_are_those_of_that_place(ride: Ride) -> None:
    listener = Listener()
    ride.settle()
    ride.along(0.0, 5.0)
    goal = ride.be_at(1.0, 4.0)
    assert goal.status.row == 0
    listener.take(goal, ride.t_s, 1.5, 4.0)
    assert listener.last(topics.DISTANCE) == pytest.approx(math.hypot(0.5, 2.0), abs=0.02)
    left_deg = math.degrees(math.atan2(0.5, 2.0))
    assert listener.last(topics.BEARING) == pytest.approx(90.0 + left_deg, abs=0.5)
    assert listener.last(topics.ANGLE) == pytest.approx(left_deg, abs=0.5)


def test_a_goal_that_is_known_late_is_told_and_latched(ride: Ride) -> None:
    """The first record comes before the plan, as it does on every robot that starts."""
    listener = Listener()
    waiting = ride.be_at(*ride.start)
    assert waiting.status.goal_map_m is None
    listener.take(waiting, ride.t_s, *ride.start)
    assert listener.places() == []
    running = ride.settle()
    for _ in range(5):
        listener.take(running, ride.t_s, *ride.start)
    assert listener.places() == [pytest.approx(FIRST[0], abs=0.03)]
    assert topics.GOAL_FIX.qos.latched
