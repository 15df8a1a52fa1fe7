"""The line of the crop row under the robot as a correction of offset, heading and place along it.

A sensor of the line cannot tell which row it sees: the pose tells, so lines are only used while
it can, and after a run of lines that do not fit the filter opens up for them.
"""

from __future__ import annotations

import math
from collections import Counter

import msgspec

from agribot.autonomy.estimate import row_model as model
from agribot.autonomy.estimate.ekf import ROW_BIAS, YAW, Ekf, Row, X, Y
from agribot.autonomy.estimate.field_rows import FieldRows, RowFrame
from agribot.autonomy.estimate.gate import Gate
from agribot.autonomy.estimate.history import Motion, MotionHistory
from agribot.autonomy.estimate.row_agreement import RowAgreement
from agribot.core.arithmetic import FLOATS
from agribot.core.config import FieldConfig
from agribot.core.geo import wrap_rad
from agribot.core.messages import RowLine

# Of plants farther apart each is seen by itself, and bare ground after one is no row's end.
MAX_SPACING_M = 0.5
# What seems the end of a row nearer than this to it may correct a pose that is sure of another.
GAP_M = 0.6
MAX_HEADING_RAD, MAX_DISAGREEMENT_RAD = math.radians(30.0), math.radians(15.0)


class RowLines:
    """Corrects the filter by row lines; `rejected` counts what could not serve."""

    def __init__(
        self,
        ekf: Ekf,
        history: MotionHistory,
        field: FieldConfig,
        rejected: Counter[str],
        agreement: RowAgreement,
    ) -> None:
        self._agreement = agreement
        self._ekf = ekf
        self._history = history
        self._field = FieldRows(field)
        self._rejected = rejected
        self._offset_gate = Gate(model.GATE_SIGMA, model.RECOVER_AFTER)
        self._heading_gate = Gate(model.GATE_SIGMA, model.RECOVER_AFTER)
        self._range_gate = Gate(model.RANGE_GATE_SIGMA, model.RANGE_RECOVER_AFTER)
        self._last_t_s = self._last_line_s = -math.inf
        self._bias_std_m: float | None = None
        self.fitted = 0  # lines of the row under the robot that were believed

    def see(self, line: RowLine) -> None:
        now, then = self._history.newest, self._history.at(line.t_s)
        if not _is_usable(line):
            self._rejected["row line not usable"] += 1
        elif line.t_s <= self._last_t_s:
            self._rejected["row line out of order"] += 1
        elif now is None or then is None:
            self._rejected["row line without odometry"] += 1
        else:
            frame = self._frame(now, then)
            sign = self._facing(frame, now, then)
            self._line(line, sign, now, then)
            self._last_t_s = line.t_s
            first_m, last_m = self._ends(sign)
            for ahead_m, at_m in ((line.start_ahead_m, first_m), (line.end_ahead_m, last_m)):
                if ahead_m is not None:
                    along_m = at_m - sign * ahead_m / frame.stretch
                    self._range(along_m, line.range_std_m, now, then)

    @property
    def has_lines(self) -> bool:
        """Whether plants stand close enough, as far as the field knows, to make up a line."""
        return self._field.spacing_m is None or self._field.spacing_m <= MAX_SPACING_M

    def see_picture(self, line: RowLine) -> None:
        """As `see`, of a line that may be none: rows seen aslant from a turn line up every way."""
        now, then = self._history.newest, self._history.at(line.t_s)
        if now is None or then is None or line.heading_rad is None:
            self._rejected["row line without odometry"] += 1
            return
        yaw_rad = self._ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        frame = self._frame(now, then, self._arm_m(line, now, then))
        sign = self._facing(frame, now, then)
        heading_rad = wrap_rad(yaw_rad - frame.yaw_rad + (0.0 if sign > 0.0 else math.pi))
        is_along = abs(heading_rad) <= MAX_HEADING_RAD
        if not is_along or abs(wrap_rad(line.heading_rad - heading_rad)) > MAX_DISAGREEMENT_RAD:
            self._rejected["row line aslant"] += 1
            return
        first_m, last_m = self._ends(sign)
        self.see(
            msgspec.structs.replace(
                line,
                start_ahead_m=self._likely(line, line.start_ahead_m, first_m, sign, now, then),
                end_ahead_m=self._likely(line, line.end_ahead_m, last_m, sign, now, then),
            )
        )

    def _likely(
        self,
        line: RowLine,
        ahead_m: float | None,
        at_m: float,
        sign: float,
        now: Motion,
        then: Motion,
    ) -> float | None:
        """The end of a row, unless it can only be a gap within it: gaps look like ends."""
        if ahead_m is None:
            return None
        frame = self._frame(now, then)
        off_m = (at_m - sign * ahead_m / frame.stretch - frame.along_m) * frame.stretch
        along_m2 = self._ekf.project(moved_row(frame.forward, now, then))[1]
        sigma_m = math.sqrt(along_m2 + line.range_std_m**2)
        if abs(off_m) <= max(GAP_M, model.RANGE_GATE_SIGMA * sigma_m):
            return ahead_m
        self._rejected["gap in the row"] += 1
        return None

    def _ends(self, sign: float) -> tuple[float, float]:
        """Where the first and the last plant stand along the rows, as the robot drives."""
        return (0.0, self._field.length_m) if sign > 0.0 else (self._field.length_m, 0.0)

    def ageing(self, dt_s: float) -> list[tuple[int, float, float]]:
        """How the lasting error ages, as Ekf.relax takes it."""
        if self._bias_std_m is None:
            return []
        factor = math.exp(-dt_s / model.LASTING_MEMORY_S)
        return [(ROW_BIAS, factor, self._bias_std_m**2 * (1.0 - factor * factor))]

    def _line(self, line: RowLine, sign: float, now: Motion, then: Motion) -> None:
        if line.offset_m is None or line.heading_rad is None:
            return
        since_last_s = min(line.t_s - self._last_line_s, model.LASTING_MEMORY_S)
        self._last_line_s = line.t_s
        self._begin(line)
        if self._offset(line, line.offset_m, sign, now, then):
            variance = model.heading_variance(FLOATS, line.heading_std_rad, since_last_s)
            frame = self._frame(now, then, self._arm_m(line, now, then))
            heading_rad = line.heading_rad + frame.yaw_rad + (0.0 if sign > 0.0 else math.pi)
            self._heading(heading_rad, variance, now, then)

    def _begin(self, line: RowLine) -> None:
        if self._bias_std_m is None:
            self._bias_std_m = model.LASTING_RATIO * line.offset_std_m
            self._ekf.reset(ROW_BIAS, 0.0, self._bias_std_m**2)

    def _facing(self, frame: RowFrame, now: Motion, then: Motion) -> float:
        yaw_rad = self._ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        return 1.0 if math.cos(yaw_rad - frame.yaw_rad) >= 0.0 else -1.0

    def _arm_m(self, line: RowLine, now: Motion, then: Motion) -> tuple[float, float]:
        """From the robot to the place ahead for which the line tells its offset."""
        yaw_rad = self._ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        return line.at_ahead_m * math.cos(yaw_rad), line.at_ahead_m * math.sin(yaw_rad)

    def _frame(
        self, now: Motion, then: Motion, arm_m: tuple[float, float] = (0.0, 0.0)
    ) -> RowFrame:
        """Where the robot was among the rows, or a point `arm_m` from it."""
        x = self._ekf.x
        return self._field.at(
            x[X] - (now.x_m - then.x_m) + arm_m[0], x[Y] - (now.y_m - then.y_m) + arm_m[1]
        )

    def _offset(
        self, line: RowLine, offset_m: float, sign: float, now: Motion, then: Motion
    ) -> bool:
        """False where the pose cannot tell which row this is."""
        ekf, field = self._ekf, self._field
        arm_m = self._arm_m(line, now, then)
        frame = self._frame(now, then, arm_m)
        right_m = frame.right_m
        row: Row = (*moved_row(frame.right, now, then, arm_m), (ROW_BIAS, -sign))
        across_m2 = ekf.project(row[:3])[1]
        if across_m2 > (model.TELLS_APART_RATIO * field.pitch_m) ** 2:
            self._rejected["row line ambiguous"] += 1
            return False
        _, row_right_m = field.row_at(right_m + sign * offset_m)
        off_m = row_right_m - sign * offset_m - right_m
        self._agreement.look(line.t_s, off_m)
        residual_m = off_m + sign * ekf.x[ROW_BIAS]
        variance = model.offset_variance(line.offset_std_m)
        distance2 = residual_m**2 / (ekf.project(row)[1] + variance)
        verdict = self._offset_gate.judge(distance2)
        if verdict == "reject":
            self._rejected["row line off its row"] += 1
            return False
        if verdict == "recover":
            self._rejected["row found again"] += 1
            for state, part in ((X, frame.right[0]), (Y, frame.right[1])):
                ekf.inflate(state, (part * model.RECOVERY_OFFSET_M) ** 2)
            ekf.inflate(YAW, model.RECOVERY_YAW_RAD**2)
            return False
        self._agreement.hold(line.t_s)
        ekf.update(row, residual_m, variance * model.tail_factor(FLOATS, distance2))
        self.fitted += abs(offset_m) <= field.pitch_m / 2.0
        return True

    def _heading(self, heading_rad: float, variance: float, now: Motion, then: Motion) -> None:
        """The line's direction in the map, less the angle at which the robot sees it."""
        ekf = self._ekf
        yaw_rad = ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        residual_rad = wrap_rad(heading_rad - yaw_rad)
        distance2 = residual_rad**2 / (float(ekf.cov[YAW, YAW]) + variance)
        verdict = self._heading_gate.judge(distance2)
        if verdict == "reject":
            self._rejected["row line turned off"] += 1
            return
        if verdict == "recover":
            ekf.inflate(YAW, model.RECOVERY_YAW_RAD**2)
        ekf.update(((YAW, 1.0),), residual_rad, variance * model.tail_factor(FLOATS, distance2))

    def _range(self, along_then_m: float, std_m: float, now: Motion, then: Motion) -> None:
        """Place along the row, from its first or last plant."""
        ekf, frame = self._ekf, self._frame(now, then)
        row = moved_row(frame.forward, now, then)
        residual_m = (along_then_m - frame.along_m) * frame.stretch
        gate = self._range_gate
        variance = std_m**2
        verdict = gate.judge(ekf.update(row, residual_m, variance, gate.limit))
        if verdict == "reject":
            self._rejected["row end elsewhere"] += 1
        elif verdict == "recover":
            for state, part in ((X, frame.forward[0]), (Y, frame.forward[1])):
                ekf.inflate(state, (part * model.RECOVERY_RANGE_M) ** 2)
            ekf.update(row, residual_m, variance)


def moved_row(
    direction: tuple[float, float],
    now: Motion,
    then: Motion,
    arm_m: tuple[float, float] = (0.0, 0.0),
) -> Row:
    """How the place of a moment ago, or a point `arm_m` from it, follows from the pose now.

    The place is that in a direction of the map.
    """
    dx, dy = direction
    moved_x, moved_y = now.x_m - then.x_m - arm_m[0], now.y_m - then.y_m - arm_m[1]
    return ((X, dx), (Y, dy), (YAW, dx * moved_y - dy * moved_x))


def _is_usable(line: RowLine) -> bool:
    aheads = (line.start_ahead_m, line.end_ahead_m, line.at_ahead_m)
    values = (line.offset_m, line.heading_rad, *aheads)
    sigmas = (line.offset_std_m, line.heading_std_rad, line.range_std_m)
    told = (value for value in (line.t_s, *values, *sigmas) if value is not None)
    return all(map(math.isfinite, told)) and min(sigmas) > 0.0
