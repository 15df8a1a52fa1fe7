"""`autonomous-drive-action`: a list of goals, one after another, with feedback."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from agribot.autonomy.plan.ways.waypoint_text import LatLon
from agribot.core import topics
from agribot.core.messages import MissionState, MissionStatus
from agribot.core.topics import Topic
from agribot.ros.messages import rosmsg
from agribot.ros.nodes.stage import OutgoingMessage

_SPEED_WINDOW_S = 10.0
_SETTLE_S = 2.0  # time in which the last goal's distance may still arrive


class ActionSettings(msgspec.Struct, frozen=True, kw_only=True):
    arrive_m: float = 0.7  # not less than where autonomous-drive starts to drive again
    silence_s: float = 10.0  # silence of the distance before the mission fails


class AutonomousDriveAction:
    """Feedback is a MissionStatus as JSON, as in a whole run: state, leg, distance, ETA."""

    inputs = (topics.DISTANCE,)
    outputs = (topics.GOAL_FIX, topics.STATUS)

    def __init__(self, goals: Sequence[LatLon], settings: ActionSettings) -> None:
        self._goals, self._settings = tuple(goals), settings
        self._index = 0
        self._state: MissionState = "running"
        self._published: tuple[MissionState, int] | None = None
        self._next_status_s = -math.inf
        self._distance_m = math.nan
        self._changed_s = self._heard_s = math.nan
        self._history: deque[tuple[float, float]] = deque()
        self.reason = ""

    @property
    def is_done(self) -> bool:
        return self._state in {"done", "failed"}

    @property
    def ok(self) -> bool:
        return self._state == "done"

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        if topic is not topics.DISTANCE or not math.isfinite(message.data) or self.is_done:
            return ()
        self._heard_s = t_s
        if not t_s - self._changed_s > _SETTLE_S:
            return ()
        self._distance_m = float(message.data)
        self._history.append((t_s, self._distance_m))
        while t_s - self._history[0][0] > _SPEED_WINDOW_S:
            self._history.popleft()
        if self._distance_m <= self._settings.arrive_m:
            self._start_next_goal(t_s)
        return self.tick(t_s)

    def tick(self, t_s: float) -> Sequence[OutgoingMessage]:
        if math.isnan(self._changed_s):
            self._changed_s = t_s
        if math.isnan(self._heard_s):
            self.reason = f"no {topics.DISTANCE.name} yet"
        elif self.reason and not self.is_done:
            self.reason = ""
        if not self.is_done and t_s - self._heard_s > self._settings.silence_s:
            self._state = "failed"
            self.reason = f"no {topics.DISTANCE.name} for {self._settings.silence_s:g} s"
        now = (self._state, self._index)
        messages: list[OutgoingMessage] = []
        if now != self._published and not self.is_done:
            messages.append(
                OutgoingMessage(topics.GOAL_FIX, _make_goal_fix(self._goals[self._index]))
            )
        if now != self._published or t_s >= self._next_status_s:
            self._next_status_s = t_s + 1.0
            messages.append(OutgoingMessage(topics.STATUS, rosmsg.make_status(self._make_status())))
        self._published = now
        return messages

    def finish(self) -> Sequence[OutgoingMessage]:
        if not self.is_done:
            self._state, self.reason = "cancelled", "stopped by its operator"
        return (OutgoingMessage(topics.STATUS, rosmsg.make_status(self._make_status())),)

    def _start_next_goal(self, t_s: float) -> None:
        self._changed_s = t_s
        self._distance_m = math.nan
        self._history.clear()
        self._index += 1
        if self._index == len(self._goals):
            self._state, self.reason = "done", "every goal was reached"

    def _make_status(self) -> MissionStatus:
        left_m = 0.0 if math.isnan(self._distance_m) else self._distance_m
        return MissionStatus(
            state=self._state,
            reason=self.reason,
            row=-1,
            rows_total=0,
            rows_done=(),
            s_m=0.0,
            length_m=0.0,
            waypoints_total=len(self._goals),
            waypoints_reached=self._index,
            leg="" if self.is_done else f"to goal {self._index + 1}",
            distance_left_m=left_m,
            eta_s=self._estimate_eta_s(),
        )

    def _estimate_eta_s(self) -> float | None:
        """Estimate the time to the next goal from the rate at which the distance shrinks."""
        if len(self._history) < 2:
            return None
        (t0_s, d0_m), (t1_s, d1_m) = self._history[0], self._history[-1]
        closing_mps = (d0_m - d1_m) / (t1_s - t0_s) if t1_s > t0_s else 0.0
        return d1_m / closing_mps if closing_mps > 0.02 else None


def _make_goal_fix(goal: LatLon) -> Any:
    status = rosmsg.make_message("sensor_msgs/msg/NavSatStatus", 0, 1)
    head = rosmsg.make_header(0.0, "world")
    zeros = np.zeros(9)
    return rosmsg.make_message("sensor_msgs/msg/NavSatFix", head, status, *goal, math.nan, zeros, 0)
