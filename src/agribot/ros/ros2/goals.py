"""Goals of nav2_msgs/NavigateThroughPoses: places that the robot visits in place of its mission.

One goal at a time: a new one takes the place of the one before, as in Nav2.
"""

from __future__ import annotations

import functools
import math
import threading
from typing import Any

import msgspec
import numpy as np

from agribot.core.messages import MissionState, TickRecord
from agribot.core.topics import LATCHED, Topic
from agribot.ros.messages.rosmsg import MAP_FRAME, make_pose_stamped
from agribot.ros.requests import Requests
from agribot.ros.ros2.node import Ros2Node
from agribot.ros.ros2.service_server import Reply, ServiceServer
from agribot.ros.ros2.services import NAVIGATE, NAVIGATE_RESULTS, load_service_types

NAME = "/navigate_through_poses"
FEEDBACK_PERIOD_S = 0.5
TAKEN_UP_S = 5.0  # until then the robot's status must show a new goal
_KEPT_GOALS = 100
# action_msgs/GoalStatus and the return codes of CancelGoal
_UNKNOWN, _ACCEPTED, _EXECUTING, _CANCELING, _SUCCEEDED, _CANCELED, _ABORTED = range(7)
_ERROR_NONE, _ERROR_UNKNOWN_GOAL, _ERROR_TERMINATED = 0, 2, 3
_OVER: dict[MissionState, int] = {
    "done": _SUCCEEDED, "cancelled": _CANCELED, "failed": _ABORTED,
}  # fmt: skip
FEEDBACK = Topic(name=f"{NAME}/_action/feedback", ros_type=f"{NAVIGATE}_FeedbackMessage")
STATUS = Topic(
    name=f"{NAME}/_action/status", ros_type="action_msgs/msg/GoalStatusArray", qos=LATCHED
)


class NavigationGoal(msgspec.Struct, kw_only=True):
    """A goal of a client; `waiting` are the requests for its result before there was one."""

    id: bytes
    poses: int
    state: int = _ACCEPTED
    reason: str = ""
    since_s: float | None = None
    taken_up: bool = False
    waiting: list[tuple[Reply, str]] = msgspec.field(default_factory=list)

    @property
    def is_over(self) -> bool:
        return self.state >= _SUCCEEDED


class GoalServer:
    """Serves the action: requests in zenoh's threads, `step` in the publisher's, with a lock."""

    def __init__(self, node: Ros2Node, requests: Requests) -> None:
        self._requests, self._types = requests, load_service_types()
        self._lock = threading.RLock()
        self._goals: dict[bytes, NavigationGoal] = {}
        self._now_s = self._next_feedback_s = 0.0
        self._feedback = node.create_publisher(FEEDBACK, self._types)
        self._status = node.create_publisher(STATUS)
        server = ServiceServer(node, requests.refuse)
        server.serve(
            self._types, f"{NAME}/_action/send_goal", f"{NAVIGATE}_SendGoal", self._on_send_goal
        )
        server.serve(
            self._types,
            f"{NAME}/_action/cancel_goal",
            "action_msgs/srv/CancelGoal",
            self._on_cancel,
        )
        for result in NAVIGATE_RESULTS:
            server.serve(
                load_service_types(result),
                f"{NAME}/_action/get_result",
                f"{NAVIGATE}_GetResult",
                functools.partial(self._on_result, result),
            )

    def step(self, record: TickRecord) -> None:
        """Update the goals by a tick of the robot."""
        with self._lock:
            self._now_s = record.batch.t_s
            for goal in [goal for goal in self._goals.values() if not goal.is_over]:
                self._follow_goal(goal, record)

    def _follow_goal(self, goal: NavigationGoal, record: TickRecord) -> None:
        status = record.status
        if goal.since_s is None:
            goal.since_s = self._now_s
        if status.task != goal.id.hex():
            if goal.taken_up:
                self._end_goal(goal, _ABORTED, "another goal took its place")
            elif self._now_s - goal.since_s > TAKEN_UP_S:
                self._end_goal(goal, _ABORTED, "the robot did not take it up")
            return
        goal.taken_up = True
        if status.state in _OVER:
            self._end_goal(goal, _OVER[status.state], status.reason)
            return
        if goal.state == _ACCEPTED:
            goal.state = _EXECUTING
            self._publish_status()
        if status.length_m and self._now_s >= self._next_feedback_s:  # the way is planned
            self._next_feedback_s = self._now_s + FEEDBACK_PERIOD_S
            self._send_feedback(goal, record)

    def _send_feedback(self, goal: NavigationGoal, record: TickRecord) -> None:
        make, status = self._types.types, record.status
        feedback = make[f"{NAVIGATE}_Feedback"](
            make_pose_stamped(record.estimate),
            self._make_duration(self._now_s - (goal.since_s or 0.0)),
            self._make_duration(status.eta_s or 0.0),
            0,
            status.distance_left_m,
            goal.poses - status.waypoints_reached,
        )
        message = make[FEEDBACK.ros_type](self._make_uuid(goal.id), feedback)
        self._feedback(bytes(self._types.serialize_cdr(message, FEEDBACK.ros_type)))

    def _end_goal(self, goal: NavigationGoal, state: int, reason: str) -> None:
        goal.state, goal.reason = state, reason
        for reply, result in goal.waiting:
            self._send_result(goal, reply, result)
        goal.waiting = []
        self._publish_status()

    def _on_send_goal(self, request: Any, reply: Reply) -> None:
        problem = self._find_problem(request.goal.poses)
        goal = NavigationGoal(id=request.goal_id.uuid.tobytes(), poses=len(request.goal.poses))
        if not problem:
            places = [pose.pose.position for pose in request.goal.poses]
            numbers = tuple(float(n) for place in places for n in (place.x, place.y))
            accepted, problem = self._requests.request_visit(numbers, goal.id.hex(), "ROS 2")
        else:
            accepted = False
            self._requests.refuse(f"ROS 2: goal refused: {problem}")
        with self._lock:
            if accepted:
                while len(self._goals) >= _KEPT_GOALS:
                    self._goals.pop(next(iter(self._goals)))
                self._goals[goal.id] = goal
                self._publish_status()
            reply(accepted, self._make_time())

    def _find_problem(self, poses: Any) -> str:
        if not poses:
            return "it has no poses"
        frames = {pose.header.frame_id for pose in poses} - {"", MAP_FRAME}
        if frames:
            return f"its poses are in {', '.join(sorted(frames))}, not in {MAP_FRAME}"
        places = [pose.pose.position for pose in poses]
        if not all(math.isfinite(place.x) and math.isfinite(place.y) for place in places):
            return "a position is not finite"
        return ""

    def _on_cancel(self, request: Any, reply: Reply) -> None:
        """Cancel the goal of the id, or with an id of zeros all; this is always allowed."""
        wanted = request.goal_info.goal_id.uuid.tobytes()
        with self._lock:
            named = [g for g in self._goals.values() if wanted in {bytes(16), g.id}]
            running = [goal for goal in named if not goal.is_over]
            if running:
                self._requests.request_action("cancel", "ROS 2")
                for goal in running:
                    goal.state = _CANCELING
                self._publish_status()
            code = _ERROR_NONE
            if not running and wanted != bytes(16):
                code = _ERROR_TERMINATED if named else _ERROR_UNKNOWN_GOAL
            reply(code, [self._make_info(goal) for goal in running])

    def _on_result(self, result: str, request: Any, reply: Reply) -> None:
        with self._lock:
            goal = self._goals.get(request.goal_id.uuid.tobytes())
            if goal is not None and not goal.is_over:
                goal.waiting.append((reply, result))
            else:
                self._send_result(goal, reply, result)

    def _send_result(self, goal: NavigationGoal | None, reply: Reply, result: str) -> None:
        state = goal.state if goal else _UNKNOWN
        fields: list[Any] = [0 if state == _SUCCEEDED else state]
        if "error_msg" in result:
            fields.append(goal.reason if goal else "no such goal")
        reply(state, load_service_types(result).types[f"{NAVIGATE}_Result"](*fields))

    def _publish_status(self) -> None:
        make = self._types.types
        statuses = [
            make["action_msgs/msg/GoalStatus"](self._make_info(goal), goal.state)
            for goal in self._goals.values()
        ]
        message = make[STATUS.ros_type](statuses)
        self._status(bytes(self._types.serialize_cdr(message, STATUS.ros_type)))

    def _make_info(self, goal: NavigationGoal) -> Any:
        return self._types.types["action_msgs/msg/GoalInfo"](
            self._make_uuid(goal.id), self._make_time()
        )

    def _make_uuid(self, goal_id: bytes) -> Any:
        make = self._types.types["unique_identifier_msgs/msg/UUID"]
        return make(np.frombuffer(goal_id, dtype=np.uint8))

    def _make_time(self) -> Any:
        sec, part = divmod(self._now_s, 1.0)
        return self._types.types["builtin_interfaces/msg/Time"](int(sec), int(part * 1e9))

    def _make_duration(self, seconds: float) -> Any:
        sec, part = divmod(max(seconds, 0.0), 1.0)
        return self._types.types["builtin_interfaces/msg/Duration"](int(sec), int(part * 1e9))
