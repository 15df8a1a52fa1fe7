"""What a user of ROS 2 does with this robot, over rmw_zenoh's wire or over DDS; the same steps.

    agribot ros2 farm --dds --allow-drive --sensors rtk --set mission.waits_for_goals=true --out run
    .venv/bin/python -m tests.ros.ros2_user zenoh run/events.jsonl        # or dds

Every step looks at what became of the robot, and says pass or fail with what it saw. The exit
status is the number of those that failed.
"""

from __future__ import annotations

import functools
import json
import math
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from agribot.core import topics
from agribot.core.fact_text import render
from agribot.core.facts import StopHolds
from agribot.core.inbound_topics import CLICKED_POINT, GOAL_POSE, INITIAL_POSE, VISIT
from agribot.core.topics import Topic
from agribot.ros.messages import rosmsg
from tests.ros.ros2_transports import TRANSPORTS, Transport
from tests.waiting import wait_for

RATED = (topics.IMU, topics.ODOM, topics.JOINT_STATES, topics.FIX, topics.POSE, topics.MAGNETIC)
HEARD = (*RATED, topics.STATUS, topics.GROUND_TRUTH, topics.ODOMETRY, CLICKED_POINT)
NORTH_RAD = math.pi / 2.0


class User:
    """Someone at a network, who sees the robot by its topics alone."""

    def __init__(self, transport: Transport, events: Path) -> None:
        self.transport, self._events = transport, events
        for topic in HEARD:
            transport.hear(topic)

    def newest(self, topic: Topic) -> Any:
        return wait_for(lambda: self.transport.heard[topic.name], topic.name)[-1]

    @property
    def status(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.newest(topics.STATUS).data)
        return found

    @property
    def truth(self) -> tuple[float, float, float]:
        """x, y (m) and yaw (rad) in the map."""
        pose = self.newest(topics.GROUND_TRUTH).pose.pose
        yaw_rad = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return pose.position.x, pose.position.y, yaw_rad

    @property
    def v_mps(self) -> float:
        return float(self.newest(topics.GROUND_TRUTH).twist.twist.linear.x)

    @property
    def stands(self) -> bool:
        return abs(self.v_mps) < 0.01

    @property
    def drives(self) -> bool:
        return self.status["state"] == "running" and self.v_mps > 0.1

    def stands_at(self, x_m: float, y_m: float) -> bool:
        return self.stands and math.dist(self.truth[:2], (x_m, y_m)) < 0.25

    def noted(self, text: str) -> int:
        return self._events.read_text().count(text)

    def ask(self, name: str, is_done: Callable[[], Any]) -> None:
        """Make a request that is taken, and wait for what it does to the robot."""
        self.transport.request(name)
        wait_for(is_done, f"{name}: {self.status}")

    def wait_until_believed(self, x_m: float, y_m: float) -> str:
        """Wait until it believed to be there, and until its receiver knew better."""
        wait_for(lambda: self.believed(x_m, y_m), "the pose to be believed")
        self.transport.heard[topics.ODOMETRY.name].clear()
        wait_for(lambda: self.believed(*self.truth[:2]), "the receiver to correct the pose")
        return f"believed to be at {x_m:.2f}, {y_m:.2f}, and corrected"

    def believed(self, x_m: float, y_m: float) -> bool:
        """Whether it has believed to be there since the messages were cleared."""
        heard = self.transport.heard[topics.ODOMETRY.name].copy()
        places = ((m.pose.pose.position.x, m.pose.pose.position.y) for m in heard)
        return any(math.dist(place, (x_m, y_m)) < 0.1 for place in places)


def list_topics(user: User) -> str:
    listed = user.transport.list_topics()
    wrong = [topic.name for topic in topics.TOPICS if topic.rate_hz
             and topic.name in listed and listed[topic.name] != topic.ros_type]  # fmt: skip
    assert not wrong and {topic.name for topic in HEARD} <= listed.keys(), wrong
    return f"{len(listed)} topics"


def measure_rates(user: User) -> str:
    """Over the stamps, which are of the robot's clock."""
    return ", ".join(f"{topic.name} {wait_for_rate_hz(user, topic):.1f} Hz" for topic in RATED)


def wait_for_rate_hz(user: User, topic: Topic) -> float:
    return wait_for(lambda: measure_rate_hz(user, topic), f"the rate of {topic.name}")


def measure_rate_hz(user: User, topic: Topic) -> float | None:
    """The rate of the last two seconds, once it is that of the table."""
    stamps = [rosmsg.to_seconds(m.header.stamp) for m in user.transport.heard[topic.name].copy()]
    if len(stamps) < 2 or stamps[-1] - stamps[0] < 2.0:
        return None
    recent = [t_s for t_s in stamps if t_s >= stamps[-1] - 2.0]
    rate_hz = (len(recent) - 1) / (recent[-1] - recent[0])
    return rate_hz if abs(rate_hz / (topic.rate_hz or 1.0) - 1.0) < 0.05 else None


def echo_topics(user: User) -> str:
    fix, up_mps2 = user.newest(topics.FIX), user.newest(topics.IMU).linear_acceleration.z
    assert abs(fix.latitude - 21.1613) < 0.001 and abs(up_mps2 - 9.8) < 1.0
    return f"latitude {fix.latitude:.5f}, specific force upwards {up_mps2:.2f} m/s2"


def stop_and_clear(user: User) -> str:
    user.ask("resume", lambda: user.drives)
    user.ask("stop", lambda: user.status["stopped"] and user.stands)
    user.ask("start", lambda: render(StopHolds()) in user.status["refusal"])
    user.ask("clear_stop", lambda: not user.status["stopped"])
    return f"stood, {user.status['refusal']}, cleared"


def skip_and_pause(user: User) -> str:
    user.ask("resume", lambda: user.drives)
    first = user.status["leg"]
    user.ask("skip_row", lambda: user.status["leg"] == "to row 2")
    user.ask("pause", lambda: user.status["state"] == "paused" and user.stands)
    return f"{first}, then {user.status['leg']}, then paused"


def go_home_and_cancel(user: User) -> str:
    user.ask("return_home", lambda: user.status["leg"] == "way home" and user.drives)
    user.ask("cancel", lambda: user.status["state"] == "cancelled" and user.stands)
    user.ask("start", lambda: user.status["leg"] == "to row 1" and user.drives)
    user.ask("pause", lambda: user.status["state"] == "paused" and user.stands)
    return "on its way home, cancelled, began anew, paused"


def mark(user: User) -> str:
    before = user.noted('"kind":"mark"')
    user.ask("mark", lambda: user.noted('"kind":"mark"') == before + 1)
    return "noted"


def state_the_pose(user: User) -> str:
    """The robot believes it until its receiver knows better."""
    x_m, y_m, yaw_rad = user.truth
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = 0.25, 0.25, 0.0685  # what RViz states
    stated = rosmsg.make_message(
        "geometry_msgs/msg/PoseWithCovariance",
        rosmsg.make_pose(x_m, y_m + 0.4, yaw_rad),
        covariance,
    )
    user.transport.heard[topics.ODOMETRY.name].clear()
    user.transport.publish(INITIAL_POSE, rosmsg.make_header(0.0, "map"), stated)
    return user.wait_until_believed(x_m, y_m + 0.4)


def send_a_goal(user: User) -> str:
    pose = rosmsg.make_pose(-2.0, 0.5, NORTH_RAD)
    user.transport.publish(GOAL_POSE, rosmsg.make_header(0.0, "map"), pose)
    wait_for(
        lambda: user.stands_at(-2.0, 0.5) and abs(user.truth[2] - NORTH_RAD) < 0.2,
        f"the goal: {user.status}",
    )
    return f"stands at {user.truth[0]:.2f}, {user.truth[1]:.2f} and looks North"


def publish_a_point(user: User) -> str:
    """It is noted once, and the robot does not publish it again."""
    before, heard = user.noted(POINT_NOTE), user.transport.heard[CLICKED_POINT.name]
    point = rosmsg.make_point(1.25, -2.5)
    user.transport.publish(CLICKED_POINT, rosmsg.make_header(0.0, "map"), point)
    wait_for(lambda: user.noted(POINT_NOTE) > before, "the point")
    mark(user)  # what the point would lead to has come when this is noted
    assert user.noted(POINT_NOTE) == before + 1 and not heard, f"published again {len(heard)} times"
    return "noted once, and not published again"


POINT_NOTE = "point: East 1.250 m, North -2.500 m"


def go_from_goal_to_goal(user: User) -> str:
    for y_m in (1.1, 1.7):
        user.transport.go_to(-2.0, y_m)
        wait_for(functools.partial(user.stands_at, -2.0, y_m), f"{y_m} m North")
    return f"two goals reached, North {user.truth[1]:.2f} m"


def visit_a_list(user: User) -> str:
    poses = [rosmsg.make_pose(-2.0, y_m, 0.0) for y_m in (2.3, 2.9)]
    user.transport.publish(VISIT, rosmsg.make_header(0.0, "map"), poses)
    wait_for(lambda: user.status["task"] and user.status["state"] == "done", "the visit to end")
    wait_for(lambda: user.stands_at(-2.0, 2.9), "the robot to stand there")
    return f"{user.status['waypoints_reached']} of 2 places"


STEPS: tuple[tuple[str, Callable[[User], str]], ...] = (
    ("topics and types", list_topics),
    ("rates", measure_rates),
    ("messages", echo_topics),
    ("resume, stop, start, clear_stop", stop_and_clear),
    ("skip_row, pause", skip_and_pause),
    ("return_home, cancel, start", go_home_and_cancel),
    ("mark", mark),
    ("RViz, 2D Pose Estimate", state_the_pose),
    ("RViz, 2D Goal Pose", send_a_goal),
    ("RViz, Publish Point", publish_a_point),
    ("one goal after the other", go_from_goal_to_goal),
    ("a list of places at once", visit_a_list),
)


def run_steps(user: User) -> int:
    """The number of steps that failed."""
    failed = 0
    for name, step in (*STEPS, *user.transport.steps):
        try:
            line = f"pass  {user.transport.name}, {name}: {step(user)}"
        except AssertionError as error:
            line, failed = f"fail  {user.transport.name}, {name}: {error}", failed + 1
        sys.stdout.write(f"{line}\n")
    return failed


if __name__ == "__main__":
    with closing(TRANSPORTS[sys.argv[1]]()) as opened:
        sys.exit(run_steps(User(opened, Path(sys.argv[2]))))
