"""A robot as a program of ROS 1 sees it: what it publishes, and how it is asked for something.

For the system's own Python with rospy.
"""

# mypy: disable-error-code="import-not-found"
from __future__ import annotations

import json
import math
import statistics
import subprocess
import time
from collections.abc import Callable
from typing import Any

import genpy.dynamic
import rosgraph
import rospy
import rosservice
from geometry_msgs.msg import Pose, Quaternion
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu
from std_msgs.msg import String

PATIENCE_S = 60.0
SEPARATOR = f"{'=' * 80}\nMSG: "  # between the texts of a type and of those in it


class Failed(Exception):
    """What a step saw that it should not have seen."""


class Robot:
    """Its mission, and where it really is."""

    def __init__(self) -> None:
        self.status: dict[str, Any] = {}
        self.truth = (math.nan, math.nan)
        self.yaw_rad = self.v_mps = math.nan
        rospy.Subscriber("/agribot/mission/status", String, self._take_status)
        rospy.Subscriber("/ground_truth/odometry", Odometry, self._take_truth)

    @property
    def state(self) -> str:
        return str(self.status.get("state", ""))

    @property
    def stands(self) -> bool:
        return abs(self.v_mps) < 0.01

    @property
    def drives(self) -> bool:
        return self.state == "running" and self.v_mps > 0.1

    def is_at(self, x_m: float, y_m: float) -> bool:
        return math.dist(self.truth, (x_m, y_m)) < 0.25

    def looks(self, yaw_rad: float) -> bool:
        return abs(math.remainder(self.yaw_rad - yaw_rad, math.tau)) < 0.2

    def _take_status(self, message: Any) -> None:
        self.status = json.loads(message.data)

    def _take_truth(self, message: Any) -> None:
        pose, turn = message.pose.pose, message.pose.pose.orientation
        self.truth = (pose.position.x, pose.position.y)
        self.yaw_rad = 2.0 * math.atan2(turn.z, turn.w)
        self.v_mps = message.twist.twist.linear.x


class Places:
    """Where the robot believes to be, 50 times a second, until it is closed."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, float]] = []
        self._subscriber = rospy.Subscriber("/agribot/odometry/estimate", Odometry, self._take)
        wait(lambda: self.seen, "no estimate")

    def include(self, x_m: float, y_m: float) -> bool:
        return any(math.dist(place, (x_m, y_m)) < 0.1 for place in self.seen.copy())

    def close(self) -> None:
        self._subscriber.unregister()

    def _take(self, message: Any) -> None:
        self.seen.append((message.pose.pose.position.x, message.pose.pose.position.y))


class Gyro:
    """What the gyro samples, until it is closed."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, float]] = []  # s, rad/s
        self._subscriber = rospy.Subscriber("/agribot/imu", Imu, self._take)

    def measure(self) -> float:
        """The deviation of 200 samples from now on, rad/s."""
        since_s = rospy.get_time()

        def list_new() -> list[float]:
            return [rate for t_s, rate in self._seen.copy() if t_s > since_s]

        wait(lambda: len(list_new()) > 200, lambda: f"no IMU since {since_s}: {self._describe()}")
        return statistics.pstdev(list_new())

    def close(self) -> None:
        self._subscriber.unregister()

    def _describe(self) -> str:
        connections = self._subscriber.get_num_connections()
        return f"{connections} connections, {len(self._seen)} samples, last {self._seen[-1:]}"

    def _take(self, message: Any) -> None:
        self._seen.append((message.header.stamp.to_sec(), message.angular_velocity.x))


def run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    return done.stdout


def call(name: str, *arguments: object) -> Any:
    """Call a service of the robot as `rosservice call` does, without a process for each call."""
    service = f"/agribot/{name}"
    return rospy.ServiceProxy(service, rosservice.get_service_class_by_name(service))(*arguments)


def check(is_so: object, what: object) -> None:
    """Raises: Failed: it is not so; with what was seen."""
    if not is_so:
        raise Failed(str(what))


def wait(is_so: Callable[[], Any], what: Callable[[], object] | str) -> Any:
    """Wait for something; only its absence fails."""
    end_s = time.monotonic() + PATIENCE_S
    while not (value := is_so()):
        if time.monotonic() > end_s:
            raise Failed(f"waited in vain; {what if isinstance(what, str) else what()}")
        rospy.rostime.wallsleep(0.02)
    return value


def do(robot: Robot, name: str, is_done: Callable[[], Any], *arguments: object) -> None:
    """Call a service that succeeds, and wait for what it does to the robot."""
    answer = call(name, *arguments)
    check(answer.success, f"{name}: {answer.message}")
    wait(is_done, lambda: f"{name}: {robot.status}")


def make_pose(x_m: float, y_m: float, yaw_rad: float) -> Any:
    pose = Pose()
    pose.position.x, pose.position.y = x_m, y_m
    pose.orientation = Quaternion(0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0))
    return pose


def publish(topic: str, message: Any, listeners: int = 1) -> None:
    """Publish one message once the robot and all others listen, as RViz does."""
    publisher = rospy.Publisher(topic, type(message), queue_size=1)
    wait(lambda: "/agribot" in list_listeners(topic), f"{topic}: not heard")
    wait(lambda: publisher.get_num_connections() >= listeners, f"{topic}: not heard")
    publisher.publish(message)


def list_listeners(topic: str) -> list[str]:
    _, subscribers, _ = rosgraph.Master("/user").getSystemState()
    return list(dict(subscribers).get(topic, []))


def make_service(
    name: str, md5: str, request: str, response: str, further: str
) -> tuple[Any, dict[str, Any]]:
    """Make what a service's package generates, and the messages in it, from their texts."""
    kinds: dict[str, Any] = {}
    for part, text in (("Request", request), ("Response", response)):
        kinds |= genpy.dynamic.generate_dynamic(name + part, f"{text}\n{further}")
    fields = {
        "_type": name, "_md5sum": md5,
        "_request_class": kinds[f"{name}Request"], "_response_class": kinds[f"{name}Response"],
    }  # fmt: skip
    return type(name.rpartition("/")[2], (), fields), kinds
