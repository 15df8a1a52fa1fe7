"""Extended Kalman filter of the pose and of what sensors get wrong, in plain NumPy.

The state is a list of floats and the covariance one array that is only ever changed in place:
at 100 predictions a second the arithmetic is free and the Python around it is the cost.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from agribot.autonomy.estimate.filter.models import motion, pair_distance2, walk_across
from agribot.autonomy.estimate.filter.slope import SLIDE_STD_RATIO
from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray
from agribot.core.pose import Pose2

STATES = 14
(
    X, Y, YAW, GYRO_BIAS, WHEEL_SCALE, SLIP, GYRO_SCALE,
    GNSS_BIAS_X, GNSS_BIAS_Y, MAG_BIAS, ROW_BIAS, ROW_OFFSET, WAY_X, WAY_Y,
) = range(STATES)  # fmt: skip

# One row of the measurement matrix, without its zeros: (state, coefficient) pairs.
Row = tuple[tuple[int, float], ...]


class MotionNoise(msgspec.Struct, frozen=True, kw_only=True):
    """Variance that motion adds, per metre, radian and second, so that the rate cannot matter.

    Wheels roll along but are pushed aside: the walk across the way is the larger one.
    """

    along_m2_per_m: float
    across_m2_per_m: float
    position_m2_per_rad: float
    yaw_rad2_per_s: float


# Least turn of one step; a robot that hardly turns does not slide.
TURN_FLOOR_RAD = 1e-6


class Ekf:
    """The filter of the pose and of what sensors get wrong.

    States: x_map_m, y_map_m, yaw_map_rad, gyro bias (rad/s), wheel scale (share of the wheel
    speed lost), slip, gyro scale (share that it reads too high), GNSS bias east and north (m),
    magnetometer bias (rad), offset of the row sensor (m, to the left of the robot), offset of the
    field's rows from the map (m, to the right of the rows), error of the way by wheels and gyro
    since the receiver's last velocity, east and north (m): 0 except while a velocity measures that
    way better (`doubt_way`).

    Slip belongs to the slope, so its sign is kept in the map and not in the body: driving along
    the rows in either direction the robot crabs to the same side of the field. In the body it is
    `slip * cos(yaw - row_yaw)`, and it points the same way in reverse.
    """

    def __init__(self, std: Sequence[float], row_yaw_rad: float) -> None:
        self.x: list[float] = [0.0] * STATES
        """States beyond those of `std` are known to be 0."""
        self.cov = np.zeros((STATES, STATES))
        self.cov[range(len(std)), range(len(std))] = np.square(np.asarray(std, dtype=np.float64))
        self.row_yaw_rad = row_yaw_rad
        # F = I + A, and A has only rows 0-2 and columns 2-6.
        self._a = np.zeros((3, 5))
        self._top, self._middle = self.cov[:3], self.cov[2:7]
        self._top_middle, self._top_right = self.cov[:3, 2:7], self.cov[:3, 3:]
        self._corner, self._bottom_left = self.cov[:3, :3], self.cov[3:, :3]
        self._fp, self._fpa = np.empty((3, STATES)), np.empty((3, 3))
        self._outer = np.empty((STATES, STATES))

    def relax(self, changes: Iterable[tuple[int, float, float]]) -> None:
        """Age states: each (state, factor, variance) is multiplied by the factor, then grows."""
        for state, factor, variance in changes:
            self.x[state] *= factor
            self.cov[state] *= factor
            self.cov[:, state] *= factor
            self.inflate(state, variance)

    def inflate(self, state: int, variance: float) -> None:
        self.cov[state, state] += variance

    def reset(self, state: int, value: float, variance: float) -> None:
        """Forget a state and its correlations."""
        self.x[state] = value
        self.cov[state] = 0.0
        self.cov[:, state] = 0.0
        self.cov[state, state] = variance

    def doubt_way(self, variance_m2: float) -> None:
        """Add variance to the last way, whose error is also one of the position."""
        for place, way in ((X, WAY_X), (Y, WAY_Y)):
            self._doubt_together(place, way, variance_m2, variance_m2)

    def doubt_fixes(self, ratio: float) -> None:
        """Scale the variance of fixes, and of the position that they gave, by `ratio`.

        A position that is known better than by fixes, from a mark or a row, hardly changes.
        """
        for place, bias in ((X, GNSS_BIAS_X), (Y, GNSS_BIAS_Y)):
            variance_m2 = (ratio - 1.0) * self.cov[place, place]
            self._doubt_together(place, bias, variance_m2, -variance_m2)

    def _doubt_together(self, place: int, other: int, variance_m2: float, shared_m2: float) -> None:
        """Doubt a coordinate and another state alike, with this covariance between them."""
        self.inflate(place, variance_m2)
        self.inflate(other, variance_m2)
        self.cov[place, other] += shared_m2
        self.cov[other, place] += shared_m2

    def forget_way(self) -> None:
        """Begin another way, which is believed."""
        for way in (WAY_X, WAY_Y):
            self.reset(way, 0.0, 0.0)

    def slip_ratio(self, yaw_map_rad: float) -> float:
        """Share of the slip state that acts sideways at a heading."""
        return math.cos(yaw_map_rad - self.row_yaw_rad)

    def predict(
        self,
        distance_m: float,
        turn_rad: float,
        dt_s: float,
        noise: MotionNoise,
        slide_m: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[float, float, float]:
        """Move by what wheels and gyro measured over `dt_s`, and slide forward and left as well.

        Returns: the step after the corrections for bias, scale and slip: x, y and yaw, map frame.
        """
        x = self.x
        measured_rad, turn_s = turn_rad - x[GYRO_BIAS] * dt_s, (1.0 - x[GYRO_SCALE]) * dt_s
        turned_rad = measured_rad - x[GYRO_SCALE] * measured_rad
        dx_m, dy_m, (x_row, y_row) = motion(
            x[YAW] + turned_rad / 2.0, self.row_yaw_rad, x[WHEEL_SCALE], x[SLIP],
            distance_m, measured_rad, turn_s,
        )  # fmt: skip
        xx_m2, yy_m2, xy_m2 = walk_across(
            dx_m, dy_m, distance_m, noise.across_m2_per_m - noise.along_m2_per_m
        )
        slide_m2 = slide_m[0] ** 2 + slide_m[1] ** 2
        if slide_m2:
            slide_x_m, slide_y_m = Pose2(0.0, 0.0, x[YAW]).rotate(*slide_m)
            dx_m, dy_m = dx_m + slide_x_m, dy_m + slide_y_m
        x[X] += dx_m
        x[Y] += dy_m
        x[YAW] = wrap_rad(x[YAW] + turned_rad)
        a = self._a
        a[X], a[Y], a[YAW, 1], a[YAW, 4] = x_row, y_row, -turn_s, -measured_rad
        self._propagate()
        position_m2 = noise.along_m2_per_m * abs(distance_m)
        position_m2 += noise.position_m2_per_rad * abs(turned_rad)
        if slide_m2:
            position_m2 += SLIDE_STD_RATIO**2 * slide_m2 / max(abs(turn_rad), TURN_FLOOR_RAD)
        self.inflate(X, position_m2 + xx_m2)
        self.inflate(Y, position_m2 + yy_m2)
        self.cov[X, Y] += xy_m2
        self.cov[Y, X] += xy_m2
        self.inflate(YAW, noise.yaw_rad2_per_s * dt_s)
        return dx_m, dy_m, turned_rad

    def _propagate(self) -> None:
        """P <- F P F^T, touching the first three rows and columns only."""
        self._a.dot(self._middle, self._fp)  # a third of the cost of np.matmul on so few numbers
        self._top += self._fp
        self._top_middle.dot(self._a.T, self._fpa)
        self._corner += self._fpa
        self._bottom_left[:] = self._top_right.T

    def project(self, row: Row) -> tuple[FloatArray, float]:
        """P H^T (STATES,) and H P H^T."""
        cov = self.cov
        state, weight = row[0]
        projected = cov[state] * weight
        for state, weight in row[1:]:
            projected += cov[state] * weight
        variance = 0.0
        for state, weight in row:
            variance += weight * projected.item(state)
        return projected, variance

    def distance2(self, row: Row, residual: float, variance: float) -> float:
        """Squared normalised innovation of one scalar."""
        return residual**2 / (self.project(row)[1] + variance)

    def update(self, row: Row, residual: float, variance: float, gate: float = math.inf) -> float:
        """Correct with one scalar unless its squared normalised innovation, returned, is > gate."""
        projected, prior = self.project(row)
        total = prior + variance
        distance2 = residual * residual / total
        if distance2 <= gate:
            self._apply(projected, residual, total)
        return distance2

    def update_pair(
        self,
        rows: tuple[Row, ...],
        residuals: tuple[float, ...],
        variance: float,
        gate: float = math.inf,
    ) -> float:
        """Correct with two scalars of equal, independent noise, gated together."""
        (row_0, row_1), (r0, r1) = rows, residuals
        first, prior_0 = self.project(row_0)
        _, prior_1 = self.project(row_1)
        cross = sum(weight * float(first[state]) for state, weight in row_1)
        total_0, total_1 = prior_0 + variance, prior_1 + variance
        distance2 = pair_distance2(r0, r1, total_0, total_1, cross)
        if distance2 <= gate:
            self._apply(first, r0, total_0)
            self.update(row_1, r1 - cross / total_0 * r0, variance)
        return distance2

    def _apply(self, projected: FloatArray, residual: float, total: float) -> None:
        step = residual / total
        pairs = zip(self.x, projected.tolist(), strict=True)
        self.x = [value + part * step for value, part in pairs]
        self.x[YAW] = wrap_rad(self.x[YAW])
        projected /= math.sqrt(total)  # the product below is then exactly symmetric
        np.multiply.outer(projected, projected, out=self._outer)
        self.cov -= self._outer
