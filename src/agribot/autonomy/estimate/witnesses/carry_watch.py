"""Whether a person carries the robot, or pushes it aside, without a turn of its wheels.

The velocity of the receiver shows it at once, before the fixes have left the pose far enough to be
rejected, and also where they are vague. What wheels that slip can do is no sign of it.
"""

from __future__ import annotations

from collections import deque

from agribot.autonomy.estimate.witnesses.lost_way import (
    MAX_STD_MPS,
    find_beyond_speed,
    find_beyond_wheels,
)
from agribot.core.facts import RobotCarried

# A clod that gives way throws the robot aside by some centimetres.
CARRIED_M, MEMORY_S = 0.12, 2.0


class _Way:
    """The way of the last moments that wheels cannot have made, ahead and aside."""

    def __init__(self) -> None:
        self._steps: deque[tuple[float, float, float]] = deque()
        self._carried_m = (0.0, 0.0)

    def add(self, t_s: float, step_s: float, beyond_mps: tuple[float, float]) -> None:
        self._steps.append((t_s, beyond_mps[0] * step_s, beyond_mps[1] * step_s))
        while t_s - self._steps[0][0] > MEMORY_S:
            self._steps.popleft()
        ahead_m = sum(step[1] for step in self._steps)
        aside_m = sum(step[2] for step in self._steps)
        if max(abs(ahead_m), abs(aside_m)) > CARRIED_M:
            self._carried_m = (ahead_m, aside_m)

    @property
    def fault(self) -> RobotCarried | None:
        ahead_m, aside_m = self._carried_m
        if not (ahead_m or aside_m):
            return None
        if abs(aside_m) > abs(ahead_m):
            return RobotCarried(abs(aside_m), "left" if aside_m > 0.0 else "right")
        return RobotCarried(abs(ahead_m), "ahead" if ahead_m > 0.0 else "behind")


class CarryWatch:
    """Call `add` with every velocity; `find` says how far it went, until a person has looked."""

    def __init__(self) -> None:
        self._by_heading, self._by_speed = _Way(), _Way()

    def add(
        self,
        t_s: float,
        step_s: float,
        shown_mps: tuple[float, float],
        driven: tuple[float, float],
        std_mps: float,
    ) -> None:
        """Take how the robot's middle moved ahead and aside in the last step, with its 1 sigma.

        `driven` is what wheels and gyro say of it: m/s and rad/s.
        """
        if std_mps > MAX_STD_MPS:  # too noisy to show a push
            return
        self._by_heading.add(t_s, step_s, find_beyond_wheels(shown_mps, driven, std_mps))
        self._by_speed.add(t_s, step_s, find_beyond_speed(shown_mps, driven, std_mps))

    def forget(self) -> None:
        """Take the robot to stand where it is: a person has decided."""
        self._by_heading, self._by_speed = _Way(), _Way()

    def find(self, *, is_heading_sure: bool = True) -> RobotCarried | None:
        """Find a robot that was carried.

        A robot that believes to face elsewhere than it does seems to slide aside: where its heading
        may be wrong, only what is faster than its wheels counts, in any direction.
        """
        return self._by_heading.fault if is_heading_sure else self._by_speed.fault
