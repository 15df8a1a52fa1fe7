"""Against a ROS 2 that is installed, with its own command line; skips without one.

Run it with the environment of that ROS 2 sourced, and with PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 where
pytest stumbles over the plugins of ROS. Each middleware that is installed is tried; those on DDS
where this machine has the cyclonedds wheel.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

import pytest

from agribot.core import topics
from tests.waiting import wait_for

pytestmark = [
    pytest.mark.elsewhere,
    pytest.mark.skipif(shutil.which("ros2") is None, reason="needs an installed ROS 2"),
]
DOMAIN = {"zenoh": "73", "fastrtps": "74", "cyclonedds": "75"}
DISTRIBUTION = os.environ.get("ROS_DISTRO", "")
FIRST_START_S = 180.0  # compiles the simulator
NO_DAEMON = ("--no-daemon", "--spin-time", "3")


class Ros2:
    """Its command line and a robot, both on one middleware."""

    def __init__(self, middleware: str) -> None:
        self.middleware = middleware
        # What is printed must be there when a command that never ends is interrupted.
        self.environment = {
            **os.environ, "ROS_DOMAIN_ID": DOMAIN[middleware], "PYTHONUNBUFFERED": "1",
            "RMW_IMPLEMENTATION": f"rmw_{middleware}_cpp",
        }  # fmt: skip
        if DISTRIBUTION == "humble":
            self.environment["ROS_LOCALHOST_ONLY"] = "1"
        else:
            self.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

    def __call__(self, *words: str, timeout_s: float = 60.0) -> str:
        """What it prints, also when it never ends by itself and is interrupted."""
        with subprocess.Popen(
            ["ros2", *words], env=self.environment, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        ) as process:  # fmt: skip
            try:
                return process.communicate(timeout=timeout_s)[0]
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGINT)
                try:
                    return process.communicate(timeout=20.0)[0]
                except subprocess.TimeoutExpired:
                    os.killpg(process.pid, signal.SIGKILL)
                    return process.communicate()[0]

    def has(self, package: str) -> bool:
        return "not found" not in self("pkg", "prefix", package).lower()

    def echo(self, topic: str, *words: str) -> str:
        return self("topic", "echo", "--once", topic, *words, *NO_DAEMON)

    @contextmanager
    def robot(self, out_dir: Path) -> Iterator[None]:
        """Waits for goals at real time and may be driven."""
        bridge = "--ros2" if self.middleware == "zenoh" else "--dds"
        command = [sys.executable, "-m", "agribot.cli", "run", "farm", bridge, "--allow-drive"]
        for setting in ("perception.enabled=false", "mission.waits_for_goals=true"):
            command += ["--set", setting]
        with subprocess.Popen(
            [*command, "--out", str(out_dir)], env=self.environment, start_new_session=True
        ) as process:
            try:
                wait_for(
                    lambda: "/agribot/fix" in self("topic", "list", *NO_DAEMON),
                    "the robot",
                    FIRST_START_S,
                )
                yield
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGINT)
                process.wait(60.0)


@pytest.fixture(scope="module", params=list(DOMAIN))
def ros2(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Ros2]:
    ros = Ros2(request.param)
    if not ros.has(f"rmw_{ros.middleware}_cpp"):
        pytest.skip(f"needs rmw_{ros.middleware}_cpp")
    if ros.middleware != "zenoh" and find_spec("cyclonedds") is None:
        pytest.skip("needs the cyclonedds wheel")
    with ros.robot(tmp_path_factory.mktemp("run")):
        yield ros


def test_topic_list_shows_every_topic_with_its_type(ros2: Ros2) -> None:
    listed = ros2("topic", "list", "-t", *NO_DAEMON)
    left_out = {topics.CMD_VEL.name, topics.IMAGE_RAW.name}
    for topic in topics.TOPICS:
        if topic.ros_type and topic.name not in left_out:
            assert f"{topic.name} [{topic.ros_type}]" in listed, topic.name


def test_topic_info_knows_the_type_hash(ros2: Ros2) -> None:
    info = ros2("topic", "info", "-v", "/agribot/fix", *NO_DAEMON)
    assert "Node name: agribot" in info
    if DISTRIBUTION != "humble":  # which prints no hashes
        assert "RIHS01_62223ab3" in info


def test_topic_echo_prints_fixes_and_the_latched_description(ros2: Ros2) -> None:
    fix = ros2.echo("/agribot/fix")
    (latitude,) = re.findall(r"^latitude: ([-\d.]+)", fix, re.MULTILINE)
    assert abs(float(latitude) - 21.1613) < 0.001
    options = ("--qos-durability", "transient_local", "--qos-reliability", "reliable")
    assert "<robot" in ros2.echo("/robot_description", *options)


def test_topic_hz_measures_the_imus_rate(ros2: Ros2) -> None:
    rates = re.findall(r"average rate: ([\d.]+)", ros2("topic", "hz", "/agribot/imu", timeout_s=15))
    assert 150.0 < float(rates[-1]) < 250.0


def test_the_frame_tree_leads_from_the_map_to_the_camera(ros2: Ros2) -> None:
    said = ros2("run", "tf2_ros", "tf2_echo", "map", "camera_optical_frame", timeout_s=15)
    assert "Translation" in said


def test_topic_pub_drives_the_robot(ros2: Ros2) -> None:
    def north_m() -> float:
        said = ros2.echo("/ground_truth/odometry", "--field", "pose.pose")
        return float(re.findall(r"y: ([-\d.e]+)", said)[0])

    before_m = north_m()
    twist = "{linear: {x: 0.3}}"
    ros2(
        "topic", "pub", "-r", "20", "-t", "60", "/agribot/cmd_vel", "geometry_msgs/msg/Twist", twist
    )
    assert north_m() - before_m > 0.3


def test_a_goal_is_driven(ros2: Ros2) -> None:
    if ros2.middleware != "zenoh" or DISTRIBUTION != "jazzy" or not ros2.has("nav2_msgs"):
        pytest.skip("needs rmw_zenoh_cpp and the nav2_msgs of Jazzy: the goal's type has changed")
    goal = "{poses: [{header: {frame_id: map}, pose: {position: {x: -3.0, y: 3.0}}}]}"
    kind = "nav2_msgs/action/NavigateThroughPoses"
    said = ros2("action", "send_goal", "--feedback", "/navigate_through_poses", kind, goal,
                timeout_s=180.0)  # fmt: skip
    assert "Goal accepted" in said
    assert "distance_remaining" in said
    assert "SUCCEEDED" in said


def test_parameters_are_listed_and_read(ros2: Ros2) -> None:
    if ros2.middleware != "zenoh":
        pytest.skip("services need rmw_zenoh_cpp")
    assert "mission.speed_mps" in ros2("param", "list", "/agribot", *NO_DAEMON)
    assert "True" in ros2("param", "get", "/agribot", "use_sim_time", *NO_DAEMON)
