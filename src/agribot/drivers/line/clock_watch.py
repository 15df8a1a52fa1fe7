"""Reports once how well the times of a device are known, and when they are known too badly."""

from __future__ import annotations

import math
from collections.abc import Callable

from agribot.core.facts import TimesKnown, TimesUnsure
from agribot.core.messages import DeviceNote
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

    def update(self, t_s: float) -> tuple[DeviceNote, ...]:
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
        unsure = TimesUnsure(self._name, unsure_s, UNSURE_S)
        fact = unsure if is_unsure else TimesKnown(self._name, unsure_s)
        return (DeviceNote(t_s=t_s, fact=fact),)
