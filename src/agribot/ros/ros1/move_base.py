"""The robot as a server of move_base's action, so that a client of actionlib can send it to places.

Goals of the inbound topics are listed here, too: what becomes of them is in status and result.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from typing import Any

from agribot.core.errors import BridgeError
from agribot.core.messages import Estimate, TickRecord
from agribot.ros.decoding import make_undecodable
from agribot.ros.frames import PeerFrames
from agribot.ros.goals import GoalBook, GoalState, PeerGoal
from agribot.ros.messages.rosmsg import MAP_FRAME, quaternion_from_yaw
from agribot.ros.requests import Requests
from agribot.ros.ros1.action_types import (
    ACTION_FEEDBACK,
    ACTION_GOAL,
    ACTION_RESULT,
    GOAL_ID,
    GOAL_STATUS,
    STATUS_ARRAY,
    load_action_types,
)
from agribot.ros.ros1.node import Node, Publication
from agribot.ros.ros1.subscription import Subscription
from agribot.ros.ros1.types import to_ros1_name

NAME = "/move_base"
_STATUS_PERIOD_S = 0.2  # period by wall clock: clients take a server that is silent for lost
_FEEDBACK_PERIOD_S = 0.2
_SHOWN_S = 5.0  # time for which a goal that is over stays in the status; the newest one stays
_DEPTH = 50
_MOST_ID = 200  # characters of a goal's id
# actionlib_msgs/GoalStatus
_STATUS: dict[GoalState, int] = {
    "pending": 0, "active": 1, "canceled": 2, "replaced": 2, "succeeded": 3, "aborted": 4,
    "rejected": 5, "canceling": 6,
}  # fmt: skip


class MoveBaseServer:
    """Serves the action; its messages come in threads of the network, `step` in the publisher's.

    Raises: BridgeError: the master refuses a topic.
    """

    def __init__(
        self, node: Node, requests: Requests, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._requests, self._types, self._now_s = requests, load_action_types(), now_s
        self._frames = requests.frames or PeerFrames()
        self._numbers, self._sequence = itertools.count(1), itertools.count(1)
        self._next_status_s = self._next_feedback_s = 0.0
        self._stamps: dict[str, tuple[int, int]] = {}
        self.goals = GoalBook(requests, self._on_change)
        self._status = self._advertise(node, "status", STATUS_ARRAY, latched=True)
        self._feedback = self._advertise(node, "feedback", ACTION_FEEDBACK)
        self._result = self._advertise(node, "result", ACTION_RESULT)
        self._subscriptions = [
            Subscription(node, f"{NAME}/{part}", ros_type, on_bytes, requests.refuse)
            for part, ros_type, on_bytes in (
                ("goal", ACTION_GOAL, self._on_goal),
                ("cancel", GOAL_ID, self._on_cancel),
            )
        ]

    def step(self, record: TickRecord) -> None:
        """Follow the goals by a tick of the robot, and publish what is due."""
        under_way = self.goals.step(record)
        now_s = self._now_s()
        if under_way and now_s >= self._next_feedback_s:
            self._next_feedback_s = now_s + _FEEDBACK_PERIOD_S
            for goal in under_way:
                self._send_feedback(goal, record.estimate)
        if now_s >= self._next_status_s:
            self._publish_status()

    def close(self) -> None:
        for subscription in self._subscriptions:
            subscription.close()

    def _advertise(
        self, node: Node, part: str, ros_type: str, *, latched: bool = False
    ) -> Publication:
        return node.advertise(f"{NAME}/{part}", ros_type, latched=latched, depth=_DEPTH)

    def _on_goal(self, data: bytes, source: str, _ros_type: str) -> None:
        try:
            message = self._decode(data, ACTION_GOAL)
        except BridgeError as error:
            self._requests.refuse(f"{source}: {NAME}/goal: {error}")
            return
        name = message.goal_id.id or f"{NAME}-{next(self._numbers)}"
        if len(name) > _MOST_ID:
            self._requests.refuse(f"{source}: a goal's id has {len(name)} letters, over {_MOST_ID}")
            return
        goal = PeerGoal(name=name, places=(), is_visit=False, source=source)
        target, stamp = message.goal.target_pose, message.goal_id.stamp
        with self.goals.lock:
            known = self.goals.goals.get(name)
            if known is not None and self._is_shown(known):
                return  # the same message again
            self._stamps[name] = (stamp.sec, stamp.nanosec)
            try:
                goal.places = (self._frames.find_pose(target.header.frame_id, target.pose),)
            except BridgeError as error:
                self.goals.reject(goal, str(error))
            else:
                self.goals.begin(goal)

    def _on_cancel(self, data: bytes, source: str, _ros_type: str) -> None:
        """Cancel the goal of the id, those begun until a stamp, or with neither all."""
        try:
            wish = self._decode(data, GOAL_ID)
        except BridgeError as error:
            self._requests.refuse(f"{source}: {NAME}/cancel: {error}")
            return
        until = (wish.stamp.sec, wish.stamp.nanosec)
        with self.goals.lock:
            for goal in list(self.goals.goals.values()):
                stamp = self._stamps.get(goal.name, (0, 0))
                is_meant = not wish.id and until == (0, 0)
                if is_meant or goal.name == wish.id or ((0, 0) != until >= stamp):
                    self.goals.cancel(goal, source)

    def _on_change(self, goal: PeerGoal) -> None:
        if goal.is_over:
            result = self._types.types["move_base_msgs/msg/MoveBaseResult"](0)
            data = self._pack(ACTION_RESULT, self._make_status(goal), result)
            self._result.put(data)
        self._publish_status()

    def _publish_status(self) -> None:
        with self.goals.lock:
            self._next_status_s = self._now_s() + _STATUS_PERIOD_S
            goals = list(self.goals.goals.values())
            shown = [goal for goal in goals[:-1] if self._is_shown(goal)] + goals[-1:]
            self._stamps = {name: s for name, s in self._stamps.items() if name in self.goals.goals}
            self._status.put(self._pack(STATUS_ARRAY, [self._make_status(goal) for goal in shown]))

    def _is_shown(self, goal: PeerGoal) -> bool:
        return goal.over_s is None or self.goals.now_s - goal.over_s <= _SHOWN_S

    def _send_feedback(self, goal: PeerGoal, estimate: Estimate) -> None:
        make = self._types.types
        x, y, z, w = quaternion_from_yaw(estimate.yaw_map_rad)
        pose = make["geometry_msgs/msg/Pose"](
            make["geometry_msgs/msg/Point"](estimate.x_map_m, estimate.y_map_m, 0.0),
            make["geometry_msgs/msg/Quaternion"](x, y, z, w),
        )
        stamped = make["geometry_msgs/msg/PoseStamped"](self._make_header(MAP_FRAME), pose)
        feedback = make["move_base_msgs/msg/MoveBaseFeedback"](stamped)
        self._feedback.put(self._pack(ACTION_FEEDBACK, self._make_status(goal), feedback))

    def _make_status(self, goal: PeerGoal) -> Any:
        goal_id = self._types.types[GOAL_ID](
            self._make_time(*self._stamps.get(goal.name, (0, 0))), goal.name
        )
        return self._types.types[GOAL_STATUS](goal_id, _STATUS[goal.state], goal.reason)

    def _make_header(self, frame: str) -> Any:
        sec, part = divmod(self.goals.now_s, 1.0)
        stamp = self._make_time(int(sec), int(part * 1e9))
        return self._types.types["std_msgs/msg/Header"](next(self._sequence), stamp, frame)

    def _make_time(self, sec: int, nanosec: int) -> Any:
        return self._types.types["builtin_interfaces/msg/Time"](sec, nanosec)

    def _pack(self, ros_type: str, *fields: Any) -> bytes:
        message = self._types.types[ros_type](self._make_header(""), *fields)
        return bytes(self._types.serialize_ros1(message, ros_type))

    def _decode(self, data: bytes, ros_type: str) -> Any:
        try:
            return self._types.deserialize_ros1(data, ros_type)
        except Exception as error:  # the generated code of rosbags raises any error
            raise make_undecodable(data, to_ros1_name(ros_type)) from error
