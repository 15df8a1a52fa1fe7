"""Velocity of the GNSS antenna: it shows the heading, what wheels lose, and where that leads."""

from __future__ import annotations

import math
from typing import NamedTuple

from agribot.autonomy.estimate.filter.ekf import SLIP, WAY_X, WAY_Y, WHEEL_SCALE, YAW, Row
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.autonomy.estimate.filter.history import Epoch, Motion
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.filter.models import antenna_velocity, velocity_variance
from agribot.autonomy.estimate.filter.sensor_ranges import MAX_SPEED_MPS
from agribot.autonomy.estimate.sensors.correction import Measurements
from agribot.autonomy.estimate.sensors.gnss_noise import VelocityNoise
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.witnesses.antenna_watch import AntennaWatch
from agribot.autonomy.estimate.witnesses.carry_watch import CarryWatch
from agribot.autonomy.estimate.witnesses.lost_way import (
    LOST_MPS,
    LOST_S,
    STILL_SIGMA2,
    LedVelocity,
    are_fixes_vague,
    can_be_of_wheels,
    find_beyond_wheels,
    have_lost_way,
)
from agribot.autonomy.estimate.witnesses.spin_watch import (
    SpinWatch,
    ahead_and_aside,
    doubts,
    moves_against,
)
from agribot.autonomy.estimate.witnesses.velocity_way import MAX_GAP_S, VelocityWay
from agribot.core.facts import WheelsSlip
from agribot.core.messages import GnssFix
from agribot.core.pose import Pose2

SWAY_FACTOR = 2.0  # margin over how fast a tilting robot moves its antenna
SPUN_S = 5.0  # duration of the report on wheels that slipped


def has_usable_velocity(fix: GnssFix) -> bool:
    """Return whether a fix has a velocity with valid numbers."""
    if fix.velocity_mps is None:
        return False
    values = (*fix.velocity_mps[:2], fix.velocity_std_mps)
    return all(abs(value) <= MAX_SPEED_MPS for value in values)


class _Seen(NamedTuple):
    """A velocity, east and north, of an antenna ahead and left in a robot moving like `then`."""

    t_s: float
    velocity_mps: tuple[float, float]
    std_mps: float
    then: Motion
    yaw_rad: float
    lever_m: tuple[float, float]


class GnssVelocity:
    """Compares the course over ground with where wheels and gyro say that the antenna goes."""

    def __init__(self, pose: PoseFilter) -> None:
        self._pose = pose
        self.noise, self.way = VelocityNoise(), VelocityWay()
        # Spinning wheels falsify the position with every metre, so they are admitted sooner.
        self._spin_after = max(2, pose.config.recover_after // 3)
        self._gate = Gate(pose.config.gate_sigma, self._spin_after, "velocity outlier")
        self._spin_watch = SpinWatch(self._spin_after)
        self._spun_t_s, self._spun_mps = -math.inf, (0.0, 0.0)
        self.carry, self.antenna = CarryWatch(), AntennaWatch()
        self._last_mark: LedVelocity | None = None
        self._lost_t_s = -math.inf
        self._lever_m: tuple[float, float] | None = None
        self._sway_mps = 0.0

    def spin_fault(self, t_s: float) -> WheelsSlip | None:
        """Find that wheels turn and the robot hardly moves, or did so a moment ago."""
        return None if t_s - self._spun_t_s > SPUN_S else WheelsSlip(*self._spun_mps)

    def measure(
        self,
        fix: GnssFix,
        since_last_s: float,
        lever_m: tuple[float, float],
        epoch: Epoch,
        *,
        is_corrected: bool,
        is_float: bool,
    ) -> Measurements:
        """Yield what a velocity shows, beside positions with or without corrections."""
        if fix.velocity_mps is None:
            return
        ekf, (then, now, _) = self._pose.ekf, epoch
        yaw_rad = ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        seen = _Seen(fix.t_s, fix.velocity_mps[:2], fix.velocity_std_mps, then, yaw_rad, lever_m)
        measured = self._compare(seen, since_last_s, is_corrected=is_corrected)
        rate_radps = then.yaw_rate_radps
        is_vague = are_fixes_vague(rate_radps, is_corrected=is_corrected, is_float=is_float)
        way = self._lead(measured, seen, is_vague=bool(is_vague))
        if way is not None:
            yield way
            ekf.forget_way()
        if way is not None or measured.must_open:
            # a robot whose wheels lose their way slides aside, too: no sign of a wrong heading
            opens = tuple(each for each in measured.opens if each[0] != YAW)
            measured = measured._replace(opens=opens)
        yield measured
        if not is_corrected:
            return
        antenna_m = complex(*self._pose.place(epoch).transform(*lever_m))
        self.way.add(fix.t_s, complex(*seen.velocity_mps), antenna_m, self.noise.sure_mps)

    def _compare(self, seen: _Seen, since_last_s: float, *, is_corrected: bool) -> Measurement:
        """Hold a velocity against how wheels and gyro have the antenna move just then."""
        ekf, yaw_rad = self._pose.ekf, seen.yaw_rad
        rate_radps, wheel_mps = seen.then.yaw_rate_radps, seen.then.wheel_mps
        east_mps, north_mps, (east_row, north_row) = antenna_velocity(
            yaw_rad, ekf.row_yaw_rad, ekf.x[WHEEL_SCALE], ekf.x[SLIP], wheel_mps,
            rate_radps, seen.lever_m,
        )  # fmt: skip
        residuals = (seen.velocity_mps[0] - east_mps, seen.velocity_mps[1] - north_mps)
        self.noise.add(residuals, seen.std_mps)
        variance = velocity_variance(seen.std_mps, self.noise.std_mps, rate_radps, since_last_s)
        claimed_mps, _ = ahead_and_aside((east_mps, north_mps), yaw_rad)
        missing_mps = ahead_and_aside(residuals, yaw_rad)
        self.antenna.add(missing_mps, rate_radps, math.sqrt(variance), since_last_s)
        sway_mps = self._find_sway_mps(seen.lever_m, since_last_s)
        std_mps = math.hypot(math.sqrt(variance), SWAY_FACTOR * sway_mps)
        spins = bool(self._spin_watch.is_spinning(claimed_mps, missing_mps, std_mps))
        is_steady = self.noise.is_steady
        spins = spins and self.noise.is_known and is_steady
        if spins:
            self._pose.rejected["wheels spin"] += 1
            self._note_spin(seen, claimed_mps, missing_mps, math.sqrt(variance))
        opened = doubts(
            residuals, (east_mps, north_mps), yaw_rad, self._spin_watch.aside_mps,
            (wheel_mps, rate_radps), since_last_s * self._spin_after, is_corrected=is_corrected,
        ) if is_steady else ()  # fmt: skip
        return Measurement(
            residuals, (_velocity_row(east_row), _velocity_row(north_row)), variance,
            self._gate, opens=tuple((state, doubt**2) for state, doubt in opened),
            is_retaken=is_steady, must_open=spins,
        )  # fmt: skip

    def _find_sway_mps(self, lever_m: tuple[float, float], since_last_s: float) -> float:
        """Find how fast a robot that tilts moves its antenna; it fades as the means do."""
        before_m, self._lever_m = self._lever_m or lever_m, lever_m
        sway_mps = math.dist(before_m, lever_m) / since_last_s if since_last_s > 0.0 else 0.0
        faded_mps = self._sway_mps + (sway_mps - self._sway_mps) / self._spin_after
        self._sway_mps = max(sway_mps, faded_mps)
        return self._sway_mps

    def _note_spin(
        self, seen: _Seen, claimed_mps: float, missing_mps: tuple[float, float], std_mps: float
    ) -> None:
        """Note wheels that turn in vain, not those of a robot that hands move."""
        shown_mps = claimed_mps + missing_mps[0]
        driven = (seen.then.wheel_mps, seen.then.yaw_rate_radps)
        _, aside_mps = find_beyond_wheels((shown_mps, missing_mps[1]), driven, std_mps)
        if not aside_mps and not moves_against(claimed_mps, shown_mps):
            self._spun_t_s, self._spun_mps = seen.t_s, (claimed_mps, shown_mps)

    def _lead(self, measured: Measurement, seen: _Seen, *, is_vague: bool) -> Measurement | None:
        """Measure the way from the last velocity, where wheels have lost theirs; None elsewhere."""
        last, then, lever_m = self._last_mark, seen.then, seen.lever_m
        arm_m = complex(*Pose2(0.0, 0.0, seen.yaw_rad).rotate(*lever_m))
        velocity_mps = complex(*seen.velocity_mps)
        mark = self._last_mark = LedVelocity(
            seen.t_s, velocity_mps, complex(then.x_m, then.y_m) + arm_m
        )
        step_s = math.inf if last is None else mark.t_s - last.t_s
        if last is None or step_s > MAX_GAP_S:
            return None
        mean_mps = (last.velocity_mps + velocity_mps) / 2.0
        off_mps = mean_mps - (mark.led_m - last.led_m) / step_s
        off_ahead_mps, _ = ahead_and_aside((off_mps.real, off_mps.imag), seen.yaw_rad)
        ahead_mps, aside_mps = ahead_and_aside((mean_mps.real, mean_mps.imag), seen.yaw_rad)
        rate_radps, is_steady = then.yaw_rate_radps, self.noise.is_steady
        shown_mps = (ahead_mps + rate_radps * lever_m[1], aside_mps - rate_radps * lever_m[0])
        variance = velocity_variance(seen.std_mps, self.noise.std_mps, 0.0, step_s)
        if have_lost_way(off_ahead_mps, measured.variance, is_steady=is_steady):
            self._lost_t_s = seen.t_s
        is_lost = (
            seen.t_s - self._lost_t_s <= LOST_S and abs(off_mps) ** 2 > STILL_SIGMA2 * variance
        )
        driven, std_mps = (then.wheel_mps, rate_radps), math.sqrt(variance)
        if is_steady:
            self.carry.add(seen.t_s, step_s, shown_mps, driven, std_mps)
        if not ((is_vague or is_lost) and can_be_of_wheels(shown_mps, driven, std_mps)):
            return None
        self._pose.ekf.doubt_way((LOST_MPS * step_s) ** 2)
        east, north = measured.rows
        rows = ((*east, (WAY_X, 1.0 / step_s)), (*north, (WAY_Y, 1.0 / step_s)))
        return Measurement((off_mps.real, off_mps.imag), rows, variance)


def _velocity_row(by: tuple[float, ...]) -> Row:
    return (YAW, by[0]), (WHEEL_SCALE, by[1]), (SLIP, by[2])
