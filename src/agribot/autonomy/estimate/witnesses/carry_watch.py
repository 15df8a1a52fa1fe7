"""Whether a person carries the robot, or pushes it aside, without a turn of its wheels.

The velocity of the receiver shows it at once, before the fixes have left the pose far enough to be
rejected, and also where they are vague. What wheels that slip can do is no sign of it.
"""

from __future__ import annotations

from collections import deque

from agribot.autonomy.estimate.witnesses.lost_way import MAX_STD_MPS, find_beyond_wheels
from agribot.core.facts import RobotCarried

# A clod that gives way throws the robot aside by some centimetres.
CARRIED_M, MEMORY_S = 0.12, 2.0


class CarryWatch:
    """Call `add` with every velocity; `fault` says how far it went, until a person has looked."""

    def __init__(self) -> None:
        self._moved: deque[tuple[float, float, float]] = deque()
        self._carried_m = (0.0, 0.0)

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
        ahead_mps, aside_mps = find_beyond_wheels(shown_mps, driven, std_mps)
        self._moved.append((t_s, ahead_mps * step_s, aside_mps * step_s))
        while t_s - self._moved[0][0] > MEMORY_S:
            self._moved.popleft()
        ahead_m = sum(step[1] for step in self._moved)
        aside_m = sum(step[2] for step in self._moved)
        if max(abs(ahead_m), abs(aside_m)) > CARRIED_M:
            self._carried_m = (ahead_m, aside_m)

    def forget(self) -> None:
        """Take the robot to stand where it is: a person has decided."""
        self._moved.clear()
        self._carried_m = (0.0, 0.0)

    @property
    def fault(self) -> RobotCarried | None:
        ahead_m, aside_m = self._carried_m
        if not (ahead_m or aside_m):
            return None
        if abs(aside_m) > abs(ahead_m):
            return RobotCarried(abs(aside_m), "left" if aside_m > 0.0 else "right")
        return RobotCarried(abs(ahead_m), "ahead" if ahead_m > 0.0 else "behind")
