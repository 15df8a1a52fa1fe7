"""Position and velocity of the GNSS antenna as corrections of the filter."""

from __future__ import annotations

import cmath
import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from agribot.autonomy.estimate.filter.ekf import (
    GNSS_BIAS_X,
    GNSS_BIAS_Y,
    SLIP,
    WHEEL_SCALE,
    YAW,
    X,
    Y,
)
from agribot.autonomy.estimate.filter.gate import Gate, Verdict
from agribot.autonomy.estimate.filter.history import Epoch, Motion
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.filter.motion_heading import Course, WayPlace
from agribot.autonomy.estimate.filter.sensor_ranges import MAX_ALT_M, MAX_POS_STD_M
from agribot.autonomy.estimate.sensors.base_correction import take_off_base_error
from agribot.autonomy.estimate.sensors.correction import Correction, Measurements
from agribot.autonomy.estimate.sensors.first_heading import FIRST_STD_RAD
from agribot.autonomy.estimate.sensors.gnss_noise import (
    CORRECTED,
    FLOAT_MEMORY_S,
    FixNoise,
    PositionNoise,
    bias_ageing,
    fix_noise,
    widen,
)
from agribot.autonomy.estimate.sensors.gnss_velocity import GnssVelocity, has_usable_velocity
from agribot.autonomy.estimate.sensors.gnss_wander import GnssWander
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.witnesses.drift_watch import (
    ALARM2,
    MAX_LOST_RATIO,
    DriftWatch,
    Trust,
    WitnessReport,
)
from agribot.autonomy.estimate.witnesses.fix_watch import MAX_JUMP_M, JumpWatch, RepeatWatch
from agribot.autonomy.estimate.witnesses.spin_watch import ahead_and_aside
from agribot.autonomy.estimate.witnesses.start_agreement import FIRST_FIXES
from agribot.autonomy.estimate.witnesses.velocity_way import VelocityMark
from agribot.core.arithmetic import clamp
from agribot.core.facts import FarFromMap
from agribot.core.geo import MapFrame, is_place, rotation_from_rpy
from agribot.core.messages import FloatArray, GnssFix, GnssQuality, SensorBatch, Vec3
from agribot.core.pose import Pose2

UNKNOWN_M2 = 1e6
SUSPICIOUS_REJECTIONS = 5  # rejections in a row
# Largest distance of a first position; a map is flat, and a field is no larger.
MAX_FROM_DATUM_M = 10e3
# Turn rate and turn from which fixes within three sigmas of where velocities lead are right. On the
# straight, swerves and the gyro's noise add up to half of that turn: there they are right where the
# wheels have lost some of their way ahead, but not aside.
VOUCHED_TURN_RADPS, VOUCHED_TURN_RAD, VOUCHED_SIGMA2 = 0.1, 0.1, 9.0


class _Sure(NamedTuple):
    """A fix that was believed: mark of the velocities, way and turns to it, filter's variance."""

    mark: VelocityMark
    driven_m: float
    turned_rad: float
    variance_m2: float


class Gnss(Correction[GnssFix]):
    """Gives the filter its first position, then corrects position, heading and wheel scale.

    A fix speaks of its own epoch: it is compared with where the robot was then, and the
    difference corrects where the robot is now.
    """

    needs = None

    def __init__(self, pose: PoseFilter) -> None:
        super().__init__(pose)
        config, robot = pose.config, pose.robot
        # Offset of the last rejected fix, and sum of the jumps of robot and receiver.
        self.rejected_m, self.moved_m = (0.0, 0.0), (0.0, 0.0)
        self.off_m = (0.0, 0.0)  # offset of the last fix from the filter's position
        self.repeats, self.jump, self.drift = RepeatWatch(), JumpWatch(), DriftWatch()
        self.position_noise, self.velocity = PositionNoise(), GnssVelocity(pose)
        self.wander = GnssWander()
        self._driven_m = self._moved_m = self._turned_rad = self._unguided_m = 0.0
        # Shift of the robot by turning the way that was drawn before the heading was known.
        self._turned_m = 0j
        self._widest_m2 = 0.0  # largest slow error that was believed of the receiver, squared
        self._rejected_fix: Measurement | None = None
        self._receiver_m = (0.0, 0.0)
        self.quality = GnssQuality.NONE
        self.last_t_s = -math.inf
        self._frame = MapFrame(pose.field.datum)
        x_m, y_m, z_m = robot.body_from_link(robot.gnss.link)[:3, 3].tolist()
        self._antenna_body_m: Vec3 = (x_m, y_m, z_m)
        self._half_track_m = robot.drive.track_m / 2.0
        self._position_gate = Gate(config.gate_sigma, config.recover_after, "gnss outlier")
        self._first: list[tuple[float, float]] = []
        self._noise: FixNoise | None = None
        self._is_corrected = self._is_differential = self._is_wide = False
        self._sure: _Sure | None = None
        # Whether the last rejected fix lies where the receiver's own velocities do not lead.
        self.is_disowned = False
        self.elsewhere: FarFromMap | None = None  # first fixes outside this map

    @property
    def rejected_in_a_row(self) -> int:
        return self._position_gate.rejected_in_a_row

    def move(self, distance_m: float, turn_rad: float) -> None:
        """Count a step of the wheels: of the robot's middle, and its turn about it."""
        self._driven_m += abs(distance_m)
        if "yaw" not in self.pose.known:
            self._unguided_m += abs(distance_m)
        self._turned_rad += abs(turn_rad)
        self._moved_m += abs(distance_m) + abs(self._half_track_m * turn_rad)

    def settle(self, *, believes_fixes: bool) -> None:
        """Go on with the fixes that were rejected, or with the pose as it is, as a person decided.

        What speaks against the pose that is kept counts as an error of the receiver.
        """
        if self.drift.is_drifting and believes_fixes:
            for state, off_m in zip((X, Y), self.off_m, strict=True):
                self.pose.ekf.inflate(state, off_m**2)
        elif self.drift.is_drifting:
            self.shift(self.off_m)
        if self._rejected_fix is not None and 0.0 < self.jump.off_m <= MAX_JUMP_M:
            if believes_fixes:
                self._follow(self._rejected_fix)
            else:
                self.shift(_pair(self._rejected_fix.residuals))
        self.forget()

    def forget(self) -> None:
        """Judge fixes anew: a person has decided, or says where the robot is."""
        self.jump.forget()
        self.drift.restart()
        self.velocity.carry.forget()
        self.velocity.antenna.forget()
        self._position_gate.rejected_in_a_row = 0

    def shift(self, by_m: tuple[float, float]) -> None:
        """Add `by_m` to the error that the receiver is believed to have."""
        self._receiver_m = _sum(self._receiver_m, by_m)

    def samples(self, batch: SensorBatch) -> Sequence[GnssFix]:
        return batch.gnss

    def is_usable(self, sample: GnssFix) -> bool:
        is_known = sample.quality is not GnssQuality.NONE and abs(sample.pos_std_m) <= MAX_POS_STD_M
        return is_known and is_place(sample.lat_deg, sample.lon_deg)

    def objection(self, sample: GnssFix) -> str:
        if "position" not in self.pose.known:
            self.elsewhere = self._compare_with_datum(sample)
            if self.elsewhere is not None:
                return "far from the map"
        self.pose.is_receiver_frozen = self.repeats.is_repeat(sample, self._driven_m)
        return "repeats itself" if self.pose.is_receiver_frozen else ""

    def _compare_with_datum(self, fix: GnssFix) -> FarFromMap | None:
        """Find where receiver and map are if they are too far apart."""
        datum = self._frame.datum
        place_m = self._frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, datum.alt_m)
        away_m = math.hypot(*place_m)
        if away_m <= MAX_FROM_DATUM_M:
            return None
        return FarFromMap(
            fix.lat_deg, fix.lon_deg, away_m, datum.lat_deg, datum.lon_deg, MAX_FROM_DATUM_M
        )

    def measure(self, sample: GnssFix, epoch: Epoch) -> Measurements:
        if sample.velocity_mps is not None and not has_usable_velocity(sample):
            self.pose.rejected["velocity not usable"] += 1
            sample = msgspec.structs.replace(sample, velocity_mps=None)
        self.last_t_s, self.quality = sample.t_s, sample.quality
        lever_m = _level(self._antenna_body_m, self.pose.up_body)
        course = _find_course(sample, epoch.then, epoch.then.yaw_rad, lever_m)
        self.pose.first_heading.confirm(course)
        if self.pose.first_heading.wants_fixes:
            self._learn_heading(sample, epoch)
        if not self.pose.first_heading.is_known:
            return
        differential = take_off_base_error(sample, self.pose)
        fix = differential or sample
        self.quality = fix.quality
        is_first = self._noise is None
        since_last_s = FLOAT_MEMORY_S if is_first else min(epoch.since_last_s, FLOAT_MEMORY_S)
        antenna_m, arm_m = self._find_antenna(fix, lever_m, epoch)
        then_m = complex(epoch.then.x_m, epoch.then.y_m)
        self.position_noise.add(fix.t_s, antenna_m - arm_m - then_m, fix.pos_std_m)
        noise = widen(fix_noise(fix, since_last_s), self.position_noise.std_m)
        if fix.quality not in CORRECTED:
            apart_m, is_vouched = antenna_m - arm_m - then_m, differential is not None
            noise = self._learn_wander(fix, apart_m, noise, is_vouched=is_vouched)
        self._noise = noise
        self._follow_quality(noise, differential is not None)
        yield from self._position(fix, noise, (antenna_m, arm_m), epoch)
        if fix.velocity_mps is not None and "position" in self.pose.known:
            yield from self.velocity.measure(
                fix, since_last_s, lever_m, epoch, is_corrected=self._is_corrected,
                is_float=fix.quality is GnssQuality.RTK_FLOAT,
            )  # fmt: skip
        if fix.quality is GnssQuality.RTK_FIXED:
            self._compare_with_camera(fix.t_s)
        self._watch_drift(fix, noise, antenna_m, lever_m, epoch)

    def _learn_wander(
        self, fix: GnssFix, apart_m: complex, noise: FixNoise, *, is_vouched: bool
    ) -> FixNoise:
        """Widen what is believed of a receiver without corrections by what is learnt of it."""
        cov = self.pose.ekf.cov
        lost_ratio = math.sqrt(cov[YAW, YAW] + cov[WHEEL_SCALE, WHEEL_SCALE])
        self.wander.add(fix.t_s, apart_m, self._driven_m, lost_ratio, math.sqrt(noise.variance_m2))
        widened = self._widen(fix, noise, is_vouched=is_vouched)
        if self._is_wide and "position" in self.pose.known:
            # The fixes until now were believed too much.
            self._doubt_pose(max(self._widest_m2, float(widened.bias_std_m) ** 2))
        return widened

    def _widen(self, fix: GnssFix, noise: FixNoise, *, is_vouched: bool = False) -> FixNoise:
        """Widen the noise of a fix; its velocity or a base near by vouch for what it states."""
        is_vouched = is_vouched or fix.velocity_mps is not None
        self._is_wide = self.wander.is_wide(noise, is_vouched=is_vouched)
        return self.wander.widen(noise, is_vouched=is_vouched)

    def _learn_heading(self, fix: GnssFix, epoch: Epoch) -> None:
        """Lay what fixes show of the way over what wheels and gyro drew in their own frame."""
        then, lever_m = epoch.then, _level(self._antenna_body_m, self.pose.up_body)
        # Until the heading is known the arm is in the frame of the odometry, then in the map.
        antenna_m, arm_m = self._find_antenna(fix, lever_m, epoch)
        noise = fix_noise(fix, FLOAT_MEMORY_S)
        if fix.quality not in CORRECTED:
            noise = self._widen(fix, noise)
        place = WayPlace(
            fix.t_s, antenna_m, complex(then.x_m, then.y_m) + arm_m, self._moved_m,
            math.sqrt(noise.variance_m2), noise.bias_std_m, noise.bias_walk_m_per_sqrt_s,
        )  # fmt: skip
        course = _find_course(fix, then, self.pose.place(epoch).yaw_rad, lever_m)
        turn = self.pose.first_heading.add_fix(place, course)
        if turn is not None:
            led_m = complex(epoch.now.x_m, epoch.now.y_m)
            self._turned_m = led_m * (turn - 1.0)

    def ageing(self, dt_s: float, turn_abs_rad: float) -> Sequence[tuple[int, float, float]]:
        return [] if self._noise is None else bias_ageing(self._noise, dt_s)

    def _compare_with_camera(self, t_s: float) -> None:
        """Hold a fix that claims centimetres against what the camera sees of the rows."""
        x, (east_m, north_m) = self.pose.ekf.x, self.off_m
        east, north = self.pose.rows.at(x[X], x[Y]).right
        self.pose.agreement.add_fix(t_s, east_m * east + north_m * north)

    def _watch_drift(
        self,
        fix: GnssFix,
        noise: FixNoise,
        antenna_m: complex,
        lever_m: tuple[float, float],
        epoch: Epoch,
    ) -> None:
        """Hold fixed ambiguities against velocity and wheels; other fixes wander by themselves."""
        drift, velocity_mps, ekf = self.drift, fix.velocity_mps, self.pose.ekf
        if drift.is_drifting:
            return
        if fix.quality is not GnssQuality.RTK_FIXED or velocity_mps is None or self.jump.off_m:
            drift.restart()
            return
        if self.rejected_in_a_row:
            return  # a jump, if anything
        x, (then, now, _) = ekf.x, epoch
        yaw_rad = x[YAW] - (now.yaw_rad - then.yaw_rad)
        slip_rad = x[SLIP] * ekf.slip_ratio(yaw_rad)
        lost_ratio = clamp(x[WHEEL_SCALE], -MAX_LOST_RATIO, MAX_LOST_RATIO)
        report = WitnessReport(
            t_s=fix.t_s,
            place_m=antenna_m,
            velocity_mps=complex(*velocity_mps[:2]),
            driven_mps=cmath.rect(then.wheel_mps, then.yaw_rad),
            turn=cmath.rect(1.0 - lost_ratio, yaw_rad - then.yaw_rad + slip_rad),
            arm_m=complex(*Pose2(0.0, 0.0, yaw_rad).rotate(*lever_m)),
            way_m=self._driven_m,
            turned_rad=self._turned_rad,
        )
        trust = Trust(
            fix_m=math.sqrt(noise.variance_m2),
            bias_m2_per_s=noise.bias_walk_m_per_sqrt_s**2,
            velocity_mps=self.velocity.noise.sure_mps,
            course_rad=math.sqrt(ekf.cov[YAW, YAW] + ekf.cov[SLIP, SLIP]),
            scale_ratio=math.sqrt(ekf.cov[WHEEL_SCALE, WHEEL_SCALE]),
            walk_m2_per_m=self.pose.config.position_walk_m_per_sqrt_m**2,
        )
        drift.add(report, trust)
        if drift.is_drifting:
            self.moved_m = _sum(self.moved_m, drift.off_m)

    def _follow_quality(self, noise: FixNoise, is_differential: bool) -> None:
        """Corrections coming or going replace one bias by another that knows nothing of it."""
        is_corrected = self.quality in CORRECTED
        was, kind = (self._is_corrected, self._is_differential), (is_corrected, is_differential)
        if kind != was or "position" not in self.pose.known:
            self._receiver_m = (0.0, 0.0)
            self._widest_m2 = float(noise.bias_std_m) ** 2
            for state in (GNSS_BIAS_X, GNSS_BIAS_Y):
                self.pose.ekf.reset(state, 0.0, self._widest_m2)
        self._is_corrected, self._is_differential = kind

    def _find_antenna(
        self, fix: GnssFix, lever_m: tuple[float, float], epoch: Epoch
    ) -> tuple[complex, complex]:
        """Find where a fix puts the antenna in the map, and the antenna from the robot's middle."""
        alt_m = fix.alt_m if abs(fix.alt_m) <= MAX_ALT_M else self._frame.datum.alt_m
        east_m, north_m, _ = self._frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, alt_m)
        yaw_rad = self.pose.ekf.x[YAW] - (epoch.now.yaw_rad - epoch.then.yaw_rad)
        return complex(east_m, north_m), complex(*Pose2(0.0, 0.0, yaw_rad).rotate(*lever_m))

    def _position(
        self, fix: GnssFix, noise: FixNoise, antenna: tuple[complex, complex], epoch: Epoch
    ) -> Measurements:
        x, (then, now, _) = self.pose.ekf.x, epoch
        antenna_m, arm_m = antenna
        moved_x, moved_y = now.x_m - then.x_m, now.y_m - then.y_m
        now_x = antenna_m.real - arm_m.real + moved_x - self._receiver_m[0]
        now_y = antenna_m.imag - arm_m.imag + moved_y - self._receiver_m[1]
        if "position" not in self.pose.known:
            self._begin(now_x, now_y, fix_noise(fix, FLOAT_MEMORY_S).variance_m2, now)
            return
        rows = (
            ((X, 1.0), (YAW, moved_y - arm_m.imag), (GNSS_BIAS_X, 1.0)),
            ((Y, 1.0), (YAW, arm_m.real - moved_x), (GNSS_BIAS_Y, 1.0)),
        )
        self._compare_with_start(complex(now_x, now_y), noise.variance_m2, now)
        self.off_m = (now_x - x[X], now_y - x[Y])
        residuals = (self.off_m[0] - x[GNSS_BIAS_X], self.off_m[1] - x[GNSS_BIAS_Y])
        if self.drift.is_drifting:
            self.pose.rejected["gnss creeps"] += 1
            return
        measured = Measurement(
            residuals, rows, noise.variance_m2, self._position_gate, is_retaken=False
        )
        if self.jump.is_still_off(math.hypot(*residuals)):
            self.pose.rejected[self._position_gate.outlier] += 1
            self.rejected_m, self._rejected_fix = residuals, measured
            return
        self._conclude(measured, (yield measured))

    def _begin(self, x_m: float, y_m: float, variance_m2: float, now: Motion) -> None:
        """Collect fixes, each moved back to the start of the odometry; then set the position.

        Without fixed ambiguities a marked start is known better: the fixes then show the receiver's
        bias, which walks on from there, so the mark serves this session only.
        """
        self._first.append((x_m - now.x_m, y_m - now.y_m))
        if len(self._first) < FIRST_FIXES:
            return
        ekf, start = self.pose.ekf, self.pose.start
        is_fixed = self.quality is GnssQuality.RTK_FIXED
        x_m = statistics.median(p[0] for p in self._first) + now.x_m
        y_m = statistics.median(p[1] for p in self._first) + now.y_m
        way_m = self._find_way_m(now)
        self.pose.start_agreement.begin(
            complex(x_m, y_m), self._find_fix_std_m(variance_m2), way_m,
            self._unguided_m * FIRST_STD_RAD, is_fixed=is_fixed,
        )  # fmt: skip
        at_m, at_m2 = (x_m, y_m), UNKNOWN_M2
        if start.xy_map_m is not None and not is_fixed:
            at_m, at_m2 = _sum(start.xy_map_m, (way_m.real, way_m.imag)), start.std_m**2
        for state, value in zip((X, Y), at_m, strict=True):
            ekf.reset(state, value, at_m2)
        rows = (((X, 1.0), (GNSS_BIAS_X, 1.0)), ((Y, 1.0), (GNSS_BIAS_Y, 1.0)))
        ekf.update_pair(rows, (x_m - at_m[0], y_m - at_m[1]), variance_m2)
        self.pose.known.add("position")

    def _compare_with_start(self, place_m: complex, variance_m2: float, now: Motion) -> None:
        """Compare where a fix has the robot with what else is known of the start."""
        self.pose.start_agreement.add_fix(
            place_m,
            self._find_fix_std_m(variance_m2),
            self._find_way_m(now),
            self._moved_m,
            is_fixed=self.quality is GnssQuality.RTK_FIXED,
            is_followed=not self.rejected_in_a_row and not self.jump.off_m,
        )

    def _find_way_m(self, now: Motion) -> complex:
        """Find where wheels and gyro have led since the first tick."""
        return complex(now.x_m, now.y_m) + self._turned_m

    def _find_fix_std_m(self, variance_m2: float) -> float:
        """Add the slow error of the receiver to what a fix scatters by."""
        return math.sqrt(variance_m2 + float(self.pose.ekf.cov[GNSS_BIAS_X, GNSS_BIAS_X]))

    def _conclude(self, measured: Measurement, verdict: Verdict) -> None:
        """Follow a run of rejected positions, unless it is the receiver that jumped."""
        if verdict == "accept":
            self.jump.accept(self.last_t_s, self._moved_m)
            self._note_sure()
            return
        self.is_disowned = self._lies_elsewhere(measured)
        if self._is_vouched(measured):
            self.pose.rejected["wheels slip"] += 1
            self._position_gate.rejected_in_a_row = 0
            self._open(measured)
            return
        if verdict == "recover":
            off_m = math.hypot(*measured.residuals)
            if not self.jump.is_jump(
                off_m, self._moved_m,
                is_corrected=self._is_corrected, is_disowned=self.is_disowned,
            ):  # fmt: skip
                self._follow(measured)
                return
            self.pose.rejected[self._position_gate.outlier] += 1
        self.rejected_m, self._rejected_fix = _pair(measured.residuals), measured

    def _note_sure(self) -> None:
        """Note where velocities and wheels led when a fix with ambiguities fixed was believed."""
        mark = self.velocity.way.find_mark(self.last_t_s)
        if self.quality is GnssQuality.RTK_FIXED and mark is not None:
            cov = self.pose.ekf.cov
            variance_m2 = float(cov[X, X] + cov[Y, Y]) / 2.0
            self._sure = _Sure(mark, self._driven_m, self._turned_rad, variance_m2)

    def _is_vouched(self, measured: Measurement) -> bool:
        """Whether a rejected fix lies where its velocities lead, and the wheels can have been off.

        Then they have lost their way on soft ground, in a turn or ahead, or found it again, and
        neither did the fixes jump nor was the robot carried, which happens anywhere.
        """
        sure, led = self._sure, self._find_led(measured)
        is_often = self.rejected_in_a_row >= SUSPICIOUS_REJECTIONS
        if sure is None or led is None or not is_often:
            return False
        parted_m, off_m2, variance_m2 = led
        least_rad = max(VOUCHED_TURN_RAD, VOUCHED_TURN_RADPS * (self.last_t_s - sure.mark.t_s))
        has_turned = self._turned_rad - sure.turned_rad >= least_rad
        apart_m = (parted_m.real, parted_m.imag)
        _, aside_m = ahead_and_aside(apart_m, self.pose.ekf.x[YAW])
        is_ahead = aside_m * aside_m <= VOUCHED_SIGMA2 * variance_m2
        can_be_ahead = is_ahead and abs(parted_m) <= self._driven_m - sure.driven_m
        return (has_turned or can_be_ahead) and off_m2 <= VOUCHED_SIGMA2 * variance_m2

    def _find_led(self, measured: Measurement) -> tuple[complex, float, float] | None:
        """Measure how the filter and a rejected fix part from where its velocities lead.

        Returns: the distance of the filter, the square of that of the fix, and its variance; None
        without velocities since the last fix that was believed.
        """
        sure, way = self._sure, self.velocity.way
        if sure is None or self.quality is not GnssQuality.RTK_FIXED:
            return None
        parted = way.compare(sure.mark, way.find_mark(self.last_t_s))
        if parted is None:
            return None
        parted_m, std_m = parted
        variance_m2 = measured.variance + sure.variance_m2 + std_m**2
        return parted_m, abs(complex(*measured.residuals) + parted_m) ** 2, variance_m2

    def _lies_elsewhere(self, measured: Measurement) -> bool:
        """Whether a rejected fix lies where its velocities do not lead: no hands carried it."""
        led = self._find_led(measured)
        if led is None:
            return False
        _, off_m2, variance_m2 = led
        return off_m2 > ALARM2 * variance_m2

    def _follow(self, measured: Measurement) -> None:
        """Follow the fixes: with corrections they are right, and the robot was carried or slid.

        Without them the slow error of the receiver is larger than it was believed to be; the pose
        of one that wanders by metres may have been led off by it, too.
        """
        residuals = _pair(measured.residuals)
        if not self._is_corrected:
            error_m = math.hypot(*residuals)
            self.wander.enlarge(error_m)
            if self._is_wide:
                self._doubt_pose(self._widest_m2 + error_m**2 / 2.0)
            states = (GNSS_BIAS_X, GNSS_BIAS_Y)
            opens = tuple((state, error_m**2 / 2.0) for state in states)
            self.pose.open_for(measured._replace(opens=opens, is_retaken=True))
            return
        self.moved_m = _sum(self.moved_m, residuals)
        self._open(measured)

    def _doubt_pose(self, widest_m2: float) -> None:
        """Doubt the pose as far as it follows fixes whose slow error has a larger variance.

        Rows that a camera sees and a mark hold it all the same.
        """
        self.pose.ekf.doubt_fixes(widest_m2 / self._widest_m2)
        self._widest_m2 = widest_m2

    def _open(self, measured: Measurement) -> None:
        """Let the filter go where a fix is."""
        opens = tuple(
            (state, residual**2 + measured.variance)
            for state, residual in zip((X, Y), measured.residuals, strict=True)
        )
        self.pose.open_for(measured._replace(opens=opens, is_retaken=True))


def _find_course(
    fix: GnssFix, then: Motion, yaw_rad: float, lever_m: tuple[float, float]
) -> Course | None:
    """Find how a fix and how wheels and gyro have the antenna move, at a heading."""
    if fix.velocity_mps is None:
        return None
    arm_m = complex(*lever_m) * cmath.rect(1.0, yaw_rad)
    led_mps = cmath.rect(then.wheel_mps, yaw_rad) + 1j * then.yaw_rate_radps * arm_m
    return Course(fix.t_s, complex(*fix.velocity_mps[:2]), led_mps, fix.velocity_std_mps)


def _sum(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return a[0] + b[0], a[1] + b[1]


def _pair(residuals: tuple[float, ...]) -> tuple[float, float]:
    east_m, north_m = residuals
    return east_m, north_m


def _level(point_body_m: Vec3, up_body: Vec3) -> tuple[float, float]:
    """Project a point of the tilted body: forward and left of the body's origin, seen in plan."""
    roll_rad = math.atan2(up_body[1], up_body[2])
    pitch_rad = math.atan2(-up_body[0], math.hypot(up_body[1], up_body[2]))
    level_m: FloatArray = rotation_from_rpy(roll_rad, pitch_rad, 0.0) @ point_body_m
    return float(level_m[0]), float(level_m[1])
