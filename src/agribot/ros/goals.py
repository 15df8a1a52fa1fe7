"""Goals of peers, the same for every protocol: begun, followed from tick to tick, ended.

One place is an errand: the mission pauses and `resume` goes on with it. Several places are a visit
that takes the place of the mission, and so is one place where the mission drives its own path only.
A new goal takes the place of the one before.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from typing import Any, Literal

import msgspec

from agribot.autonomy.plan.mission.errand import STANDING_MPS
from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.core.errors import BridgeError
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, AskedElse, OwnPathOnly
from agribot.core.geo import wrap_rad
from agribot.core.messages import (
    AnyRequest,
    ControlMission,
    Estimate,
    GoTo,
    MissionState,
    TickRecord,
    Visit,
)
from agribot.ros.frames import PeerFrames
from agribot.ros.requests import Requests

TAKEN_UP_S = 5.0  # time within which the robot's status must show a new visit
KEPT_GOALS = 100
_ARRIVED_M = 0.3  # distance from the place, where the robot stands at the end of its way
_THERE_M, _THERE_RAD = 0.1, 0.2  # nearer than this it need not drive
_SAME_PLACE_M = 0.05
_MOST_PLACES = 1000  # places of a visit

Place = tuple[float, float, float | None]  # x, y (m, map), yaw (rad) where it matters
GoalState = Literal[
    "pending", "active", "canceling", "succeeded", "canceled", "aborted", "replaced", "rejected"
]
_UNDER_WAY = ("pending", "active", "canceling")
_ENDS: dict[MissionState, GoalState] = {
    "done": "succeeded", "cancelled": "canceled", "failed": "aborted",
}  # fmt: skip


class PeerGoal(msgspec.Struct, kw_only=True, eq=False):
    """A goal of a peer; `name` is what the mission calls its visit."""

    name: str
    places: tuple[Place, ...]
    is_visit: bool
    source: str
    state: GoalState = "pending"
    reason: str = ""
    since_s: float | None = None
    over_s: float | None = None
    taken_up: bool = False
    is_settling: bool = False  # the robot is at the place, and comes to rest there
    answer: tuple[AnyFact | None, float] | None = None  # why it is refused, and when, s

    @property
    def is_over(self) -> bool:
        return self.state not in _UNDER_WAY


class GoalBook:
    """The goals of one server; `on_change` is called with each new state, under the lock."""

    def __init__(self, requests: Requests, on_change: Callable[[PeerGoal], None]) -> None:
        self._requests, self._on_change = requests, on_change
        self.lock = threading.RLock()
        self.goals: dict[str, PeerGoal] = {}
        self.now_s = 0.0

    def begin(self, goal: PeerGoal) -> bool:
        """Send the robot there; return False for a goal that is rejected, with its reason."""
        with self.lock:
            for other in self.goals.values():
                if other.is_settling and not other.is_over:
                    self._turn(other, "replaced", "another goal took its place")
            self._keep(goal)
            record = self._requests.link.record if self._requests.link else None
            if record is None or goal.is_visit or not _is_near(goal.places[0], record.estimate):
                return self._send(goal)
            goal.is_settling = True
            self._follow_settling(goal, record)
            if not goal.is_over:
                self._turn(goal, "pending", "")
            return True

    def _send(self, goal: PeerGoal) -> bool:
        goal.answer = None
        accepted, why = self._requests.post(
            _make_request(goal),
            goal.source,
            lambda refusal, record: _note_answer(goal, refusal, record),
        )
        self._turn(goal, *(("pending", "") if accepted else ("rejected", why)))
        return accepted

    def reject(self, goal: PeerGoal, why: str) -> None:
        """Keep an invalid goal, so that its sender can read why."""
        with self.lock:
            self._requests.refuse(f"{goal.source}: goal refused: {why}")
            self._keep(goal)
            self._turn(goal, "rejected", why)

    def cancel(self, goal: PeerGoal, source: str) -> None:
        """Let the robot stand: a visit ends, and of an errand `resume` drives what is left."""
        with self.lock:
            if goal.is_settling and not goal.is_over:
                self._turn(goal, "canceled", f"canceled by {source}")
            elif not goal.is_over:
                end = ControlMission(action="cancel" if goal.is_visit else "pause")
                self._requests.post(end, source)
                self._turn(goal, "canceling", f"canceled by {source}")

    def step(self, record: TickRecord) -> list[PeerGoal]:
        """Follow the goals by a tick of the robot; return those under way."""
        with self.lock:
            self.now_s = record.batch.t_s
            for goal in [goal for goal in self.goals.values() if not goal.is_over]:
                if goal.since_s is None:
                    goal.since_s = self.now_s
                self._follow(goal, record)
            return [goal for goal in self.goals.values() if not goal.is_over and goal.taken_up]

    def _follow(self, goal: PeerGoal, record: TickRecord) -> None:
        if goal.is_settling:
            self._follow_settling(goal, record)
        elif goal.is_visit:
            self._follow_visit(goal, record)
        else:
            self._follow_errand(goal, record)

    def _follow_settling(self, goal: PeerGoal, record: TickRecord) -> None:
        if not _is_near(goal.places[0], record.estimate):
            goal.is_settling = False
            self._send(goal)
        elif abs(record.estimate.v_mps) <= STANDING_MPS:
            self._turn(goal, "succeeded", "the robot is there already")

    def _follow_visit(self, goal: PeerGoal, record: TickRecord) -> None:
        status = record.status
        if status.task != goal.name:
            answer = _read_answer(goal, record)
            if goal.taken_up:
                self._turn(goal, "replaced", "another goal took its place")
            elif answer and answer[0]:
                self._turn(goal, "aborted", render(answer[0]))
            elif self.now_s - (goal.since_s or 0.0) > TAKEN_UP_S:
                self._turn(goal, "aborted", "the robot did not take it up")
            return
        goal.taken_up = True
        if status.state in _ENDS:
            self._turn(goal, _ENDS[status.state], status.reason)
        elif goal.state == "pending":
            self._turn(goal, "active", "")

    def _follow_errand(self, goal: PeerGoal, record: TickRecord) -> None:
        answer, status = _read_answer(goal, record), record.status
        if answer is None:  # it stops first, or its way is being planned
            return
        refusal = answer[0]
        if refusal and refusal.holds(OwnPathOnly()) and goal.state == "pending":
            goal.is_visit = True  # such a mission has no errands, but another may take its place
            self._send(goal)
        elif refusal:
            self._turn(goal, _name_refused(goal, refusal), render(refusal))
        elif status.leg == ErrandKind.GOAL.leg and _is_bound_for(goal, status.goal_map_m):
            goal.taken_up = True
            if goal.state == "canceling" and status.state == "paused":
                self._turn(goal, "canceled", status.reason)
            elif goal.state == "pending":
                self._turn(goal, "active", "")
        else:
            self._turn(goal, *_judge_end(goal, record))

    def _keep(self, goal: PeerGoal) -> None:
        while len(self.goals) >= KEPT_GOALS:
            self.goals.pop(next(iter(self.goals)))
        self.goals[goal.name] = goal

    def _turn(self, goal: PeerGoal, state: GoalState, reason: str) -> None:
        goal.state, goal.reason = state, reason
        if state == "aborted":
            self._requests.refuse(f"{goal.source}: goal aborted: {reason}")
        if goal.is_over:
            goal.over_s = self.now_s
        self._on_change(goal)


def find_places(frames: PeerFrames, points: Sequence[tuple[str, Any]]) -> tuple[Place, ...]:
    """Convert the places of a visit, a frame and a geometry_msgs/Point each, to the map.

    Raises: BridgeError: none or too many, not finite, or a frame is unknown.
    """
    if not points:
        raise BridgeError(f"it has no poses; send 1 to {_MOST_PLACES}")
    if len(points) > _MOST_PLACES:
        raise BridgeError(f"it has {len(points)} poses; send at most {_MOST_PLACES}")
    return tuple((*frames.find_place(frame, point.x, point.y), None) for frame, point in points)


def _make_request(goal: PeerGoal) -> AnyRequest:
    if goal.is_visit:
        return Visit(places_map_m=tuple(place[:2] for place in goal.places), title=goal.name)
    x_m, y_m, yaw_rad = goal.places[0]
    return GoTo(x_map_m=x_m, y_map_m=y_m, yaw_map_rad=yaw_rad)


def _note_answer(goal: PeerGoal, refusal: AnyFact | None, record: TickRecord) -> None:
    goal.answer = (refusal, record.batch.t_s)


def _read_answer(goal: PeerGoal, record: TickRecord) -> tuple[AnyFact | None, float] | None:
    """Read what the mission answered until this tick; None before it did."""
    if goal.answer is None or goal.answer[1] > record.batch.t_s:
        return None
    return goal.answer


def _name_refused(goal: PeerGoal, refusal: AnyFact) -> GoalState:
    """Name the state of an errand that did not begin."""
    if goal.state == "canceling":
        return "canceled"
    return "replaced" if refusal.holds(AskedElse()) else "aborted"


def _judge_end(goal: PeerGoal, record: TickRecord) -> tuple[GoalState, str]:
    """Judge an errand that is over, however it ended."""
    status = record.status
    if status.state in {"cancelled", "failed"}:
        return _ENDS[status.state], status.reason
    if _measure_distance_m(goal.places[0], record.estimate) <= _ARRIVED_M:
        return "succeeded", status.reason
    if goal.state == "canceling":
        return "canceled", status.reason
    return "replaced", f"something else was asked of the robot: {status.reason}"


def _is_bound_for(goal: PeerGoal, goal_map_m: tuple[float, float] | None) -> bool:
    return goal_map_m is not None and math.dist(goal.places[0][:2], goal_map_m) < _SAME_PLACE_M


def _is_near(place: Place, estimate: Estimate) -> bool:
    turn_rad = 0.0 if place[2] is None else wrap_rad(place[2] - estimate.yaw_map_rad)
    is_near = _measure_distance_m(place, estimate) < _THERE_M and abs(turn_rad) < _THERE_RAD
    return estimate.ok and is_near


def _measure_distance_m(place: Place, estimate: Estimate) -> float:
    return math.dist(place[:2], (estimate.x_map_m, estimate.y_map_m))
