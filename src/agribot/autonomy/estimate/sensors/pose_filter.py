"""What all corrections of the pose share: the filter, the motion behind it, the rows, the start."""

from __future__ import annotations

import math
from collections import Counter

from agribot.autonomy.estimate.filter.ekf import ROW_BIAS, ROW_OFFSET, YAW, Ekf, X, Y
from agribot.autonomy.estimate.filter.field_rows import FieldRows, Rows
from agribot.autonomy.estimate.filter.gate import Verdict
from agribot.autonomy.estimate.filter.history import Epoch, MotionHistory
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.filter.priors import initial_std
from agribot.autonomy.estimate.filter.start import StartMark
from agribot.autonomy.estimate.sensors.first_heading import FirstHeading, Known
from agribot.autonomy.estimate.sensors.row_line_noise import RowLineNoise
from agribot.autonomy.estimate.witnesses.row_agreement import RowAgreement
from agribot.autonomy.estimate.witnesses.row_identity import RowIdentity
from agribot.autonomy.estimate.witnesses.row_line_watch import RowLineWatch
from agribot.autonomy.estimate.witnesses.start_agreement import StartAgreement
from agribot.autonomy.estimate.witnesses.turn_watch import TurnWatch
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.messages import BaseFix, Vec3
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec


class PoseFilter:
    """The Kalman filter and what surrounds it; every correction is given this one object.

    `rejected` counts, by cause, every sample that did not enter the filter. `known` is what has
    been measured once, `up_body` the vertical in body axes, `base` what a receiver at a known place
    said last.
    """

    def __init__(
        self, config: EstimateConfig, field: FieldConfig, robot: RobotSpec, ekf: Ekf | None = None
    ) -> None:
        self.config, self.field, self.robot = config, field, robot
        self.ekf = ekf or Ekf(initial_std(config), math.radians(field.row_yaw_deg))
        self.history = MotionHistory(ahead_s=config.wheel_timeout_s)
        self.rejected: Counter[str] = Counter()
        self.start = StartMark.of(field)
        self.start_agreement = StartAgreement(self.start, field)
        self.rows: Rows = FieldRows(field)
        self.agreement, self.identity = RowAgreement(), RowIdentity(config.row_certainty)
        self.lines = RowLineWatch(config.position_walk_m_per_sqrt_m)
        self.line_noise = RowLineNoise()
        self.turns = TurnWatch(config.mag_bias_std_rad)
        self.known: set[Known] = set()
        self.first_heading = FirstHeading(
            self.ekf, self.start, self.known, has_compass=robot.mag is not None
        )
        self.up_body: Vec3 = (0.0, 0.0, 1.0)
        self.base: BaseFix | None = None
        self.is_receiver_frozen = False  # its heading of two antennas is then an old one, too

    def take_rows(self, rows: Rows) -> None:
        """Go over to other rows; what was learnt of those before is past."""
        self.rows = rows
        self.ekf.row_yaw_rad = rows.yaw_rad
        self.ekf.reset(ROW_OFFSET, 0.0, 0.0)
        self.agreement.forget()
        self.lines.forget()
        self.identity.restart()

    def place(self, epoch: Epoch) -> Pose2:
        """Say where the robot was at an epoch, as the filter sees it now."""
        x, (then, now, _) = self.ekf.x, epoch
        yaw_rad = x[YAW] - (now.yaw_rad - then.yaw_rad)
        return Pose2(x[X] - (now.x_m - then.x_m), x[Y] - (now.y_m - then.y_m), yaw_rad)

    @property
    def rows_off_m(self) -> tuple[float, float]:
        """Offset of the rows from the map, East and North."""
        x = self.ekf.x
        right_x, right_y = self.rows.at(x[X], x[Y]).right
        return x[ROW_OFFSET] * right_x, x[ROW_OFFSET] * right_y

    def look_at_rows(self) -> None:
        """Doubt from now on that rows stand where the map has them: they are looked at."""
        if self.field.row_map_std_m and not self.ekf.cov[ROW_OFFSET, ROW_OFFSET]:
            self.ekf.reset(ROW_OFFSET, 0.0, self.field.row_map_std_m**2)

    def doubt_rows(self, off_m: float, turned_rad: float) -> None:
        """Add the variance of wrong looks at the rows, which may have led the pose this far off."""
        for state, std in ((X, off_m), (Y, off_m), (YAW, turned_rad)):
            self.ekf.inflate(state, std**2)
        self.ekf.reset(ROW_BIAS, 0.0, float(self.ekf.cov[ROW_BIAS, ROW_BIAS]))
        if self.ekf.cov[ROW_OFFSET, ROW_OFFSET]:
            self.ekf.reset(ROW_OFFSET, 0.0, self.field.row_map_std_m**2)
        self.agreement.release()
        self.lines.forget()

    def correct(self, measured: Measurement) -> Verdict:
        """Let a measurement through its gate, or count that it was rejected."""
        gate, distance2 = measured.gate, 0.0
        if gate is None:
            self.open_for(measured)
            return "accept"
        if measured.is_judged_first:
            distance2 = self._distance2(measured)
        else:
            distance2 = self._take(measured, measured.variance, gate.limit)
        verdict = gate.evaluate(distance2)
        if verdict == "accept" and measured.is_judged_first:
            self._take(measured, measured.taken_variance(distance2))
        if verdict == "recover" and gate.recovery:
            self.rejected[gate.recovery] += 1
        if verdict == "recover" or measured.must_open:
            self.open_for(measured, distance2)
        elif verdict == "reject":
            self.rejected[gate.outlier] += 1
        return verdict

    def open_for(self, measured: Measurement, distance2: float = 0.0) -> None:
        """Trust the states less that a measurement blames, then take it, whatever its residual."""
        for state, variance in measured.opens:
            self.ekf.inflate(state, variance)
        if measured.is_retaken:
            self._take(measured, measured.taken_variance(distance2))

    def _distance2(self, measured: Measurement) -> float:
        """Squared distance of the worst residual."""
        pairs = zip(measured.rows, measured.residuals, strict=True)
        return max(self.ekf.distance2(row, off, measured.variance) for row, off in pairs)

    def _take(self, measured: Measurement, variance: float, limit: float = math.inf) -> float:
        """Correct with what lies within a limit; the squared distance of the last residual."""
        rows, residuals, distance2 = measured.rows, measured.residuals, 0.0
        if len(rows) == 2 and not measured.is_judged_first:
            return self.ekf.update_pair(rows, residuals, variance, limit)
        for row, residual in zip(rows, residuals, strict=True):
            distance2 = self.ekf.update(row, residual, variance, limit)
        return distance2
