"""A picture whose left and right are swapped: rows and plants turn in it as the robot does not.

A robot that turns left sees all that stands before it move to its right. Each turn of a few degrees
is one vote, by how much likelier it is in a true picture than in a mirrored one, and votes are
summed up until they cannot be chance (Page 1954, "Continuous inspection schemes", Biometrika 41).
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from agribot.autonomy.estimate.filter.history import Motion
from agribot.core.facts import PictureMirrored
from agribot.core.messages import Scene

# Directions in a mean, and bend of a row besides its noise.
LINES, BEND_RAD = 5, math.radians(0.7)
# Neighbouring pictures show the same leaves: two of three looks are new.
NEW_RATIO = 2.0 / 3.0
TURN_RAD = math.radians(1.5)  # turn that a vote needs
# A direction that was seen longer ago, in way or turn, is that of another row or piece of it.
MAX_WAY_M, MAX_TURN_RAD = 1.0, math.radians(10.0)
# At least three looks must err, and no lead is larger than two looks take back.
MOST_VOTE, NEEDED, MOST = 4.0, 12.0, 20.0


class _Look(NamedTuple):
    """Place by dead reckoning, and the direction of the row as seen from there."""

    then: Motion
    yaw_rad: float
    heading_rad: float
    std_rad: float


class MirrorWatch:
    """Call `add` with every scene and where dead reckoning was at its capture."""

    def __init__(self) -> None:
        self._last: deque[_Look] = deque(maxlen=LINES)
        self._first: _Look | None = None
        self._against = 0.0
        self.is_mirrored = False

    def add(self, scene: Scene, then: Motion | None) -> None:
        line = scene.row_line
        if then is None or line is None or line.heading_rad is None:
            return
        if self._last and _is_elsewhere(self._last[-1], then):
            self._last.clear()
            self._first = None
        self._last.append(_Look(then, then.yaw_rad, line.heading_rad, line.heading_std_rad))
        if len(self._last) == LINES:
            self._compare(_take_mean(self._last))

    def _compare(self, now: _Look) -> None:
        first = self._first
        if first is None or _is_elsewhere(first, now.then):
            self._first = now
            return
        turned_rad = now.yaw_rad - first.yaw_rad
        if abs(turned_rad) < TURN_RAD:
            return
        self._first = now
        reported_rad = math.remainder(now.heading_rad - first.heading_rad, math.pi)
        noise_rad2 = (first.std_rad**2 + now.std_rad**2) / (NEW_RATIO * LINES)
        vote = -2.0 * turned_rad * reported_rad / (BEND_RAD**2 + noise_rad2)
        vote = min(max(vote, -MOST_VOTE), MOST_VOTE)
        self._against = min(max(self._against + vote, 0.0), MOST)
        self.is_mirrored = self._against >= (1.0 if self.is_mirrored else NEEDED)

    @property
    def fault(self) -> PictureMirrored | None:
        return PictureMirrored() if self.is_mirrored else None


def _take_mean(looks: Sequence[_Look]) -> _Look:
    """Take the last place, with means of what was seen and turned until then."""
    base_rad = looks[0].heading_rad
    apart_rad = [math.remainder(look.heading_rad - base_rad, math.pi) for look in looks]
    last = looks[-1]
    return last._replace(
        yaw_rad=statistics.fmean(look.yaw_rad for look in looks),
        heading_rad=base_rad + statistics.fmean(apart_rad),
    )


def _is_elsewhere(a: _Look, b: Motion) -> bool:
    way_m = math.hypot(b.x_m - a.then.x_m, b.y_m - a.then.y_m)
    return way_m > MAX_WAY_M or abs(b.yaw_rad - a.then.yaw_rad) > MAX_TURN_RAD
