"""Reports once how well the times of a device are known, and when they are known too badly."""

from __future__ import annotations

import math
from collections.abc import Callable

from agribot.core.messages import OperatorEvent, make_sensor_note
from agribot.core.stamp_clock import WINDOW_S

UNSURE_S = 0.02  # capture times that are off by more are reported
PERIOD_S = 1.0  # time between two looks


class ClockWatch:
    """Notes once how far the times of a device may be off, then when that becomes too far or not.

    `name` is the device's. `uncertainty_s` is asked once a second; infinite where it is unknown.
    """

    def __init__(self, name: str, uncertainty_s: Callable[[], float]) -> None:
        self._name, self._uncertainty_s = name, uncertainty_s
        self._next_s = -math.inf
        self._known_s = math.inf  # when it was first known
        self._is_reported = self._is_unsure = False

    def update(self, t_s: float) -> tuple[OperatorEvent, ...]:
        """Note what has changed at a time."""
        if t_s < self._next_s:
            return ()
        self._next_s = t_s + PERIOD_S
        unsure_s = self._uncertainty_s()
        if not math.isfinite(unsure_s):
            return ()
        self._known_s = min(self._known_s, t_s)
        if t_s - self._known_s < WINDOW_S:  # the first few messages say little
            return ()
        is_unsure = unsure_s > UNSURE_S
        if self._is_reported and is_unsure == self._is_unsure:
            return ()
        self._is_reported, self._is_unsure = True, is_unsure
        text = f"times of the {self._name} are known to {1e3 * unsure_s:.1f} ms"
        limit = f" > {1e3 * UNSURE_S:g} ms" if is_unsure else ""
        return (make_sensor_note(t_s, text + limit, is_fault=is_unsure),)
