"""Joints of a robot moved by steps: a JointTrajectory to the controller that moves them.

A step starts where the joint is by `/joint_states`, and ends within its limits.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from agribot.core.errors import BridgeError
from agribot.core.topics import Topic
from agribot.ros.joint_step import JointStep
from agribot.ros.messages import rosmsg
from agribot.ros.topic_source import UntypedConnection

STATES = "/joint_states"
STATES_TYPE = "sensor_msgs/msg/JointState"
TRAJECTORY_TYPE = "trajectory_msgs/msg/JointTrajectory"
SLOW = 0.5  # rad/s or m/s, where the description allows more
SHORTEST_S = 0.2  # shortest step
LASTS_S = 1.0  # time after its end for which a commanded step counts as the joint's place


class Limits(Protocol):
    """Limits of a joint by its description."""

    @property
    def unit(self) -> str: ...
    @property
    def lower(self) -> float: ...
    @property
    def upper(self) -> float: ...
    @property
    def velocity(self) -> float: ...


class JogConnection(UntypedConnection, Protocol):
    """A network on which one can publish, too."""

    def advertise(self, topic: Topic) -> None: ...

    def publish(self, topic: Topic, data: bytes) -> None: ...

    def close(self) -> None: ...


class _Goal(NamedTuple):
    position: float
    until_s: float


class JointJogger:
    """Publishes steps on `CONTROLLER/{command}`, and reports in words what became of each.

    `now_s` is a monotonic clock.
    """

    def __init__(
        self,
        connection: JogConnection,
        command: str,
        steps: Sequence[JointStep],
        limits: Mapping[str, Limits],
        report: Callable[[str], None],
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Announce the topics of all controllers. Raises: BridgeError: the network is lost."""
        self._connection, self._limits = connection, limits
        self._report, self._now_s = report, now_s
        self._lock = threading.Lock()
        self._positions: dict[str, float] = {}
        self._goals: dict[str, _Goal] = {}
        names = dict.fromkeys(step.controller for step in steps)
        self._topics = {
            name: Topic(name=f"/{name}/{command}", ros_type=TRAJECTORY_TYPE) for name in names
        }
        for topic in self._topics.values():
            connection.advertise(topic)
        connection.subscribe_any(STATES, self._on_states)

    def jog(self, step: JointStep) -> None:
        """Move by one step. Raises: BridgeError: the network is lost."""
        with self._lock:
            places = [self._find_place(name) for name in step.joints]
        unknown = [n for n, place in zip(step.joints, places, strict=True) if place is None]
        if unknown:
            self._report(
                f"{step.name}: nothing on {STATES} says where {', '.join(unknown)} is; start the "
                "robot's joint state publisher, then press again"
            )
            return
        known = [place for place in places if place is not None]
        goals = [
            min(max(place + by, self._limits[name].lower), self._limits[name].upper)
            for name, place, by in zip(step.joints, known, step.increment_by, strict=True)
        ]
        if goals == known:
            self._report(f"{step.name}: {self._describe(step.joints, known, goals)}: at its limit")
            return
        lasts_s = max(SHORTEST_S, *map(self._estimate_s, step.joints, known, goals))
        message = make_trajectory(step.joints, goals, lasts_s)
        self._connection.publish(self._topics[step.controller], rosmsg.to_cdr(message))
        until_s = self._now_s() + lasts_s + LASTS_S
        self._goals |= {n: _Goal(p, until_s) for n, p in zip(step.joints, goals, strict=True)}
        self._report(f"{step.name}: {self._describe(step.joints, known, goals)}")

    def close(self) -> None:
        self._connection.close()

    def _find_place(self, name: str) -> float | None:
        """Return where a joint is or is going to; None where nothing reports it."""
        goal = self._goals.get(name)
        if name in self._positions and goal is not None and self._now_s() < goal.until_s:
            return goal.position
        return self._positions.get(name)

    def _estimate_s(self, name: str, place: float, goal: float) -> float:
        return abs(goal - place) / min(SLOW, self._limits[name].velocity)

    def _describe(
        self, names: Sequence[str], places: Sequence[float], goals: Sequence[float]
    ) -> str:
        return ", ".join(
            f"{name} {place:.3f} -> {goal:.3f} {self._limits[name].unit}"
            for name, place, goal in zip(names, places, goals, strict=True)
        )

    def _on_states(self, ros_type: str, data: bytes) -> None:
        if ros_type != STATES_TYPE:
            return
        try:
            message = self._connection.decode(ros_type, data)
        except BridgeError:  # a message of another definition
            return
        found = {
            str(name): float(position)
            for name, position in zip(message.name, message.position, strict=False)
            if np.isfinite(position)
        }
        with self._lock:
            self._positions |= found


def make_trajectory(names: Sequence[str], positions: Sequence[float], lasts_s: float) -> object:
    """Make a trajectory of one point that begins at once."""
    none = np.zeros(0)
    sec, nanosec = divmod(rosmsg.to_nanoseconds(lasts_s), 1_000_000_000)
    duration = rosmsg.make_message("builtin_interfaces/msg/Duration", sec, nanosec)
    point = rosmsg.make_message(
        "trajectory_msgs/msg/JointTrajectoryPoint",
        np.array(positions, dtype=float), none, none, none, duration,
    )  # fmt: skip
    header = rosmsg.make_header(0.0, "")
    return rosmsg.make_message(TRAJECTORY_TYPE, header, list(names), [point])
