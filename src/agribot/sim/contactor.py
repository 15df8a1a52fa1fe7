"""The contactors in the supply of the simulated robot's motors, in series."""

from __future__ import annotations

import math

from agribot.core.messages import ContactorSample

# Time from the command until the contacts are apart: four bytes at 9600 baud to a relay (4 ms), the
# relay (SRD-05VDC-SL-C: 10 ms at most), and the contactor that it holds (Schneider LC1D09BD: 16 to
# 24 ms); from the data sheets, rounded up.
OPENS_S = 0.04
ROUNDING_S = 1e-9
CLOSES_S = 0.09  # the same, with 54 to 72 ms of that contactor


class SimContactors:
    """Simulated contactors, which follow each command after their switching time."""

    def __init__(self, count: int) -> None:
        self._are_closed = [True] * count
        self._is_cut = self._is_open_due = False
        self._has_current = True
        self._since_s = -math.inf

    @property
    def feed_motors(self) -> bool:
        """Whether the current passes all of them."""
        return all(self._are_closed)

    def command(self, t_s: float, *, is_cut: bool) -> None:
        """Open or close; repeating a command changes nothing."""
        self._is_cut = is_cut
        self._decide(t_s)

    def step(self, t_s: float, *, has_current: bool = True, is_welded: bool = False) -> None:
        """Move the contacts as far as they are at a time.

        The coils `has_current` unless something else interrupts it, such as the red button; the
        contacts of the first, where they are welded, stay closed.
        """
        self._has_current = has_current
        self._decide(t_s)
        delay_s = OPENS_S if self._is_open_due else CLOSES_S
        if t_s - self._since_s < delay_s - ROUNDING_S:
            return
        for index, was_closed in enumerate(self._are_closed):
            is_stuck = is_welded and index == 0 and was_closed
            self._are_closed[index] = is_stuck or not self._is_open_due

    def read(self, t_s: float) -> ContactorSample:
        """Return the state of the auxiliary contacts, which move with the main ones."""
        is_one_closed = any(self._are_closed) and not self.feed_motors
        return ContactorSample(t_s=t_s, is_closed=self.feed_motors, is_one_closed=is_one_closed)

    def _decide(self, t_s: float) -> None:
        is_open_due = self._is_cut or not self._has_current
        if is_open_due != self._is_open_due:
            self._is_open_due, self._since_s = is_open_due, t_s
