"""Is a line noisy? Frames whose checksums are wrong are dropped, and many of them are reported."""

from __future__ import annotations

from collections import deque
from typing import Literal

from agribot.core.facts import LineClean, LineNoisy
from agribot.core.messages import DeviceNote

MANY, WITHIN_S = 3, 10.0  # broken frames; a line in order has none, one that is plugged in has one


class LineWatch:
    """Notes once that a line breaks frames, and once that it does not any more.

    `device` is what is at its other end, and `name` how it is called.
    """

    def __init__(self, device: Literal["receiver", "board"], name: str) -> None:
        self._device: Literal["receiver", "board"] = device
        self._name = name
        self._broken_s: deque[float] = deque(maxlen=MANY)
        self._known = 0
        self._is_noisy = False

    def update(self, t_s: float, broken: int) -> tuple[DeviceNote, ...]:
        """Note what has changed at a time; `broken` counts the frames since the line is open."""
        new = broken - self._known if broken >= self._known else broken
        self._known = broken
        self._broken_s.extend([t_s] * min(new, MANY))
        times_s = self._broken_s
        if not self._is_noisy and len(times_s) == MANY and t_s - times_s[0] <= WITHIN_S:
            self._is_noisy = True
            noisy = LineNoisy(self._device, self._name, MANY, t_s - times_s[0])
            return (DeviceNote(t_s=t_s, fact=noisy),)
        if self._is_noisy and t_s - times_s[-1] > WITHIN_S:
            self._is_noisy = False
            clean = LineClean(self._device, self._name, WITHIN_S)
            return (DeviceNote(t_s=t_s, fact=clean),)
        return ()
