"""Stamps of another clock on the robot's own."""

from __future__ import annotations

from collections import deque

WINDOW_S = 2.0
# The freshest message of a window is younger than this if its stamps are of the robot's clock.
SAME_CLOCK_S = 1.0
_AHEAD_S = 0.05  # of rounding


class StampClock:
    """One per source. The quickest of the last messages tells how far the clocks are apart.

    A peer that keeps the robot's time (/clock) is believed to the nanosecond; of another clock
    the shortest delay within `WINDOW_S` counts as none, so that a clock that is set anew is
    followed as soon. A message without a stamp is as old as its arrival. Nothing is from the
    future. Source: one-way synchronisation after Olson, "A passive solution to the sensor
    synchronization problem", IROS 2010, with a window in place of a drift model.
    """

    def __init__(self) -> None:
        self._delays: deque[tuple[float, float]] = deque()  # arrival, arrival minus stamp

    def t_s(self, stamp_s: float, arrived_s: float) -> float:
        """Capture time on the robot's clock; `arrived_s` is of that clock, too."""
        if stamp_s == 0.0:
            return arrived_s
        self._delays.append((arrived_s, arrived_s - stamp_s))
        while arrived_s - self._delays[0][0] > WINDOW_S:
            self._delays.popleft()
        shortest_s = min(delay_s for _, delay_s in self._delays)
        is_same = -_AHEAD_S <= shortest_s <= SAME_CLOCK_S
        return min(stamp_s if is_same else stamp_s + shortest_s, arrived_s)
