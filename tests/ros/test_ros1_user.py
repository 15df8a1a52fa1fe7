"""Someone who knows ROS 1 sits at a run: rosservice, rostopic and a patrol, with the real tools."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from agribot.ros.requests import PAUSE_SERVICE, SERVICES, SET_POSE_SERVICE
from tests import machine, nightly
from tests.ros.live import ROOT
from tests.ros.ros1_system import Ros1
from tests.waiting import PATIENCE_S, wait_for

pytestmark = machine.needs("rosservice")

SYSTEM_PYTHON = "/usr/bin/python3"
FARM = (
    "ros1", "farm", "--allow-drive", "--set", "perception.enabled=false", "--out", "run",
)  # fmt: skip


class User:
    """At a terminal with ROS 1, beside a run in another one."""

    def __init__(self, ros: Ros1) -> None:
        self.ros, self.events = ros, ros.folder / "run" / "events.jsonl"
        self.robot = subprocess.Popen(
            [sys.executable, "-m", "agribot", *FARM, "--ros-master", ros.uri],
            cwd=ros.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def run(self, *command: str) -> str:
        return subprocess.run(
            command,
            env=self.ros.environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        ).stdout

    def call(self, name: str, *arguments: str) -> str:
        return self.run("rosservice", "call", name, *arguments)

    def publish(self, topic: str, kind: str, text: str) -> None:
        """With the header, pose and point as a person types them."""
        self.run("rostopic", "pub", "-1", topic, kind, text)

    def has_noted(self, text: str) -> bool:
        return self.events.is_file() and text in self.events.read_text()

    def close(self) -> None:
        self.robot.terminate()
        self.robot.wait(PATIENCE_S)


@pytest.fixture(scope="module")
def user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[User]:
    folder: Path = tmp_path_factory.mktemp("user")
    with closing(Ros1(folder)) as ros, closing(User(ros)) as user:
        wait_for(lambda: "/agribot/stop" in user.run("rosservice", "list"), "the services")
        wait_for(lambda: user.has_noted("position known"), "the robot to know its place")
        yield user


@nightly.by_day(
    "tests/ros/test_ros1_requests.py::test_services_say_what_the_mission_makes_of_a_request",
    "tests/ros/test_ros1_requests.py::test_a_service_shakes_hands_as_rosservice_expects",
)
def test_rosservice_lists_types_and_calls_every_service(user: User) -> None:
    listed = set(user.run("rosservice", "list").split())
    assert {PAUSE_SERVICE, SET_POSE_SERVICE, *(name for name, _ in SERVICES)} <= listed
    assert user.run("rosservice", "type", "/agribot/skip_row").strip() == "std_srvs/Trigger"
    assert user.run("rosservice", "type", PAUSE_SERVICE).strip() == "std_srvs/SetBool"
    assert "success: True" in user.call(PAUSE_SERVICE, "true")
    assert "success: True" in user.call("/agribot/stop")
    assert "clear the stop first" in user.call("/agribot/start")
    assert "success: True" in user.call("/agribot/clear_stop")


@nightly.by_day(
    "tests/ros/test_ros1_requests.py::test_the_pose_of_the_parameter_is_believed_by_a_robot_that_stands",
    "tests/ros/test_ros1_requests.py::test_the_three_tools_of_rviz_are_heard",
)
def test_what_the_tools_of_rviz_publish_is_heard(user: User) -> None:
    user.call(PAUSE_SERVICE, "true")
    head = "header: {frame_id: map}"
    user.publish(
        "/clicked_point", "geometry_msgs/PointStamped", f"{{{head}, point: {{x: 1.25, y: -2.5}}}}"
    )
    wait_for(lambda: user.has_noted("point: East 1.250 m, North -2.500 m"), "the point")
    user.run("rosparam", "set", "/agribot/initial_pose", "{x: -2.0, y: 0.0, yaw: 0.0}")
    wait_for(lambda: "success: True" in user.call(SET_POSE_SERVICE), "the robot to stand")
    pose = "pose: {pose: {position: {x: -2.0, y: 0.0}, orientation: {w: 1.0}}}"
    user.publish("/initialpose", "geometry_msgs/PoseWithCovarianceStamped", f"{{{head}, {pose}}}")
    wait_for(lambda: user.has_noted("pose_estimate -2.000, 0.000, 0.000, 0.500"), "the pose")
    place = "pose: {position: {x: -2.0, y: 1.0}, orientation: {w: 1.0}}"
    user.publish("/move_base_simple/goal", "geometry_msgs/PoseStamped", f"{{{head}, {place}}}")
    wait_for(lambda: user.has_noted("at the goal of ROS 1 node /rostopic"), "the robot to arrive")


@nightly.by_day(
    "tests/ros/test_ros1_requests.py::test_a_goal_of_the_action_is_driven_reported_and_succeeds",
    "tests/ros/test_ros1_requests.py::test_a_goal_that_is_none_is_rejected_and_one_beyond_the_fence_aborted",
    "tests/ros/test_ros1_requests.py::test_a_list_of_places_is_visited_in_place_of_the_mission",
)
def test_a_patrol_with_actionlib_drives_from_goal_to_goal(user: User) -> None:
    places = ("map,-2.0,2.0", "map,-2.0,3.0", "map,500.0,1.0", "base_link,1.0,0.0")
    script = str(ROOT / "tests" / "ros" / "ros1_patrol.py")
    lines = user.run(SYSTEM_PYTHON, script, *places).splitlines()
    assert [line.partition(" ")[0] for line in lines] == ["3", "3", "4", "5"]
    assert "beyond the fence" in lines[2]
    assert "not one of map, odom, wgs84" in lines[3]
    poses = "poses: [{position: {x: -2.0, y: 1.0}}, {position: {x: -2.0, y: 3.0}}]"
    user.publish(
        "/agribot/visit", "geometry_msgs/PoseArray", f"{{header: {{frame_id: map}}, {poses}}}"
    )
    wait_for(lambda: user.robot.poll() is not None, "the run to end with the visit")
    assert user.robot.returncode == 0
    assert user.has_noted("visit -2.000, 1.000, -2.000, 3.000 (ROS 1 node /rostopic")
