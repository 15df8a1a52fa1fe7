"""A program of ROS 1 asks things of a running robot: services, goals, RViz's tools."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import numpy as np
import pytest

from agribot.app.simulated_run import SimulatedRun
from agribot.core.fact_text import render
from agribot.core.facts import NothingPlanned, NotResumed, RowNotSkipped, StopHolds
from agribot.ros.ros1.action_types import ACTION_FEEDBACK, ACTION_GOAL, ACTION_RESULT, GOAL_ID
from agribot.ros.ros1.service_server import SET_BOOL, TRIGGER
from tests.ros.driven_robot import driven_robot, list_texts
from tests.ros.ros1_client import Client, ServiceError, ask
from tests.ros.ros1_master import master
from tests.waiting import PATIENCE_S, wait_for

STAMPED, ARRAY = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseArray"
SIMPLE_GOAL, STATED_POSE = "/move_base_simple/goal", "/initialpose"
NO_TURN = (0.0, 0.0, 0.0, 0.0)
PREEMPTED, SUCCEEDED, ABORTED, REJECTED = 2, 3, 4, 5


class Peer(NamedTuple):
    client: Client
    session: SimulatedRun

    @property
    def spawn(self) -> tuple[float, float]:
        return self.session.world.spawn_xy_map_m

    def send(self, name: str, x: float, y: float, frame: str = "map") -> None:
        make = self.client.make
        pose = make(STAMPED, self.client.header(frame), self.client.pose(x, y, NO_TURN))
        goal = make("move_base_msgs/msg/MoveBaseGoal", pose)
        goal_id = make(GOAL_ID, self.client.time(0, 0), name)
        message = make(ACTION_GOAL, self.client.header(""), goal_id, goal)
        self.client.publish("/move_base/goal", ACTION_GOAL, message)

    def cancel(self, name: str) -> None:
        message = self.client.make(GOAL_ID, self.client.time(0, 0), name)
        self.client.publish("/move_base/cancel", GOAL_ID, message)

    def result(self, name: str) -> tuple[int, str]:
        """Status and text of a goal that is over."""

        def find() -> list[Any]:
            return [status for status in self.results() if status.goal_id.id == name]

        status = wait_for(find, f"the result of {name}")[-1]
        return status.status, status.text

    def results(self) -> list[Any]:
        return [m.status for m in self.client.hear("/move_base/result", ACTION_RESULT)]

    def tell(self, topic: str, ros_type: str, message: Any) -> tuple[int, str]:
        """Publish a goal on a topic; status and text of its end."""
        before = len(self.results())
        self.client.publish(topic, ros_type, message)
        status = wait_for(lambda: self.results()[before:], f"the end of a goal of {topic}")[0]
        return status.status, status.text

    def events(self, text: str) -> list[str]:
        return [e.reason for e in self.session.event_log.list_since(0) if text in e.reason]


@contextmanager
def peer(out_dir: Path, *options: str) -> Iterator[Peer]:
    with (
        master() as (made, uri),
        driven_robot(out_dir, "--ros1", "--ros-master", uri, *options) as session,
        closing(Client(made, uri)) as client,
    ):
        client.hear("/move_base/result", ACTION_RESULT)
        client.hear("/move_base/feedback", ACTION_FEEDBACK)
        yield Peer(client, session)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Peer]:
    with peer(tmp_path_factory.mktemp("ros1"), "--allow-drive") as made:
        yield made


def test_services_say_what_the_mission_makes_of_a_request(robot: Peer) -> None:
    call = robot.client.trigger
    assert call("/agribot/stop").is_done
    assert call("/agribot/resume") == (False, render(NotResumed(StopHolds())))
    assert call("/agribot/clear_stop").is_done
    assert call("/agribot/skip_row") == (False, render(RowNotSkipped(NothingPlanned())))
    assert robot.client.set_bool("/agribot/pause", value=True).is_done
    assert robot.events("stop (ROS 1 node /client)")


def test_the_pose_of_the_parameter_is_believed_by_a_robot_that_stands(robot: Peer) -> None:
    call, parameters = robot.client.trigger, robot.client.master.parameters
    parameters.pop("/agribot/initial_pose", None)
    assert "first rosparam set" in call("/agribot/set_pose").text
    parameters["/agribot/initial_pose"] = {"x": 1.0, "y": "north"}
    assert "write rosparam set" in call("/agribot/set_pose").text
    x_m, y_m = robot.spawn
    wait_for(lambda: call("/agribot/resume").text, "an answer")
    robot.client.set_bool("/agribot/pause", value=True)
    parameters["/agribot/initial_pose"] = {"x": x_m, "y": y_m, "yaw": 0.0}
    wait_for(lambda: call("/agribot/set_pose").is_done, "the robot to stand and know its place")
    wait_for(lambda: robot.events("pose_estimate"), "the event")


def test_a_goal_of_the_action_is_driven_reported_and_succeeds(robot: Peer) -> None:
    x_m, y_m = robot.spawn
    robot.send("first", x_m - 1.0, y_m + 1.5)
    assert robot.result("first")[0] == SUCCEEDED
    truth = robot.session.simulator.truth()
    assert math.hypot(truth.x_map_m - (x_m - 1.0), truth.y_map_m - (y_m + 1.5)) < 0.2
    feedback = [
        m.feedback.base_position
        for m in robot.client.hear("/move_base/feedback", ACTION_FEEDBACK)
        if m.status.goal_id.id == "first"
    ]
    assert feedback[0].header.frame_id == "map"
    start, end = (feedback[at].pose.position.y for at in (0, -1))
    assert start < end <= y_m + 1.7
    robot.send("again", x_m - 1.0, y_m + 1.5)
    assert robot.result("again")[0] == SUCCEEDED


def test_a_goal_that_is_none_is_rejected_and_one_beyond_the_fence_aborted(robot: Peer) -> None:
    robot.send("nan", math.nan, 1.0)
    assert robot.result("nan") == (
        REJECTED,
        "the position nan, 1 is not finite; send finite numbers",
    )
    robot.send("frame", 1.0, 1.0, frame="base_link")
    assert robot.result("frame") == (
        REJECTED,
        "frame 'base_link' is unknown; use one of map, odom, wgs84",
    )
    robot.send("far", 500.0, 1.0)
    status, text = robot.result("far")
    assert status == ABORTED
    assert text in list_texts(robot.session, "beyond_fence")


def test_a_canceled_goal_and_one_that_another_replaces_are_preempted(robot: Peer) -> None:
    x_m, y_m = robot.spawn
    robot.send("old", x_m - 2.0, y_m - 2.0)
    robot.send("new", x_m - 2.0, y_m - 1.0)
    assert robot.result("old")[0] == PREEMPTED
    robot.cancel("new")
    assert robot.result("new")[0] == PREEMPTED
    wait_for(lambda: abs(robot.session.simulator.truth().v_mps) < 0.01, "the robot to stand")


def test_the_three_tools_of_rviz_are_heard(robot: Peer) -> None:
    client, (x_m, y_m) = robot.client, robot.spawn
    point = client.make(
        "geometry_msgs/msg/PointStamped",
        client.header("map"),
        client.make("geometry_msgs/msg/Point", 1.25, -2.5, 0.0),
    )
    client.publish("/clicked_point", "geometry_msgs/msg/PointStamped", point)
    wait_for(lambda: robot.events("point: East 1.250 m, North -2.500 m"), "the point")
    half = math.sqrt(0.5)  # it looks North in the end
    goal = client.make(
        STAMPED, client.header("map"), client.pose(x_m - 2.0, y_m, (0.0, 0.0, half, half))
    )
    assert robot.tell(SIMPLE_GOAL, STAMPED, goal)[0] == SUCCEEDED
    assert robot.session.simulator.truth().yaw_map_rad == pytest.approx(math.pi / 2.0, abs=0.15)
    before = len(robot.events("pose_estimate"))
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = 0.25, 0.25, 0.0625
    stated = client.make(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        client.header("map"),
        client.make(
            "geometry_msgs/msg/PoseWithCovariance",
            client.pose(x_m - 2.0, y_m, (0.0, 0.0, half, half)),
            covariance,
        ),
    )
    client.publish(STATED_POSE, "geometry_msgs/msg/PoseWithCovarianceStamped", stated)
    events = wait_for(lambda: robot.events("pose_estimate")[before:], "the pose")
    assert events[0].endswith("1.571, 0.500, 0.250 (ROS 1 node /client)")


def test_a_list_of_places_is_visited_in_place_of_the_mission(robot: Peer) -> None:
    client, (x_m, y_m) = robot.client, robot.spawn
    places = [(x_m - 1.0, y_m + 1.0), (x_m - 1.0, y_m + 3.0)]
    poses = [client.pose(x, y, NO_TURN) for x, y in places]
    visit = client.make(ARRAY, client.header("map"), poses)
    assert robot.tell("/agribot/visit", ARRAY, visit)[0] == SUCCEEDED
    truth = robot.session.simulator.truth()
    assert math.hypot(truth.x_map_m - places[1][0], truth.y_map_m - places[1][1]) < 0.2
    nothing = client.make(ARRAY, client.header("map"), [])
    assert robot.tell("/agribot/visit", ARRAY, nothing) == (
        REJECTED,
        "it has no poses; send 1 to 1000",
    )


def test_a_service_shakes_hands_as_rosservice_expects(robot: Peer) -> None:
    sock, header = robot.client.connect("/agribot/pause", probe="1")
    with sock:
        assert (header["type"], header["md5sum"]) == ("std_srvs/SetBool", SET_BOOL.md5)
        assert sock.recv(1) == b""
    sock, header = robot.client.connect("/agribot/stop", md5sum="0" * 32)
    with sock:
        assert f"has md5 sum {TRIGGER.md5}" in header["error"]
    sock, _ = robot.client.connect("/agribot/mark", persistent="1")
    with sock:
        assert [ask(sock, b"")[0] for _ in range(3)] == [1, 1, 1]
        with pytest.raises(ServiceError, match="2 bytes; a request of std_srvs/Trigger is empty"):
            ask(sock, b"no")


def test_a_client_of_services_that_sends_rubbish_harms_nobody(robot: Peer) -> None:
    at = urlsplit(robot.client.master.services["/agribot/stop"])
    for rubbish in (b"", b"\xff\xff\xff\xff", b"\x08\0\0\0" + b"\xff" * 8, b"GET / HTTP/1.1\r\n"):
        with socket.create_connection((str(at.hostname), int(at.port or 0)), PATIENCE_S) as sock:
            sock.sendall(rubbish)
    robot.client.master.services["/agribot/nothing"] = at.geturl()
    sock, header = robot.client.connect("/agribot/nothing")
    sock.close()
    assert header == {"error": "no such service: /agribot/nothing"}
    assert robot.client.trigger("/agribot/mark").is_done


def test_without_leave_a_peer_may_only_bring_the_robot_to_rest(tmp_path: Path) -> None:
    with peer(tmp_path) as watched:
        client, (x_m, y_m) = watched.client, watched.spawn
        for name in ("resume", "start", "skip_row", "return_home", "clear_stop"):
            outcome = client.trigger(f"/agribot/{name}")
            assert not outcome.is_done
            assert "--allow-drive" in outcome.text
        client.master.parameters["/agribot/initial_pose"] = {"x": x_m, "y": y_m, "yaw": 0.0}
        assert "--allow-drive" in client.trigger("/agribot/set_pose").text
        watched.send("first", x_m - 1.0, y_m + 1.0)
        status, text = watched.result("first")
        assert status == REJECTED
        assert "--allow-drive" in text
        assert client.set_bool("/agribot/pause", value=True).is_done
        assert client.trigger("/agribot/stop").is_done
