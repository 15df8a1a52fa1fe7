"""Pass STOP on to the robot: the first at once, a flood of further ones merged."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable

from agribot.core.messages import Who

MERGE_S = 0.2  # period of STOPs that are merged: five a second are enough to show who presses


class Stops:
    """`post` sends one stop to the robot, with who pressed and how often, if more than once.

    No press is lost: one that is merged goes out with the others at the end of the interval, in
    case somebody else, such as a program on the robot, cleared the stop meanwhile.
    """

    def __init__(
        self, post: Callable[[Who, int], None], now: Callable[[], float] = time.monotonic
    ) -> None:
        self._post, self._now = post, now
        self._posted_s = -math.inf
        self._merged = 0
        self._timer: asyncio.TimerHandle | None = None

    def press(self, who: Who) -> None:
        wait_s = self._posted_s + MERGE_S - self._now()
        if wait_s <= 0.0 and self._timer is None:
            self._post(who, 1)
            self._posted_s = self._now()
            return
        self._merged += 1
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(wait_s, self._repeat, who)

    def clear(self) -> None:
        """Forget presses before the stop was cleared; the next one counts at once."""
        if self._timer is not None:
            self._timer.cancel()
        self._posted_s, self._merged, self._timer = -math.inf, 0, None

    def _repeat(self, who: Who) -> None:
        merged, self._merged, self._timer = self._merged, 0, None
        self._post(who, merged)
        self._posted_s = self._now()
