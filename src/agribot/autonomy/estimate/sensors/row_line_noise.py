"""How much more row lines scatter than they state, learnt from the jumps between neighbours."""

from __future__ import annotations

import math
import statistics
from collections import deque

import msgspec

from agribot.autonomy.estimate.filter import row_model as model
from agribot.core.facts import RowHeadingsScatter, RowLinesScatter
from agribot.core.messages import RowLine

# The median of the squared jumps of one number, over its variance: 2 x 0.4549 for normal noise.
JUMP2_MEDIAN = 0.9099
# Jumps that give the ratio to a fifth, and the ratio that is surely more than stated: with every
# tenth line an outlier they show a third more than the noise.
MOST_JUMPS, SURE_RATIO = 61, 1.75
# Longest gap between neighbouring lines: after it the robot, and the row below it, have moved on.
MAX_GAP_S = 0.5
NAMED_RATIO, NAMED_M, NAMED_RAD = 2.0, 0.03, math.radians(2.0)


class NoiseRatio:
    """Noise over what is stated of it: 1 unless it is surely more.

    A jump cancels what lasts, a wrong pose or a camera that looks aside, and has twice the variance
    of the noise (Mehra 1970, as for velocities); the median does not hear single outliers. It
    begins as if as many jumps as it remembers had been as stated.
    """

    def __init__(self) -> None:
        self._jumps2 = deque([JUMP2_MEDIAN] * MOST_JUMPS, maxlen=MOST_JUMPS)
        self._last: tuple[float, float, float] | None = None
        self.ratio = 1.0

    def add(self, t_s: float, residual: float, variance: float) -> None:
        """Take what a line shows less what the pose expects, and the variance that it states."""
        last, self._last = self._last, (t_s, residual, variance)
        if last is None or not 0.0 < t_s - last[0] <= MAX_GAP_S:
            return
        self._jumps2.append(2.0 * (residual - last[1]) ** 2 / (variance + last[2]))
        ratio = math.sqrt(statistics.median(self._jumps2) / JUMP2_MEDIAN)
        self.ratio = ratio if ratio > SURE_RATIO else 1.0


class RowLineNoise:
    """Call `add` with each line and how it fits the pose; `widen` says what to believe of it."""

    def __init__(self) -> None:
        self._offset, self._heading = NoiseRatio(), NoiseRatio()
        self._stated_m = self._stated_rad = 0.0

    @property
    def offset_ratio(self) -> float:
        return self._offset.ratio

    def add(self, line: RowLine, off_m: float, turned_rad: float) -> None:
        """Take a line, and how far aside and turned it puts the robot from its pose."""
        self._stated_m, self._stated_rad = line.offset_std_m, line.heading_std_rad
        self._offset.add(line.t_s, off_m, model.offset_variance(line.offset_std_m))
        self._heading.add(line.t_s, turned_rad, line.heading_std_rad**2)

    def widen(self, line: RowLine) -> RowLine:
        """Give a line the noise that its kind was seen to have, where that is surely more."""
        offset, heading = self._offset.ratio, self._heading.ratio
        if offset == heading == 1.0:
            return line
        return msgspec.structs.replace(
            line,
            offset_std_m=offset * line.offset_std_m,
            heading_std_rad=heading * line.heading_std_rad,
        )

    @property
    def fault(self) -> RowLinesScatter | RowHeadingsScatter | None:
        std_m, std_rad = self._offset.ratio * self._stated_m, self._heading.ratio * self._stated_rad
        if self._offset.ratio >= NAMED_RATIO and std_m >= NAMED_M:
            return RowLinesScatter(std_m, self._stated_m)
        if self._heading.ratio >= NAMED_RATIO and std_rad >= NAMED_RAD:
            return RowHeadingsScatter(std_rad, self._stated_rad)
        return None
