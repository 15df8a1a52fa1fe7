"""What peers may write into a goal, a pose and a command, and what is refused with a reason."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.fact_text import render
from agribot.core.facts import Said
from agribot.core.geo import Datum, MapFrame
from agribot.core.inbound_topics import CLICKED_POINT, COMMAND, GOAL_POSE, INITIAL_POSE, VISIT
from agribot.core.messages import (
    AddNote,
    AskerKind,
    CorrectPose,
    GoTo,
    Inbox,
    RequestAnswer,
    RequestEvent,
    TickRecord,
    Visit,
    Who,
)
from agribot.core.topics import Topic
from agribot.ros.frames import PeerFrames
from agribot.ros.goals import GoalBook, PeerGoal
from agribot.ros.inbound import InboundTopics
from agribot.ros.messages import rosmsg
from agribot.ros.messages.transforms import BodyTransforms
from agribot.ros.requests import SERVICES, Requests
from agribot.ros.robot_link import RobotLink
from tests.record import record_samples as samples

DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022, alt_m=4.5)
HERE = (3.0, -2.0, 0.5)  # x, y (m, map), yaw (rad) of the robot


def tick(v_mps: float = 0.0, *answers: RequestAnswer) -> TickRecord:
    record = samples.tick(0, np.random.default_rng(1))
    x_m, y_m, yaw_rad = HERE
    estimate = msgspec.structs.replace(
        record.estimate, x_map_m=x_m, y_map_m=y_m, yaw_map_rad=yaw_rad, v_mps=v_mps, ok=True
    )
    status = msgspec.structs.replace(record.status, answers=answers)
    return msgspec.structs.replace(record, estimate=estimate, status=status)


class Robot:
    """The robot's end of a network, without one."""

    def __init__(self, *, allow_drive: bool = True) -> None:
        self.inbox, self.said, self.now_s = Inbox(), list[str](), 0.0
        self.link, self.frames = RobotLink(self.inbox), PeerFrames(DATUM)
        self.link(tick())
        requests = Requests(
            self.inbox,
            allow_drive=allow_drive,
            report=self.said.append,
            link=self.link,
            frames=self.frames,
        )
        self.changes: list[tuple[str, str]] = []
        self.goals = GoalBook(requests, self._note)
        self.inbound = InboundTopics(requests, self.goals, self.goals, lambda: self.now_s)

    def _note(self, goal: PeerGoal) -> None:
        self.changes.append((goal.state, goal.reason))

    def hear(self, topic: Topic, *fields: Any) -> list[RequestEvent]:
        """Take one message, a second after the last; what it puts into the inbox."""
        self.now_s += 1.0
        data = rosmsg.to_cdr(rosmsg.make_message(topic.ros_type, *fields))
        self.inbound.take(topic, data, "ROS 2")
        return list(self.inbox.drain(1.0)[0])

    def goal(self, frame: str, x: float, y: float, **turn: float) -> list[RequestEvent]:
        return self.hear(GOAL_POSE, rosmsg.make_header(0.0, frame), pose(x, y, **turn))

    def state(self, variance: float, **turn: float) -> list[RequestEvent]:
        covariance = np.zeros(36)
        covariance[[0, 35]] = variance, variance / 4.0
        stated = rosmsg.make_message(
            "geometry_msgs/msg/PoseWithCovariance", pose(1.0, 2.0, **turn), covariance
        )
        return self.hear(INITIAL_POSE, rosmsg.make_header(0.0, "map"), stated)


def find_place(event: RequestEvent) -> tuple[float, ...]:
    assert isinstance(event.request, GoTo)
    return event.request.place


def pose(x: float, y: float, z: float = 0.0, w: float = 0.0) -> Any:
    return rosmsg.make_message(
        "geometry_msgs/msg/Pose", rosmsg.make_point(x, y), rosmsg.make_quaternion((0.0, 0.0, z, w))
    )


def test_a_goal_of_the_map_has_a_yaw_only_where_it_has_an_orientation() -> None:
    robot = Robot()
    (event,) = robot.goal("map", 5.0, 1.0)
    assert event.request == GoTo(id=event.request.id, x_map_m=5.0, y_map_m=1.0)
    assert event.who == Who("ROS 2", AskerKind.ROS)
    (event,) = robot.goal("/map", 5.0, 2.0, z=math.sin(0.2), w=math.cos(0.2))
    assert find_place(event) == pytest.approx((5.0, 2.0, 0.4))


def test_a_goal_of_odom_goes_through_the_transform_that_the_run_publishes() -> None:
    robot = Robot()
    assert robot.goal("odom", 1.0, 0.0) == []
    assert robot.changes[-1] == ("rejected", "nothing is known of odom yet; wait for the first /tf")
    robot.frames.note(topics.TF, BodyTransforms()(0, tick().estimate))  # odom begins at the robot
    (event,) = robot.goal("odom", 2.0, 0.0, w=1.0)
    x_m, y_m, yaw_rad = HERE
    there = (x_m + 2.0 * math.cos(yaw_rad), y_m + 2.0 * math.sin(yaw_rad), yaw_rad)
    assert find_place(event) == pytest.approx(there)


def test_a_goal_of_the_earth_is_longitude_and_latitude() -> None:
    robot = Robot()
    lat_deg, lon_deg, _ = MapFrame(DATUM).geodetic_from_map(12.0, -7.0)
    (event,) = robot.goal("wgs84", lon_deg, lat_deg)
    assert find_place(event) == pytest.approx((12.0, -7.0), abs=1e-3)
    assert robot.goal("wgs84", lat_deg, 95.0) == []
    assert "x is the longitude" in robot.changes[-1][1]
    with pytest.raises(BridgeError, match="no place on Earth"):
        PeerFrames().find_place("wgs84", lon_deg, lat_deg)


@pytest.mark.parametrize(
    ("frame", "x", "turn", "why"),
    [
        ("base_link", 1.0, {}, "use one of map, odom, wgs84"),
        ("map", math.inf, {}, "not finite"),
        ("map", math.nan, {}, "not finite"),
        ("map", 1.0, {"w": math.nan}, "has not the length 1"),
        ("map", 1.0, {"z": 3.0, "w": 1.0}, "has not the length 1"),
    ],
)
def test_a_goal_that_is_none_is_rejected(
    frame: str, x: float, turn: dict[str, float], why: str
) -> None:
    robot = Robot()
    assert robot.goal(frame, x, 1.0, **turn) == []
    state, reason = robot.changes[-1]
    assert state == "rejected"
    assert why in reason
    assert why in robot.said[-1]


def test_a_goal_where_the_robot_stands_needs_no_drive() -> None:
    robot = Robot()
    assert robot.goal("map", HERE[0] + 0.05, HERE[1]) == []
    assert robot.changes == [("succeeded", "the robot is there already")]


def test_a_goal_that_the_robot_still_brakes_at_waits_for_it_to_stand() -> None:
    robot = Robot()
    robot.link(tick(0.2))
    assert robot.goal("map", HERE[0] + 0.01, HERE[1]) == []
    assert robot.changes[-1][0] == "pending"
    robot.goals.step(tick(0.1))
    assert robot.changes[-1][0] == "pending"
    robot.goals.step(tick(0.0))
    assert robot.changes[-1] == ("succeeded", "the robot is there already")


def test_a_goal_that_the_robot_drives_past_is_driven_to() -> None:
    robot = Robot()
    robot.link(tick(0.5))
    assert robot.goal("map", HERE[0], HERE[1]) == []
    passed = tick(0.5)
    estimate = msgspec.structs.replace(passed.estimate, x_map_m=HERE[0] + 0.5)
    robot.goals.step(msgspec.structs.replace(passed, estimate=estimate))
    (event,) = robot.inbox.drain(1.0)[0]
    assert find_place(event) == HERE[:2]


def test_what_the_mission_refuses_aborts_the_goal_with_its_words() -> None:
    robot = Robot()
    (event,) = robot.goal("map", 5.0, 1.0)
    refusal = Said("goal refused: on crop")
    record = tick(0.0, RequestAnswer(id=event.request.id, fact=refusal))
    robot.link(record)
    assert robot.goals.step(record) == []
    assert robot.changes == [("pending", ""), ("aborted", render(refusal))]


def test_a_visit_is_its_places_in_order() -> None:
    robot = Robot()
    places = [pose(1.0, 2.0), pose(3.0, 4.0)]
    (event,) = robot.hear(VISIT, rosmsg.make_header(0.0, "map"), places)
    assert isinstance(event.request, Visit)
    assert event.request.places_map_m == ((1.0, 2.0), (3.0, 4.0))
    assert robot.hear(VISIT, rosmsg.make_header(0.0, "map"), []) == []
    assert robot.changes[-1] == ("rejected", "it has no poses; send 1 to 1000")


def test_a_stated_pose_brings_its_sigmas_or_gets_those_of_a_hand() -> None:
    robot = Robot()
    (event,) = robot.state(0.04, w=1.0)
    assert isinstance(event.request, CorrectPose)
    assert event.request.pose == pytest.approx((1.0, 2.0, 0.0, 0.2, 0.1))
    (event,) = robot.state(0.0, w=1.0)
    assert isinstance(event.request, CorrectPose)
    assert event.request.pose[3:] == pytest.approx((0.5, math.radians(15.0)))
    for variance, turn, why in (
        (0.04, {}, "no orientation"), (-1.0, {"w": 1.0}, "send 0 or more"),
        (math.nan, {"w": 1.0}, "out of range"),
    ):  # fmt: skip
        assert robot.state(variance, **turn) == []
        assert why in robot.said[-1]


def test_a_robot_that_drives_or_is_not_to_be_driven_believes_no_pose() -> None:
    robot = Robot()
    robot.link(tick(v_mps=0.3))
    assert robot.state(0.04, w=1.0) == []
    assert "pause its mission first" in robot.said[-1]
    watched = Robot(allow_drive=False)
    assert watched.state(0.04, w=1.0) == []
    assert "--allow-drive" in watched.said[-1]


def test_a_clicked_point_is_a_note_and_needs_no_leave() -> None:
    robot = Robot(allow_drive=False)
    point = rosmsg.make_point(1.25, -2.5)
    (event,) = robot.hear(CLICKED_POINT, rosmsg.make_header(0.0, "map"), point)
    assert event.request == AddNote(text="point: East 1.250 m, North -2.500 m")


def test_a_command_is_the_name_of_a_service() -> None:
    robot = Robot()
    for name, request in SERVICES:
        (event,) = robot.hear(COMMAND, name.rpartition("/")[2])
        assert event.request == request
    assert [e.request.word for e in robot.hear(COMMAND, "pause")] == ["pause"]
    assert robot.hear(COMMAND, "self_destruct") == []
    assert "'self_destruct' is unknown; send one of" in robot.said[-1]
    watched = Robot(allow_drive=False)
    assert watched.hear(COMMAND, "resume") == []
    assert [e.request.word for e in watched.hear(COMMAND, "stop")] == ["stop"]


def test_a_flood_of_one_command_is_thinned_out_but_for_stops() -> None:
    robot = Robot()
    data = {
        word: rosmsg.to_cdr(rosmsg.make_message(COMMAND.ros_type, word))
        for word in ("stop", "mark", "resume")
    }
    for word in ("mark", "mark", "mark", "stop", "stop", "resume"):
        robot.inbound.take(COMMAND, data[word], "DDS")
    words = sorted(event.request.word for event in robot.inbox.drain(1.0)[0])
    assert words == ["mark", "resume", "stop", "stop"]
    assert "faster than 20 Hz" in robot.said[-1]


@pytest.mark.parametrize("topic", [GOAL_POSE, INITIAL_POSE, CLICKED_POINT, VISIT, COMMAND])
@pytest.mark.parametrize("data", [b"", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 40])
def test_bytes_that_are_no_message_are_refused(topic: Topic, data: bytes) -> None:
    robot = Robot()
    robot.inbound.take(topic, data, "ROS 2")
    assert robot.inbox.drain(1.0) == ((), ())
    assert f"bytes are not {topic.ros_type}" in robot.said[-1]
