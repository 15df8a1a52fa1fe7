"""A camera on the rows, as parameters: line, outliers, dropouts, ends."""

from __future__ import annotations

import math

from agribot.core.arithmetic import clamp
from agribot.core.geo import wrap_rad
from agribot.core.messages import RowLine
from agribot.lab.bench.nav.draws import Coins, Draws, SlowError
from agribot.lab.bench.nav.plant import SoilRover
from agribot.lab.bench.nav.scenario import DT_S, PITCH_M, ROW_LENGTH_M, Scenario, Vision

PERIOD_STEPS = 7
MAX_HEADING_RAD, MAX_OFFSET_M = math.radians(25.0), 0.45
VIEW_M, MIN_ROW_IN_VIEW_M = (0.2, 1.2), 0.4
START_RANGE_M, END_RANGE_M = (0.3, 1.1), (0.2, 1.2)
START_RATIO, END_EVERY = 0.5, 3
WANDER_RATIO, WANDER_S = 0.8, 2.0


class RowCamera:
    """The camera of one rover."""

    def __init__(self, seed: int, scenario: Scenario, vision: Vision) -> None:
        dt_s = PERIOD_STEPS * DT_S
        self._vision, self._rows, self._dt_s = vision, scenario.rows, dt_s
        self._draws, self._coins = Draws(seed, 10, 8), Coins(seed, 11, 4)
        self._offset = SlowError(WANDER_RATIO * vision.offset_std_m, WANDER_S, dt_s)
        self._heading = SlowError(vision.heading_wander_rad, WANDER_S, dt_s)
        self._dark_s = 0.0
        self._frames = 0

    def sample(self, t_s: float, rover: SoilRover) -> RowLine | None:
        """Take a picture; None where it shows no row."""
        normal, coin = self._draws.take(), self._coins.take()
        self._frames += 1
        self._offset.step(normal[0])
        self._heading.step(normal[1])
        is_dark = self._pass_darkness(coin[0], coin[1])
        sign = 1.0 if math.cos(rover.yaw_rad) > 0.0 else -1.0
        row = round(rover.y_m / PITCH_M)
        beside_m = sign * (rover.y_m - row * PITCH_M)
        heading_rad = wrap_rad(rover.yaw_rad - (0.0 if sign > 0.0 else math.pi))
        is_over_row = 0 <= row < self._rows and abs(beside_m) < MAX_OFFSET_M
        if is_dark or not is_over_row or abs(heading_rad) >= MAX_HEADING_RAD:
            return None
        start_m = ((0.0 if sign > 0.0 else ROW_LENGTH_M) - rover.x_m) * sign
        return self._make_line(t_s, (beside_m, heading_rad), start_m, normal, coin)

    def _pass_darkness(self, begins: float, lasts: float) -> bool:
        """Whether the camera shows nothing for a while; `begins` and `lasts` are in [0, 1)."""
        vision = self._vision
        if self._dark_s > 0.0:
            self._dark_s -= self._dt_s
        elif begins < self._dt_s / vision.dropout_every_s:
            longest_s = vision.dropout_max_s
            self._dark_s = vision.dropout_min_s + (longest_s - vision.dropout_min_s) * lasts
        return self._dark_s > 0.0

    def _make_line(
        self, t_s: float, seen: tuple[float, float], start_m: float, normal: list[float],
        coin: list[float],
    ) -> RowLine | None:  # fmt: skip
        """Add errors; `seen` is the true offset, m, and heading, rad, `start_m` lies ahead."""
        vision, end_m = self._vision, start_m + ROW_LENGTH_M
        in_view_m = clamp(VIEW_M[1], start_m, end_m) - clamp(VIEW_M[0], start_m, end_m)
        has_line = in_view_m > MIN_ROW_IN_VIEW_M
        offset_m = seen[0] + self._offset.value + vision.offset_std_m * normal[2]
        heading_rad = seen[1] + self._heading.value + vision.heading_std_rad * normal[4]
        if coin[2] < vision.outlier_ratio:
            offset_m += vision.outlier_m * normal[3]
            heading_rad += vision.outlier_rad * normal[5]
        has_start = _is_within(start_m, START_RANGE_M) and coin[3] < START_RATIO
        has_end = has_line and _is_within(end_m, END_RANGE_M) and self._frames % END_EVERY == 0
        if not (has_line or has_start):
            return None
        return RowLine(
            t_s=t_s,
            offset_m=offset_m if has_line else None,
            heading_rad=heading_rad if has_line else None,
            start_ahead_m=start_m + vision.range_std_m * normal[6] if has_start else None,
            end_ahead_m=end_m + vision.range_std_m * normal[7] if has_end else None,
            offset_std_m=vision.stated_ratio * vision.offset_std_m,
            heading_std_rad=vision.stated_ratio * vision.heading_std_rad,
            range_std_m=vision.range_std_m,
        )


def _is_within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] < value < limits[1]
