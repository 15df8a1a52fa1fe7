"""The line of the crop row under the robot as a correction of offset, heading and place along it.

A line does not show which row it is. The pose determines the row, so lines are used only while it
can, and after a run of lines that do not fit the filter opens up for them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agribot.autonomy.estimate.filter import row_model as model
from agribot.autonomy.estimate.filter.ekf import (
    ROW_BIAS,
    ROW_OFFSET,
    SLIP,
    WHEEL_SCALE,
    YAW,
    Row,
    X,
    Y,
)
from agribot.autonomy.estimate.filter.field_rows import RowFrame
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.autonomy.estimate.filter.history import Epoch
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.sensors.correction import Correction, Measurements
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.witnesses.drift_watch import MAX_LOST_RATIO
from agribot.autonomy.estimate.witnesses.row_line_watch import PosedLine
from agribot.core.arithmetic import clamp
from agribot.core.geo import wrap_rad
from agribot.core.messages import RowLine

# Largest spacing of plants of a line; beyond it each is seen by itself, and bare ground after one
# is no row's end.
MAX_SPACING_M = 0.5
# Largest distance between a seen and a known end of the row; a nearer one may correct a pose that
# is sure of another.
GAP_M = 0.6
# The outermost plant of a row may be missing, which every look at that end repeats: 1 sigma in
# plant spacings, and how many looks share it.
END_STD_SPACINGS, LOOKS_AT_END = 0.35, 16
# Time over which earlier rows show how far the next one stands off the map.
ROW_MEMORY_S = 100.0
USUAL_SPACING_M = 0.2  # spacing of plants that make up a line, if the field states none
MAX_HEADING_RAD, MAX_DISAGREEMENT_RAD = math.radians(30.0), math.radians(15.0)


class RowLines(Correction[RowLine]):
    """Corrects the filter by row lines, of a sensor of lines or of a picture."""

    def __init__(self, pose: PoseFilter) -> None:
        super().__init__(pose)
        self._offset_gate = Gate(
            model.GATE_SIGMA, model.RECOVER_AFTER, "row line off its row", "row found again"
        )
        self._heading_gate = Gate(model.GATE_SIGMA, model.RECOVER_AFTER, "row line turned off")
        self._range_gate = Gate(
            model.RANGE_GATE_SIGMA, model.RANGE_RECOVER_AFTER, "row end elsewhere"
        )
        self._last_line_s = -math.inf
        self._bias_std_m: float | None = None
        self._row: int | None = None
        self.fitted = 0  # lines of the row under the robot that were believed

    @property
    def has_lines(self) -> bool:
        """Whether plants stand close enough, as far as the field knows, to make up a line."""
        spacing_m = self.pose.rows.spacing_m
        return spacing_m is None or spacing_m <= MAX_SPACING_M

    def is_usable(self, sample: RowLine) -> bool:
        aheads = (sample.start_ahead_m, sample.end_ahead_m, sample.at_ahead_m)
        values = (sample.offset_m, sample.heading_rad, *aheads)
        sigmas = (sample.offset_std_m, sample.heading_std_rad, sample.range_std_m)
        known = (value for value in (*values, *sigmas) if value is not None)
        return all(map(math.isfinite, known)) and min(sigmas) > 0.0

    def measure(self, sample: RowLine, epoch: Epoch) -> Measurements:
        frame = self._frame(epoch)
        sign = self._facing(frame, epoch)
        yield from self._line(sample, sign, epoch)
        first_m, last_m = _ends(frame, sign)
        for ahead_m, at_m in ((sample.start_ahead_m, first_m), (sample.end_ahead_m, last_m)):
            if ahead_m is not None:
                yield self._range(at_m - sign * ahead_m / frame.stretch, sample.range_std_m, epoch)

    def pick(self, line: RowLine) -> RowLine | None:
        """Give what of a picture's line may be used: rows seen aslant from a turn line up anyhow.

        None, and counted, where that is nothing.
        """
        epoch = self.pose.history.epoch(line.t_s)
        if epoch is None or line.heading_rad is None:
            self.pose.rejected["row line without odometry"] += 1
            return None
        frame = self._frame(epoch, self._arm_m(line, epoch))
        sign = self._facing(frame, epoch)
        heading_rad = wrap_rad(
            self._yaw_then_rad(epoch) - frame.yaw_rad + (0.0 if sign > 0.0 else math.pi)
        )
        is_along = abs(heading_rad) <= MAX_HEADING_RAD
        if not is_along or abs(wrap_rad(line.heading_rad - heading_rad)) > MAX_DISAGREEMENT_RAD:
            self.pose.rejected["row line aslant"] += 1
            return None
        first_m, last_m = _ends(frame, sign)
        return msgspec.structs.replace(
            line,
            start_ahead_m=self._likely(line, line.start_ahead_m, first_m, sign, epoch),
            end_ahead_m=self._likely(line, line.end_ahead_m, last_m, sign, epoch),
            range_std_m=math.hypot(line.range_std_m, self._end_std_m() * math.sqrt(LOOKS_AT_END)),
        )

    def _end_std_m(self) -> float:
        """Return how far the outermost plant of a row may stand off the row's end, 1 sigma."""
        return END_STD_SPACINGS * (self.pose.rows.spacing_m or USUAL_SPACING_M)

    def _likely(
        self, line: RowLine, ahead_m: float | None, at_m: float, sign: float, epoch: Epoch
    ) -> float | None:
        """Return the end of a row, unless it can only be a gap within it: gaps look like ends."""
        if ahead_m is None:
            return None
        frame = self._frame(epoch)
        off_m = (at_m - sign * ahead_m / frame.stretch - frame.along_m) * frame.stretch
        along_m2 = self.pose.ekf.project(moved_row(frame.forward, epoch))[1]
        sigma_m = math.sqrt(along_m2 + line.range_std_m**2)
        if abs(off_m) <= max(GAP_M, model.RANGE_GATE_SIGMA * sigma_m):
            return ahead_m
        self.pose.rejected["gap in the row"] += 1
        return None

    def ageing(self, dt_s: float, turn_abs_rad: float) -> Sequence[tuple[int, float, float]]:
        """Say how the lasting error ages, and what is known of the row from those before it."""
        ageing = []
        if self._bias_std_m is not None:
            lasting_m = self.pose.line_noise.offset_ratio * self._bias_std_m
            ageing.append(_fade(ROW_BIAS, lasting_m, dt_s / model.LASTING_MEMORY_S))
        if self.pose.ekf.cov[ROW_OFFSET, ROW_OFFSET]:
            ageing.append(_fade(ROW_OFFSET, self.pose.field.row_map_std_m, dt_s / ROW_MEMORY_S))
        return ageing

    def _line(self, line: RowLine, sign: float, epoch: Epoch) -> Measurements:
        offset_m, heading_rad = line.offset_m, line.heading_rad
        if offset_m is None or heading_rad is None:
            return
        since_last_s = min(line.t_s - self._last_line_s, model.LASTING_MEMORY_S)
        self._last_line_s = line.t_s
        self._begin(line)
        frame = self._frame(epoch, self._arm_m(line, epoch))
        self._enter(frame.row)
        off_m = self._off_m(line, offset_m, sign, epoch, frame)
        turned_rad = self._turned_rad(heading_rad, sign, epoch, frame)
        self.pose.line_noise.add(line, off_m, turned_rad)
        line = self.pose.line_noise.widen(line)
        measured = self._offset(line, off_m, sign, epoch, frame)
        if measured is None or (yield measured) != "accept":
            return
        self.pose.agreement.hold(line.t_s)
        self.pose.lines.fit()
        frame = self._frame(epoch, self._arm_m(line, epoch))  # as the offset has moved the pose
        self.fitted += abs(offset_m) <= frame.pitch_m / 2.0
        turned_rad = self._turned_rad(heading_rad, sign, epoch, frame)
        variance = model.heading_variance(line.heading_std_rad, since_last_s)
        yield self._heading(turned_rad, variance)

    def _begin(self, line: RowLine) -> None:
        self.pose.look_at_rows()
        if self._bias_std_m is None:
            self._bias_std_m = model.LASTING_RATIO * line.offset_std_m
            self.pose.ekf.reset(ROW_BIAS, 0.0, self._bias_std_m**2)

    def _enter(self, row: int) -> None:
        """Doubt anew how far a row stands beside its map: each was sown by itself."""
        if row == self._row:
            return
        if self._row is not None and self.pose.ekf.cov[ROW_OFFSET, ROW_OFFSET]:
            self.pose.ekf.inflate(ROW_OFFSET, self.pose.field.row_map_std_m**2)
        self._row = row
        self.pose.agreement.enter_row()

    def _yaw_then_rad(self, epoch: Epoch) -> float:
        return self.pose.ekf.x[YAW] - (epoch.now.yaw_rad - epoch.then.yaw_rad)

    def _facing(self, frame: RowFrame, epoch: Epoch) -> float:
        return 1.0 if math.cos(self._yaw_then_rad(epoch) - frame.yaw_rad) >= 0.0 else -1.0

    def _arm_m(self, line: RowLine, epoch: Epoch) -> tuple[float, float]:
        """Return the vector from the robot to the place ahead where the line's offset applies."""
        yaw_rad = self._yaw_then_rad(epoch)
        return line.at_ahead_m * math.cos(yaw_rad), line.at_ahead_m * math.sin(yaw_rad)

    def _frame(self, epoch: Epoch, arm_m: tuple[float, float] = (0.0, 0.0)) -> RowFrame:
        """Return the place among the rows of the robot, or of a point `arm_m` from it."""
        x, (then, now, _) = self.pose.ekf.x, epoch
        return self.pose.rows.at(
            x[X] - (now.x_m - then.x_m) + arm_m[0], x[Y] - (now.y_m - then.y_m) + arm_m[1]
        )

    def _off_m(
        self, line: RowLine, offset_m: float, sign: float, epoch: Epoch, frame: RowFrame
    ) -> float:
        """Return how far right of its pose the line puts the robot, by the nearest row."""
        (arm_x, arm_y), aside_m = self._arm_m(line, epoch), sign * offset_m
        right_x, right_y = frame.right
        return self._frame(epoch, (arm_x + aside_m * right_x, arm_y + aside_m * right_y)).off_m

    def _turned_rad(self, heading_rad: float, sign: float, epoch: Epoch, frame: RowFrame) -> float:
        """Return the angle by which the line turns the robot's heading against its pose."""
        facing_rad = frame.yaw_rad + (0.0 if sign > 0.0 else math.pi)
        return wrap_rad(heading_rad + facing_rad - self._yaw_then_rad(epoch))

    def _offset(
        self, line: RowLine, off_m: float, sign: float, epoch: Epoch, frame: RowFrame
    ) -> Measurement | None:
        """Measure the distance from its row; None where the pose does not determine the row."""
        ekf = self.pose.ekf
        arm_m = self._arm_m(line, epoch)
        seen: Row = ((ROW_BIAS, -sign), (ROW_OFFSET, -1.0))
        row: Row = (*moved_row(frame.right, epoch, arm_m), *seen)
        across_m2 = ekf.project(row[:3])[1]
        if not self._determines_row(off_m, math.sqrt(across_m2), frame.pitch_m):
            self.pose.rejected["row line ambiguous"] += 1
            return None
        self.pose.agreement.add_look(line.t_s, off_m)
        if not self.pose.start_agreement.is_over:
            self._add_to_start(line, off_m, frame, epoch)
        self.pose.lines.add(self._pose_line(line, off_m, frame))
        if self.pose.lines.led is not None and not self.pose.agreement.bears_out(line.t_s, off_m):
            self.pose.rejected["row line moved aside"] += 1
            return None
        return Measurement(
            (off_m + sign * ekf.x[ROW_BIAS] + ekf.x[ROW_OFFSET],), (row,),
            model.offset_variance(line.offset_std_m), self._offset_gate,
            opens=self._blame(line.t_s, off_m, frame), is_retaken=False, has_tails=True,
        )  # fmt: skip

    def _add_to_start(self, line: RowLine, off_m: float, frame: RowFrame, epoch: Epoch) -> None:
        """Claim where the line has the robot, across the rows, for the check of its start."""
        ekf, right = self.pose.ekf, complex(*frame.right)
        turned_m = line.at_ahead_m * math.sqrt(ekf.cov[YAW, YAW])
        self.pose.start_agreement.add_look(
            complex(ekf.x[X], ekf.x[Y]) + off_m * right,
            math.hypot(line.offset_std_m, turned_m),
            complex(epoch.now.x_m, epoch.now.y_m),
            right,
        )

    def _blame(self, t_s: float, off_m: float, frame: RowFrame) -> tuple[tuple[int, float], ...]:
        """Say what a run of lines that do not fit speaks against: the map, or else the pose."""
        if self.pose.lines.is_doubted and not self.pose.agreement.bears_out(t_s, off_m):
            return ()  # the camera, if anything
        has_offset = bool(self.pose.ekf.cov[ROW_OFFSET, ROW_OFFSET])
        if has_offset and self.pose.agreement.agrees_with_fixes(t_s):
            return ((ROW_OFFSET, model.RECOVERY_OFFSET_M**2),)
        return (*_opens(frame.right, model.RECOVERY_OFFSET_M), (YAW, model.RECOVERY_YAW_RAD**2))

    def _pose_line(self, line: RowLine, off_m: float, frame: RowFrame) -> PosedLine:
        """Return the line at the pose that the filter has now."""
        ekf, offset_m, heading_rad = self.pose.ekf, line.offset_m or 0.0, line.heading_rad or 0.0
        x, cov = ekf.x, ekf.cov
        return PosedLine(
            t_s=line.t_s, row=frame.row, off_m=off_m,
            std_m=math.sqrt(model.offset_variance(line.offset_std_m)),
            left_m=offset_m - line.at_ahead_m * math.sin(heading_rad), heading_rad=heading_rad,
            heading_std_rad=line.heading_std_rad, ahead_m=line.at_ahead_m,
            place_m=complex(x[X], x[Y]), yaw_rad=x[YAW], right=complex(*frame.right),
            slip_rad=x[SLIP] * ekf.slip_ratio(x[YAW]),
            lost_ratio=clamp(x[WHEEL_SCALE], -MAX_LOST_RATIO, MAX_LOST_RATIO),
            course_std_rad=math.sqrt(cov[YAW, YAW] + cov[SLIP, SLIP]),
        )  # fmt: skip

    def _determines_row(self, off_m: float, std_m: float, pitch_m: float) -> bool:
        """Whether the pose determines a line's row; a rest of doubt goes to its identity."""
        if std_m <= model.DISTINCT_ROWS_RATIO * pitch_m:
            return True
        left, right = model.neighbour_shares(off_m, std_m, pitch_m)
        if left + right > 1.0 - model.SURE_RATIO:
            return False
        self.pose.identity.doubt_by(left, right)
        return True

    def _heading(self, turned_rad: float, variance: float) -> Measurement:
        """Return the line's direction in the map, less the angle at which the robot sees it."""
        return Measurement(
            (turned_rad,), (((YAW, 1.0),),), variance, self._heading_gate,
            opens=((YAW, model.RECOVERY_YAW_RAD**2),), has_tails=True,
        )  # fmt: skip

    def _range(self, along_then_m: float, std_m: float, epoch: Epoch) -> Measurement:
        """Place along the row, from its first or last plant."""
        frame = self._frame(epoch)
        return Measurement(
            ((along_then_m - frame.along_m) * frame.stretch,), (moved_row(frame.forward, epoch),),
            std_m**2, self._range_gate, opens=_opens(frame.forward, model.RECOVERY_RANGE_M),
        )  # fmt: skip


def _ends(frame: RowFrame, sign: float) -> tuple[float, float]:
    """Distances of the first and the last plant along the row, as the robot drives."""
    return (0.0, frame.length_m) if sign > 0.0 else (frame.length_m, 0.0)


def _fade(state: int, std_m: float, part: float) -> tuple[int, float, float]:
    """Let an error keep its spread and forget its value after `part` = 1."""
    factor = math.exp(-part)
    return state, factor, std_m**2 * (1.0 - factor * factor)


def _opens(direction: tuple[float, float], by_m: float) -> tuple[tuple[int, float], ...]:
    """Return the variances of a position that may be wrong by `by_m` in a direction."""
    return tuple((state, (part * by_m) ** 2) for state, part in zip((X, Y), direction, strict=True))


def moved_row(
    direction: tuple[float, float], epoch: Epoch, arm_m: tuple[float, float] = (0.0, 0.0)
) -> Row:
    """Say how the place of a moment ago, or a point `arm_m` from it, follows from the pose now.

    The place is that in a direction of the map.
    """
    (dx, dy), (then, now, _) = direction, epoch
    moved_x, moved_y = now.x_m - then.x_m - arm_m[0], now.y_m - then.y_m - arm_m[1]
    return ((X, dx), (Y, dy), (YAW, dx * moved_y - dy * moved_x))
