"""Is a line noisy? Frames whose checksums are wrong are dropped, and many of them are reported."""

from __future__ import annotations

from collections import deque

from agribot.core.messages import OperatorEvent, make_sensor_note

MANY, WITHIN_S = 3, 10.0  # broken frames; a line in order has none, one that is plugged in has one


class LineWatch:
    """Notes once that a line breaks frames, and once that it does not any more.

    `name` is that of what is at its other end.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._broken_s: deque[float] = deque(maxlen=MANY)
        self._known = 0
        self._is_noisy = False

    def update(self, t_s: float, broken: int) -> tuple[OperatorEvent, ...]:
        """Note what has changed at a time; `broken` counts the frames since the line is open."""
        new = broken - self._known if broken >= self._known else broken
        self._known = broken
        self._broken_s.extend([t_s] * min(new, MANY))
        times_s = self._broken_s
        if not self._is_noisy and len(times_s) == MANY and t_s - times_s[0] <= WITHIN_S:
            self._is_noisy = True
            text = (
                f"the link to the {self._name} broke {MANY} messages within "
                f"{t_s - times_s[0]:.1f} s, which are left out; check its cable, plugs and ground"
            )
            return (make_sensor_note(t_s, text, is_fault=True, parts=("link",)),)
        if self._is_noisy and t_s - times_s[-1] > WITHIN_S:
            self._is_noisy = False
            text = f"the link to the {self._name} broke no message for {WITHIN_S:g} s"
            return (make_sensor_note(t_s, text, is_fault=False, parts=("link",)),)
        return ()
