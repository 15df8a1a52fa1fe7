"""What of the commands is in force by now, and how far the robot has come meanwhile."""

from __future__ import annotations

from collections import deque

from agribot.core.arithmetic import clamp
from agribot.core.messages import Estimate

SAME_TIME_S = 1e-9
MAX_STEP_S = 0.1  # longest tick that is credited as work


class SectionHistory:
    """Remembers which sections were switched on since when."""

    def __init__(self, count: int) -> None:
        self._off = (False,) * count
        self._commands: deque[tuple[float, tuple[bool, ...]]] = deque()

    def add(self, t_s: float, sections_on: tuple[bool, ...]) -> None:
        self._commands.append((t_s, sections_on))

    def at(self, t_s: float) -> tuple[bool, ...]:
        """Return the command in force at `t_s` and drop older ones."""
        commands = self._commands
        while len(commands) > 1 and commands[1][0] <= t_s + SAME_TIME_S:
            commands.popleft()
        if commands and commands[0][0] <= t_s + SAME_TIME_S:
            return commands[0][1]
        return self._off


class StepMeter:
    """Measures the way from tick to tick."""

    def __init__(self) -> None:
        self._last_t_s: float | None = None

    def advance(self, estimate: Estimate) -> float:
        """Way since the last call, m."""
        last_s, self._last_t_s = self._last_t_s, estimate.t_s
        step_s = 0.0 if last_s is None else estimate.t_s - last_s
        return abs(estimate.v_mps) * clamp(step_s, 0.0, MAX_STEP_S)
