"""Messages on the inbound topics, the same for every network: checked, and handed to the robot."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from typing import Any

from agribot.core import inbound_topics as inbound
from agribot.core.errors import BridgeError
from agribot.core.messages import AnyRequest, ControlMission, PointOut
from agribot.core.request_text import describe_request
from agribot.core.topics import Topic
from agribot.ros.decoding import make_undecodable
from agribot.ros.frames import PeerFrames
from agribot.ros.goals import GoalBook, PeerGoal, find_places
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.pose_request import read_stated_pose, request_pose
from agribot.ros.requests import PAUSE_SERVICE, SERVICES, Requests

# Time between messages on one topic, and between equal commands; faster ones are dropped.
_MIN_INTERVAL_S = 0.05
_MOST_TEXT = 200  # characters of a command
_COMMANDS: dict[str, AnyRequest] = {
    **{name.rpartition("/")[2]: request for name, request in SERVICES},
    PAUSE_SERVICE.rpartition("/")[2]: ControlMission(action="pause"),
}


class InboundTopics:
    """Takes the messages of peers, in CDR, from any thread.

    Goals go into `goals` and `visits`, whose servers report what becomes of them.
    """

    def __init__(
        self,
        requests: Requests,
        goals: GoalBook,
        visits: GoalBook,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._requests, self._now_s = requests, now_s
        self._goals, self._visits = goals, visits
        self._frames = requests.frames or PeerFrames()
        self._numbers = itertools.count(1)
        self._next_s: dict[str, float] = {}
        self._readers: dict[str, Callable[[Any, str], None]] = {
            inbound.GOAL_POSE.name: self._take_goal,
            inbound.INITIAL_POSE.name: self._take_pose,
            inbound.CLICKED_POINT.name: self._take_point,
            inbound.VISIT.name: self._take_visit,
            inbound.COMMAND.name: self._take_command,
        }

    def take(self, topic: Topic, data: bytes, source: str) -> None:
        """Take one message; what is refused is reported with its reason."""
        try:
            message = _decode(topic, data)
            if self._is_too_fast(topic.name, message):
                raise BridgeError(f"faster than {1.0 / _MIN_INTERVAL_S:.0f} Hz; some are dropped")
            self._readers[topic.name](message, source)
        except BridgeError as error:
            self._requests.refuse(f"{source}: {topic.name}: {error}")

    def _is_too_fast(self, name: str, message: Any) -> bool:
        """Whether the message follows the one before too soon; of commands, the same one."""
        if name == inbound.COMMAND.name and message.data in _COMMANDS:
            if message.data == "stop":
                return False
            name = f"{name} {message.data}"
        now_s, next_s = self._now_s(), self._next_s.get(name, -math.inf)
        if 0.0 < next_s - now_s <= _MIN_INTERVAL_S:
            return True
        self._next_s[name] = now_s + _MIN_INTERVAL_S
        return False

    def _take_goal(self, message: Any, source: str) -> None:
        goal = self._make_goal(source, is_visit=False)
        try:
            goal.places = (self._frames.find_pose(message.header.frame_id, message.pose),)
        except BridgeError as error:
            self._goals.reject(goal, str(error))
        else:
            self._goals.begin(goal)

    def _take_visit(self, message: Any, source: str) -> None:
        goal = self._make_goal(source, is_visit=True)
        try:
            goal.places = find_places(
                self._frames, [(message.header.frame_id, pose.position) for pose in message.poses]
            )
        except BridgeError as error:
            self._visits.reject(goal, str(error))
        else:
            self._visits.begin(goal)

    def _make_goal(self, source: str, *, is_visit: bool) -> PeerGoal:
        name = f"{source.replace(' ', '-')}-{next(self._numbers)}"
        return PeerGoal(name=name, places=(), is_visit=is_visit, source=source)

    def _take_pose(self, message: Any, source: str) -> None:
        pose, stds = read_stated_pose(message, self._frames)
        request_pose(self._requests, pose, stds, source)

    def _take_point(self, message: Any, source: str) -> None:
        point = message.point
        x_m, y_m = self._frames.find_place(message.header.frame_id, point.x, point.y)
        note = describe_request(PointOut(x_map_m=x_m, y_map_m=y_m))
        self._requests.request_note(note, source)

    def _take_command(self, message: Any, source: str) -> None:
        word = message.data.strip()[:_MOST_TEXT]
        if word not in _COMMANDS:
            raise BridgeError(f"'{word}' is unknown; send one of {', '.join(sorted(_COMMANDS))}")
        self._requests.post(_COMMANDS[word], source)


def _decode(topic: Topic, data: bytes) -> Any:
    try:
        return load_types().deserialize_cdr(data, topic.ros_type)
    except Exception as error:  # the generated code of rosbags raises any error
        raise make_undecodable(data, topic.ros_type) from error
