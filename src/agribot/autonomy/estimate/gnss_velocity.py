"""Velocity of the GNSS antenna: it shows the heading, and what the wheels lose."""

from __future__ import annotations

import math

from agribot.autonomy.estimate.correction import Measurements
from agribot.autonomy.estimate.ekf import SLIP, WHEEL_SCALE, YAW, Row
from agribot.autonomy.estimate.gate import Gate
from agribot.autonomy.estimate.gnss_noise import VelocityNoise
from agribot.autonomy.estimate.history import Epoch
from agribot.autonomy.estimate.measurement import Measurement
from agribot.autonomy.estimate.models import antenna_velocity, velocity_variance
from agribot.autonomy.estimate.pose_filter import PoseFilter
from agribot.autonomy.estimate.sensor_ranges import MAX_SPEED_MPS
from agribot.autonomy.estimate.spin_watch import SpinWatch, ahead_and_aside, doubts
from agribot.autonomy.estimate.velocity_way import VelocityWay
from agribot.core.arithmetic import FLOATS
from agribot.core.messages import GnssFix

SPUN_S = 5.0  # so long wheels that slipped are named


def has_usable_velocity(fix: GnssFix) -> bool:
    """Whether a fix tells a velocity in numbers that can be."""
    if fix.velocity_mps is None:
        return False
    values = (*fix.velocity_mps[:2], fix.velocity_std_mps)
    return all(abs(value) <= MAX_SPEED_MPS for value in values)


class GnssVelocity:
    """Compares the course over ground with where wheels and gyro say that the antenna goes."""

    def __init__(self, pose: PoseFilter) -> None:
        self._pose = pose
        self.noise, self.way = VelocityNoise(), VelocityWay()
        # Spinning wheels falsify the position with every metre, so they are admitted sooner.
        self._spin_after = max(2, pose.config.recover_after // 3)
        self._gate = Gate(pose.config.gate_sigma, self._spin_after, "velocity outlier")
        self._spin_watch = SpinWatch(FLOATS, self._spin_after)
        self._spun_t_s, self._spun_mps = -math.inf, (0.0, 0.0)

    def spin_fault(self, t_s: float) -> str:
        """Say that wheels turn and the robot hardly moves, or did so a moment ago."""
        if t_s - self._spun_t_s > SPUN_S:
            return ""
        claimed_mps, shown_mps = self._spun_mps
        return (
            f"wheels slip: they turn for {claimed_mps:.2f} m/s, GNSS shows {shown_mps:.2f}; look "
            "whether the robot is stuck or the ground soft"
        )

    def measure(
        self,
        fix: GnssFix,
        since_last_s: float,
        lever_m: tuple[float, float],
        epoch: Epoch,
        *,
        is_corrected: bool,
    ) -> Measurements:
        if fix.velocity_mps is None:
            return
        ekf, (then, now, _) = self._pose.ekf, epoch
        yaw_rad = ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        rate_radps, wheel_mps = then.yaw_rate_radps, then.wheel_mps
        east_mps, north_mps, (east_row, north_row) = antenna_velocity(
            FLOATS, yaw_rad, ekf.row_yaw_rad, ekf.x[WHEEL_SCALE], ekf.x[SLIP], wheel_mps,
            rate_radps, lever_m,
        )  # fmt: skip
        residuals = (fix.velocity_mps[0] - east_mps, fix.velocity_mps[1] - north_mps)
        self.noise.add(residuals, fix.velocity_std_mps)
        variance = velocity_variance(
            FLOATS, fix.velocity_std_mps, self.noise.std_mps, rate_radps, since_last_s
        )
        claimed_mps, _ = ahead_and_aside(FLOATS, (east_mps, north_mps), yaw_rad)
        missing_mps = ahead_and_aside(FLOATS, residuals, yaw_rad)
        spins = bool(self._spin_watch.is_spinning(claimed_mps, missing_mps, math.sqrt(variance)))
        is_steady = self.noise.is_steady
        spins = spins and self.noise.is_known and is_steady
        if spins:
            self._pose.rejected["wheels spin"] += 1
            self._spun_t_s, self._spun_mps = fix.t_s, (claimed_mps, claimed_mps + missing_mps[0])
        opened = doubts(
            FLOATS, residuals, (east_mps, north_mps), yaw_rad, self._spin_watch.aside_mps,
            (wheel_mps, rate_radps), since_last_s * self._spin_after, is_corrected=is_corrected,
        ) if is_steady else ()  # fmt: skip
        yield Measurement(
            residuals, (_velocity_row(east_row), _velocity_row(north_row)), variance,
            self._gate, opens=tuple((state, doubt**2) for state, doubt in opened),
            is_retaken=is_steady, must_open=spins,
        )  # fmt: skip
        if is_corrected:
            antenna_m = complex(*self._pose.place(epoch).transform(*lever_m))
            velocity_mps = complex(*fix.velocity_mps[:2])
            self.way.add(fix.t_s, velocity_mps, antenna_m, self.noise.sure_mps)


def _velocity_row(by: tuple[float, ...]) -> Row:
    return (YAW, by[0]), (WHEEL_SCALE, by[1]), (SLIP, by[2])
