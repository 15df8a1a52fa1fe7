"""The fence around what must not be entered, such as what a map shows as occupied.

As at the edge of a field, the robot's rectangle is judged where it is and where it would come to
rest, larger by what is not known of its position, though by no more than half of what plans keep
off. A field plan has these areas as holes, within its own fence.
"""

from __future__ import annotations

import math

import numpy as np

from agribot.autonomy.control.fence import measure_growth_m, predict_rest
from agribot.core.config import SafetyConfig
from agribot.core.facts import EntersKeepOut, InKeepOut
from agribot.core.keep_out import BodyBox, KeepOutAreas
from agribot.core.messages import DriveCommand, Estimate, Goal


class KeepOutFence:
    """Stops a robot before an area; one that stands in it already may be driven out by hand."""

    def __init__(
        self,
        keep_out: KeepOutAreas,
        body: BodyBox,
        config: SafetyConfig,
        clearance_m: float,
        decel_mps2: float = math.inf,
    ) -> None:
        """`clearance_m` is what plans keep between body and areas, `decel_mps2` of the brakes."""
        self._keep_out, self._body, self._config = keep_out, body, config
        self._clearance_m, self._decel_mps2 = clearance_m, decel_mps2

    def objection(
        self, estimate: Estimate, drive: DriveCommand, goal: Goal
    ) -> EntersKeepOut | InKeepOut | None:
        """Why the robot must not move like this here; None where it may."""
        if goal.bounds is not None:
            return None
        growth_m = measure_growth_m(estimate.pos_std_m, estimate.quality, self._config)
        return self._find(estimate, drive, min(max(growth_m, 0.0), self._clearance_m / 2.0))

    def crossing(self, estimate: Estimate, drive: DriveCommand) -> EntersKeepOut | InKeepOut | None:
        """Find that a hand is about to enter; one that is in may be driven out as it likes."""
        here = np.array([[estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad]])
        if self._keep_out.find_touch(here, self._body, 0.0) is not None:
            return None
        return self._find(estimate, drive, 0.0)

    def _find(
        self, estimate: Estimate, drive: DriveCommand, growth_m: float
    ) -> EntersKeepOut | InKeepOut | None:
        here = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        rest = predict_rest(here, drive, self._decel_mps2)
        touch = self._keep_out.find_touch(np.array([here, rest]), self._grow(growth_m), 0.0)
        if touch is None:
            return None
        fact = EntersKeepOut if touch.pose else InKeepOut
        return fact(*touch.place_map_m, *here[:2])

    def _grow(self, by_m: float) -> BodyBox:
        return BodyBox(*(side_m + by_m for side_m in self._body))
