"""Goals of Nav2's actions, NavigateToPose and NavigateThroughPoses.

The first sends the robot to one place, from which `resume` leads back to its mission, the second to
places that it visits in place of the mission. One goal at a time: a new one takes the place of the
one before, as in Nav2.
"""

from __future__ import annotations

import functools
import hashlib
from typing import Any, NamedTuple

import numpy as np

from agribot.core.errors import BridgeError
from agribot.core.messages import TickRecord
from agribot.core.topics import LATCHED, Topic
from agribot.ros.frames import PeerFrames
from agribot.ros.goals import GoalBook, GoalState, PeerGoal, find_places
from agribot.ros.messages.rosmsg import make_pose_stamped
from agribot.ros.requests import Requests
from agribot.ros.ros2.services import (
    NAVIGATE,
    NAVIGATE_RESULTS,
    NAVIGATE_TO_POSE,
    load_service_types,
)
from agribot.ros.ros2.serving import Reply, ServingNode

FEEDBACK_PERIOD_S = 0.5
# action_msgs/GoalStatus and the return codes of CancelGoal
_UNKNOWN, _SUCCEEDED = 0, 4
_STATUS: dict[GoalState, int] = {
    "pending": 1, "active": 2, "canceling": 3, "succeeded": _SUCCEEDED, "canceled": 5, "aborted": 6,
    "replaced": 6,
}  # fmt: skip
_ERROR_NONE, _ERROR_UNKNOWN_GOAL, _ERROR_TERMINATED = 0, 2, 3


class NavigationAction(NamedTuple):
    """One of Nav2's actions; a visit has several poses."""

    name: str
    ros_type: str
    is_visit: bool

    @property
    def feedback(self) -> Topic:
        return Topic(
            name=f"{self.name}/_action/feedback", ros_type=f"{self.ros_type}_FeedbackMessage"
        )

    @property
    def status(self) -> Topic:
        return Topic(
            name=f"{self.name}/_action/status",
            ros_type="action_msgs/msg/GoalStatusArray",
            qos=LATCHED,
        )


TO_POSE = NavigationAction("/navigate_to_pose", NAVIGATE_TO_POSE, is_visit=False)
THROUGH_POSES = NavigationAction("/navigate_through_poses", NAVIGATE, is_visit=True)


class GoalServer:
    """Serves an action: requests in the network's threads, `step` in the publisher's."""

    def __init__(self, node: ServingNode, requests: Requests, action: NavigationAction) -> None:
        self._action, self._types, self._source = action, load_service_types(), node.source
        self._frames = requests.frames or PeerFrames()
        self.goals = GoalBook(requests, self._on_change)
        self._waiting: dict[str, list[tuple[Reply, str]]] = {}  # for results, by goal
        self._next_feedback_s = 0.0
        self._feedback = node.create_publisher(action.feedback, self._types)
        self._status = node.create_publisher(action.status)
        self._serve(node)

    def _serve(self, server: ServingNode) -> None:
        name, ros_type = self._action.name, self._action.ros_type
        server.serve(
            self._types, f"{name}/_action/send_goal", f"{ros_type}_SendGoal", self._on_send_goal
        )
        server.serve(
            self._types,
            f"{name}/_action/cancel_goal",
            "action_msgs/srv/CancelGoal",
            self._on_cancel,
        )
        for result in NAVIGATE_RESULTS if server.distinguishes_forms else NAVIGATE_RESULTS[:1]:
            server.serve(
                load_service_types(result),
                f"{name}/_action/get_result",
                f"{ros_type}_GetResult",
                functools.partial(self._on_result, result),
            )

    def step(self, record: TickRecord) -> None:
        """Update the goals by a tick of the robot."""
        with self.goals.lock:
            under_way, now_s = self.goals.step(record), record.batch.t_s
            # Before the way is planned there is nothing to report.
            if under_way and record.status.length_m and now_s >= self._next_feedback_s:
                self._next_feedback_s = now_s + FEEDBACK_PERIOD_S
                for goal in under_way:
                    self._send_feedback(goal, record)

    def _send_feedback(self, goal: PeerGoal, record: TickRecord) -> None:
        make, status = self._types.types, record.status
        fields: list[Any] = [
            make_pose_stamped(record.estimate),
            self._make_duration(self.goals.now_s - (goal.since_s or 0.0)),
            self._make_duration(status.eta_s or 0.0),
            0,
            status.distance_left_m,
        ]
        if self._action.is_visit:
            fields.append(len(goal.places) - status.waypoints_reached)
        ros_type = self._action.feedback.ros_type
        feedback = make[f"{self._action.ros_type}_Feedback"](*fields)
        message = make[ros_type](self._make_uuid(goal), feedback)
        self._feedback(bytes(self._types.serialize_cdr(message, ros_type)))

    def _on_change(self, goal: PeerGoal) -> None:
        if goal.is_over:
            for reply, result in self._waiting.pop(goal.name, []):
                self._send_result(goal, reply, result)
        self._publish_status()

    def _on_send_goal(self, request: Any, reply: Reply) -> None:
        goal = PeerGoal(
            name=request.goal_id.uuid.tobytes().hex(),
            places=(),
            is_visit=self._action.is_visit,
            source=self._source,
        )
        with self.goals.lock:
            try:
                goal.places = self._read_places(request.goal)
            except BridgeError as error:
                self.goals.reject(goal, str(error))
                accepted = False
            else:
                accepted = self.goals.begin(goal)
            reply(accepted, self._make_time())

    def _read_places(self, goal: Any) -> tuple[tuple[float, float, float | None], ...]:
        if self._action.is_visit:
            points = [(pose.header.frame_id, pose.pose.position) for pose in goal.poses]
            return find_places(self._frames, points)
        return (self._frames.find_pose(goal.pose.header.frame_id, goal.pose.pose),)

    def _on_cancel(self, request: Any, reply: Reply) -> None:
        """Cancel the goal of the id, or with an id of zeros all; this is always allowed."""
        wanted = request.goal_info.goal_id.uuid.tobytes()
        with self.goals.lock:
            named = [g for g in self.goals.goals.values() if wanted in {bytes(16), _find_id(g)}]
            running = [goal for goal in named if not goal.is_over]
            for goal in running:
                self.goals.cancel(goal, self._source)
            code = _ERROR_NONE
            if not running and wanted != bytes(16):
                code = _ERROR_TERMINATED if named else _ERROR_UNKNOWN_GOAL
            reply(code, [self._make_info(goal) for goal in running])

    def _on_result(self, result: str, request: Any, reply: Reply) -> None:
        name = request.goal_id.uuid.tobytes().hex()
        with self.goals.lock:
            goal = self.goals.goals.get(name)
            if goal is not None and not goal.is_over:
                self._waiting.setdefault(name, []).append((reply, result))
            else:
                self._send_result(goal, reply, result)

    def _send_result(self, goal: PeerGoal | None, reply: Reply, result: str) -> None:
        status = _STATUS.get(goal.state, _UNKNOWN) if goal else _UNKNOWN
        fields: list[Any] = [0 if status == _SUCCEEDED else status]
        if "error_msg" in result:
            fields.append(goal.reason if goal else "no such goal")
        types = load_service_types(result).types
        reply(status, types[f"{self._action.ros_type}_Result"](*fields))

    def _publish_status(self) -> None:
        """Publish the states of all goals but those that were rejected, as ROS 2 does."""
        make, ros_type = self._types.types, self._action.status.ros_type
        statuses = [
            make["action_msgs/msg/GoalStatus"](self._make_info(goal), _STATUS[goal.state])
            for goal in self.goals.goals.values()
            if goal.state in _STATUS
        ]
        self._status(bytes(self._types.serialize_cdr(make[ros_type](statuses), ros_type)))

    def _make_info(self, goal: PeerGoal) -> Any:
        return self._types.types["action_msgs/msg/GoalInfo"](
            self._make_uuid(goal), self._make_time()
        )

    def _make_uuid(self, goal: PeerGoal) -> Any:
        make = self._types.types["unique_identifier_msgs/msg/UUID"]
        return make(np.frombuffer(_find_id(goal), dtype=np.uint8))

    def _make_time(self) -> Any:
        sec, part = divmod(self.goals.now_s, 1.0)
        return self._types.types["builtin_interfaces/msg/Time"](int(sec), int(part * 1e9))

    def _make_duration(self, seconds: float) -> Any:
        sec, part = divmod(max(seconds, 0.0), 1.0)
        return self._types.types["builtin_interfaces/msg/Duration"](int(sec), int(part * 1e9))


def _find_id(goal: PeerGoal) -> bytes:
    """Find the 16 bytes of a client's goal, and some for a goal that came by a topic."""
    try:
        return bytes.fromhex(goal.name)
    except ValueError:
        return hashlib.md5(goal.name.encode(), usedforsecurity=False).digest()
