"""The pose filter of the robot: sensors in, pose with covariance and health out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from agribot.autonomy.estimate.corrections import CORRECTIONS
from agribot.autonomy.estimate.doubts import Doubts
from agribot.autonomy.estimate.filter.ekf import GYRO_BIAS, SLIP, WHEEL_SCALE, YAW, X, Y
from agribot.autonomy.estimate.filter.field_rows import Rows
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.autonomy.estimate.filter.history import UNMOVED, Motion
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.filter.odometry import Odometry, Step
from agribot.autonomy.estimate.filter.priors import motion_noise, slow_ageing
from agribot.autonomy.estimate.filter.standstill import WINDOW_S
from agribot.autonomy.estimate.filter.stem_map import StemMap
from agribot.autonomy.estimate.integrity import Integrity
from agribot.autonomy.estimate.sensors.compass import Compass
from agribot.autonomy.estimate.sensors.correction import Correction, Ladder
from agribot.autonomy.estimate.sensors.crop_rows import MIN_MOVED_M, CropRows
from agribot.autonomy.estimate.sensors.gnss import Gnss
from agribot.autonomy.estimate.sensors.plant_places import PlantPlaces
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.sensors.row_lines import RowLines
from agribot.autonomy.estimate.sensors.row_sight import RowSight
from agribot.autonomy.estimate.verdicts import SILENT_S, VerdictTable
from agribot.autonomy.estimate.witnesses.witness import Finding, Witness
from agribot.core.arithmetic import clamp
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.fact_text import render
from agribot.core.facts import (
    Check,
    DeadReckoning,
    Fact,
    GnssSilent,
    NoDataYet,
    NoFixesYet,
    PoseClockWentBack,
    SensorSilent,
    Unspoken,
)
from agribot.core.geo import wrap_rad
from agribot.core.messages import (
    AnyRequest,
    ChangeSetting,
    ControlMission,
    CorrectPose,
    Estimate,
    GnssQuality,
    RowLine,
    Scene,
    SensorBatch,
)
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec

# Period in which slow errors are aged together, not at every wheel reading.
AGEING_PERIOD_S = 0.1
# Longer gaps are walked through in pieces, so that a turn inside one stays an arc.
MAX_STEP_S, MAX_PIECES = 0.1, 200
# Error of a turn and of a distance from the wheels alone on soil.
BLIND_TURN_RATIO, BLIND_DISTANCE_RATIO = 0.3, 0.3
BLIND_YAW_RAD_PER_SQRT_S = 0.05
# Factor over the known loss from which dead reckoning also counts as lost.
LOST_RATIO = 1.5
STANDING_MPS = 0.02
# Half seconds of standstill after which a rate that is implausible as a bias is taken for one;
# before, the robot turns though its wheels stand: soft ground gives way.
STANDING_WINDOWS = 60

Kind = TypeVar("Kind", bound=Correction[Any])
NO_WITNESSES: Mapping[str, Callable[[PoseFilter], Witness]] = {}


class Localizer:
    """Extended Kalman filter over wheels, gyro and whatever corrects them (see ekf.Ekf).

    `corrections` are the sensors that do, `witnesses` what installed packages hold against them,
    both name -> what makes one. The result depends on the times
    in the samples only, not on how they are cut into batches, but for the instant at which a late
    measurement is let in. `rejected` counts, by cause, every sample that did not enter the filter.
    """

    def __init__(
        self,
        config: EstimateConfig,
        field: FieldConfig,
        robot: RobotSpec,
        corrections: Mapping[str, Callable[[PoseFilter], Correction[Any]]] = CORRECTIONS,
        witnesses: Mapping[str, Callable[[PoseFilter], Witness]] = NO_WITNESSES,
    ) -> None:
        self.pose = PoseFilter(config, field, robot)
        self.rejected = self.pose.rejected
        self._config = config
        self._ekf, self._history = self.pose.ekf, self.pose.history
        self._noise = motion_noise(config)
        self._odometry = Odometry(robot.drive, config.imu_timeout_s, self.rejected)
        self.ladders = {name: Ladder(name, build(self.pose)) for name, build in corrections.items()}
        self._corrections = [ladder.correction for ladder in self.ladders.values()]
        self._gnss, self._compass = self._find(Gnss), self._find(Compass)
        self._crop_rows, self._row_lines = self._find(CropRows), self._find(RowLines)
        self._plant_places = self._find(PlantPlaces)
        others = [build(self.pose) for build in witnesses.values()]
        self._doubts = Doubts(self.pose, self._gnss, self._odometry, others)
        self._sight = RowSight(field)
        self._integrity = Integrity(self.pose, self._gnss)
        self._bias_gate = Gate(config.gate_sigma, STANDING_WINDOWS, "turns at standstill")
        # A rate at standstill is a turn, or a new bias: both stay possible while it lasts.
        self._gives_way, self._turning_radps = False, 0.0
        self._last_line: Motion | None = None
        self._motion = UNMOVED
        self._unaged_s = self._unaged_rad = 0.0
        self._fix_std_m = 0.0
        self._now_s = -math.inf
        self._verdicts = VerdictTable()

    def _find(self, kind: type[Kind]) -> Kind:
        return next(correction for correction in self._corrections if isinstance(correction, kind))

    def update(self, batch: SensorBatch) -> Estimate:
        for step in self._odometry.steps(batch.wheels, batch.imu, batch.t_s):
            self._advance(step)
        self.pose.up_body = self._odometry.up_body
        if not self.pose.first_heading.is_known:
            self.pose.first_heading.wait(batch.t_s, self._motion.yaw_rad)
        for ladder in self.ladders.values():
            ladder.update_all(batch)
        for event in batch.requests:
            self._apply(event.request)
        self._doubts.update(batch)
        self._now_s = batch.t_s
        return self._estimate(batch.t_s)

    def _apply(self, request: AnyRequest) -> None:
        if isinstance(request, ControlMission) and request.action in ("start", "resume"):
            self.pose.start_agreement.accept()
        match request:
            case ChangeSetting(setting="treatment.enabled") if request.value:
                self._doubts.crop.accept()
            case CorrectPose():
                self._set_pose_by_hand(request.pose)
            case ControlMission(action="start" | "resume") if self._plant_places.accept():
                self._doubts.forget()
                self._integrity.restart()
            case ControlMission(action="start" | "resume") if self._doubts.decide():
                self._integrity.restart()

    def take_rows(self, rows: Rows) -> None:
        """Hold what the camera sees against these rows from now on."""
        self.pose.take_rows(rows)

    def take_plants(self, plants: StemMap) -> None:
        """Hold the plants that the camera sees against those of a map from now on."""
        self._plant_places.take_plants(plants)

    def observe(self, scene: Scene) -> None:
        """Correct the pose by the crop of a frame; the next estimate shows it.

        A row line is made of the same leaves as the plants, so that one of them serves.
        """
        if self._plant_places.has_plants:
            self._observe_plants(scene)
        if "position" not in self.pose.known or not self.pose.rows.has_rows:
            return
        if scene.row_line is None or not self._row_lines.has_lines:
            self.ladders["scene"].update(scene)
        elif self._has_moved(scene.t_s):
            line = self._row_lines.pick(scene.row_line)
            if line is not None:
                self.observe_line(line)
        self._look_for_crop(scene)
        self._sight.observe(scene.t_s, self._crop_rows.fitted + self._row_lines.fitted)
        epoch = self._history.epoch(scene.t_s)
        distinguishes_rows = (
            self._gnss.quality is GnssQuality.RTK_FIXED
        )  # fixes that distinguish rows
        if scene.crop_cover is not None and epoch is not None and not distinguishes_rows:
            self.pose.identity.look(scene.crop_cover, self.pose.place(epoch), self.pose.rows)

    def _look_for_crop(self, scene: Scene) -> None:
        """Hold what the network calls crop against the rows."""
        place = self.place(scene.t_s)
        if scene.crop_cover is not None and place is not None:
            self._doubts.crop.look(scene.crop_cover, place, self.pose.rows)

    def _observe_plants(self, scene: Scene) -> None:
        found = self._plant_places.found
        self.ladders["plants"].update(scene)
        if self._plant_places.found != found:
            self._doubts.forget()
            self._integrity.restart()

    def place(self, t_s: float) -> Pose2 | None:
        """Return the pose at a time, as the filter sees it now; None where it is unknown."""
        epoch = self._history.epoch(t_s)
        return (
            self.pose.place(epoch) if epoch is not None and "position" in self.pose.known else None
        )

    def is_stale(self, scene: Scene) -> bool:
        """Whether its picture is an old one, or upside down: as good as none, for any use."""
        return self._doubts.is_refused(scene, self._now_s)

    def _has_moved(self, t_s: float) -> bool:
        """Whether a picture is more than that of the last line once again."""
        then, last = self._history.at(t_s), self._last_line
        if then is None or last is None:
            self._last_line = then
            return then is not None
        if math.hypot(then.x_m - last.x_m, then.y_m - last.y_m) < MIN_MOVED_M:
            return False
        self._last_line = then
        return True

    def observe_line(self, line: RowLine) -> None:
        """Correct the pose by the line of the row under the robot; the next estimate shows it."""
        self.ladders["row line"].update(line)

    def _set_pose_by_hand(self, numbers: tuple[float, ...]) -> None:
        """Set the pose that a person states; measurements correct it from now on."""
        is_moving = abs(self._motion.wheel_mps) > STANDING_MPS
        if is_moving or not {"yaw", "position"} <= self.pose.known or not is_pose(numbers):
            self.rejected["pose by hand"] += 1
            return
        x_m, y_m, yaw_rad, std_m, std_rad = numbers
        self._ekf.reset(X, x_m, std_m**2)
        self._ekf.reset(Y, y_m, std_m**2)
        self._ekf.reset(YAW, wrap_rad(yaw_rad), std_rad**2)
        self._plant_places.restart()
        self._doubts.forget()
        self._integrity.restart()

    def _advance(self, step: Step) -> None:
        """Predict through one step, in pieces if it is long, and let the slow errors age."""
        last = self._motion
        pieces = clamp(math.ceil(step.dt_s / MAX_STEP_S - 1e-6), 1, MAX_PIECES)
        lost_m = self._integrity.find_turn_loss_m(step.distance_m, step.turn_rad)
        dt_s, distance_m = step.dt_s / pieces, step.distance_m / pieces
        slide_m = ((step.slide_m[0] - lost_m) / pieces, step.slide_m[1] / pieces)
        is_still = step.is_still and not self._gives_way
        turn_rad = self._ekf.x[GYRO_BIAS] * dt_s if is_still or step.is_blind else 0.0
        if not is_still:
            turn_rad += step.turn_rad / pieces
        x_m, y_m, yaw_rad = last.x_m, last.y_m, last.yaw_rad
        for _ in range(pieces):
            dx_m, dy_m, dyaw_rad = self._ekf.predict(
                distance_m, turn_rad, dt_s, self._noise, slide_m
            )
            x_m, y_m, yaw_rad = x_m + dx_m, y_m + dy_m, yaw_rad + dyaw_rad
        self._motion = Motion(
            step.t_s, x_m, y_m, yaw_rad, distance_m / dt_s, (yaw_rad - last.yaw_rad) / step.dt_s
        )
        self._history.append(self._motion)
        self._integrity.move(step.distance_m, step.slide_m, step.turn_rad)
        self._sight.move(step.distance_m)
        self.pose.agreement.move(step.distance_m)
        self.pose.lines.move(step.distance_m, yaw_rad, yaw_rad - last.yaw_rad)
        self._watch_turn(step, yaw_rad)
        self._gnss.move(step.distance_m, step.turn_rad)
        if abs(self._motion.wheel_mps) > STANDING_MPS:
            self._doubts.move(step.t_s)
        if step.is_blind:
            self._inflate_blind_step(step)
        self._learn_bias(step)
        self._age(step.dt_s, yaw_rad - last.yaw_rad)

    def _learn_bias(self, step: Step) -> None:
        """Take the gyro's rate at standstill for its bias, unless it is far from what is known."""
        if self._gives_way and not step.is_still:  # it drives off, and knows not which it was
            self._doubt_at_least(GYRO_BIAS, self._turning_radps**2)
            self._gives_way = False
        if step.zero_rate is None:
            return
        mean_radps, variance = step.zero_rate
        off_radps = mean_radps - self._ekf.x[GYRO_BIAS]
        verdict = self.pose.correct(
            Measurement(
                (off_radps,), (((GYRO_BIAS, 1.0),),), variance, self._bias_gate,
                opens=((GYRO_BIAS, off_radps**2),),
            )
        )  # fmt: skip
        # once, the window may hold the end of a stop
        self._gives_way = verdict == "reject" and self._bias_gate.rejected_in_a_row > 1
        if self._gives_way:
            self._turning_radps = off_radps
            turned_rad = off_radps * WINDOW_S * self._bias_gate.rejected_in_a_row
            self._doubt_at_least(YAW, turned_rad**2)

    def _doubt_at_least(self, state: int, variance: float) -> None:
        self._ekf.inflate(state, max(variance - self._ekf.cov[state, state], 0.0))

    def _watch_turn(self, step: Step, yaw_rad: float) -> None:
        """Compare the step's turn with the other sensors, and correct a gyro that they outvote."""
        self._doubts.leaps.move(step.t_s, step.dt_s, step.distance_m, step.speed_mps)
        fault = self.pose.turns.move(step.t_s, yaw_rad, step.wheel_turn_rad)
        if fault is not None:
            self._ekf.inflate(GYRO_BIAS, fault.bias_radps**2)
            self._ekf.update(((GYRO_BIAS, 1.0),), fault.bias_radps, fault.std_radps**2)
            self._ekf.inflate(YAW, fault.turned_rad**2)
            self._gnss.drift.straighten(fault.since_s, fault.bias_radps)

    def _inflate_blind_step(self, step: Step) -> None:
        yaw_rad2 = (BLIND_TURN_RATIO * step.turn_rad) ** 2 + BLIND_YAW_RAD_PER_SQRT_S**2 * step.dt_s
        position_m2 = (BLIND_DISTANCE_RATIO * step.distance_m) ** 2
        self._ekf.inflate(YAW, yaw_rad2)
        self._ekf.inflate(X, position_m2)
        self._ekf.inflate(Y, position_m2)

    def _age(self, dt_s: float, turn_rad: float) -> None:
        self._unaged_s += dt_s
        self._unaged_rad += abs(turn_rad)
        if self._unaged_s < AGEING_PERIOD_S:
            return
        age_s, age_rad = self._unaged_s, self._unaged_rad
        self._unaged_s = self._unaged_rad = 0.0
        self._ekf.relax(slow_ageing(self._config, age_s))
        for correction in self._corrections:
            self._ekf.relax(correction.ageing(age_s, age_rad))

    def _estimate(self, t_s: float) -> Estimate:
        x, motion = self._ekf.x, self._motion
        forward_mps = motion.wheel_mps * (1.0 - x[WHEEL_SCALE])
        slip_rad = math.copysign(1.0, forward_mps) * x[SLIP] * self._ekf.slip_ratio(x[YAW])
        ahead_s = clamp(t_s - motion.t_s, 0.0, self._config.wheel_timeout_s)
        course_rad = x[YAW] + slip_rad + motion.yaw_rate_radps * ahead_s / 2.0
        block = self._ekf.cov[:3, :3].ravel().tolist()
        xx, xy, xt, _, yy, yt, _, _, tt = block
        middle, radius = (xx + yy) / 2.0, math.hypot((xx - yy) / 2.0, xy)
        pos_std_m = math.sqrt(middle + radius)
        doubts = tuple(self._doubts.find(t_s))
        findings = (*doubts, *self._find_silence(t_s))
        contradiction = self._doubts.contradiction
        doubt = contradiction or next((each.fact for each in doubts), None)
        ok, fact = self._health(t_s, pos_std_m, doubt)
        contradiction, of_plants = contradiction if ok else None, self._doubts.of_plants
        bounds = self._integrity.bound(t_s, pos_std_m, is_ok=ok, is_held=self._doubts.is_held(t_s))
        return Estimate(
            t_s=t_s,
            x_map_m=x[X] + forward_mps * ahead_s * math.cos(course_rad),
            y_map_m=x[Y] + forward_mps * ahead_s * math.sin(course_rad),
            yaw_map_rad=wrap_rad(x[YAW] + motion.yaw_rate_radps * ahead_s),
            v_mps=forward_mps,
            yaw_rate_radps=motion.yaw_rate_radps,
            slip_rad=slip_rad,
            pose_cov=(xx, xy, xt, xy, yy, yt, xt, yt, tt),
            pos_std_m=pos_std_m,
            yaw_std_rad=math.sqrt(tt),
            quality=self._quality(t_s),
            ok=ok,
            reason=render(fact),
            protection_m=bounds.anywhere_m,
            row_seen=self._sight.is_seen(t_s),
            across_protection_m=bounds.across_m,
            across_plain_m=bounds.across_plain_m,
            across_unknown_m=bounds.across_unknown_m,
            rows_off_m=self.pose.rows_off_m,
            contradiction=render(contradiction),
            plants_doubt=render(of_plants),
            verdicts=self._verdicts.judge(t_s, findings),
            row_certainty=self.pose.identity.certainty,
            fact=fact,
            contradiction_fact=contradiction,
            plants_fact=of_plants,
        )

    def _quality(self, t_s: float) -> GnssQuality:
        silent = t_s - self._gnss.last_t_s > self._config.gnss_timeout_s
        return GnssQuality.NONE if silent else self._gnss.quality

    def _find_silence(self, t_s: float) -> Iterator[Finding]:
        """Find sensors that were heard once and are no more."""
        config, odometry = self._config, self._odometry
        heard: tuple[tuple[str, Unspoken, float, float], ...] = (
            ("wheels", "wheels", odometry.wheel_t_s, config.wheel_timeout_s),
            ("gyro", "imu", odometry.imu_t_s, config.imu_timeout_s),
            ("gnss", "gnss", self._gnss.last_t_s, SILENT_S),
            ("compass", "compass", self._compass.last_t_s, SILENT_S),
        )
        for sensor, name, last_s, timeout_s in heard:
            if timeout_s < t_s - last_s < math.inf:
                silent = SensorSilent(name, t_s - last_s, timeout_s, name)
                yield Finding(sensor, "silent", silent)

    def _health(self, t_s: float, pos_std_m: float, doubt: Fact | None) -> tuple[bool, Fact | None]:
        if (fault := self._fault(t_s)) is not None:
            return False, fault
        silent_s = t_s - self._gnss.last_t_s
        if silent_s <= self._config.gnss_timeout_s:
            self._fix_std_m = pos_std_m
            return True, doubt
        limit_m = max(self._config.dead_reckoning_std_m, LOST_RATIO * self._fix_std_m)
        is_lost = pos_std_m > limit_m
        return not is_lost, DeadReckoning(
            doubt or GnssSilent(silent_s), pos_std_m, limit_m, is_lost
        )

    def _fault(self, t_s: float) -> Fact | None:
        """Why there is no pose at all; None when there is one."""
        config, odometry = self._config, self._odometry
        wheels_s, imu_s = t_s - odometry.wheel_t_s, t_s - odometry.imu_t_s
        if wheels_s < -config.wheel_timeout_s:
            return PoseClockWentBack(-wheels_s)
        if not wheels_s <= config.wheel_timeout_s:
            return _find_silence("wheels", wheels_s, config.wheel_timeout_s, "board")
        if not imu_s <= config.imu_timeout_s:
            return _find_silence("imu", imu_s, config.imu_timeout_s, "imu_cable")
        return self._misplacement()

    def _misplacement(self) -> Fact | None:
        """Why it is not known where the robot is, or why it cannot be there; None otherwise."""
        first = self.pose.first_heading
        if self._gnss.elsewhere is not None:
            return self._gnss.elsewhere
        if not first.is_known:
            return first.reason
        if "position" not in self.pose.known:
            return NoFixesYet()
        return first.misplaced or self.pose.start_agreement.fault


def is_pose(numbers: tuple[float, ...]) -> bool:
    """x, y, yaw and two sigmas above zero, as a person states them."""
    return len(numbers) == 5 and math.isfinite(sum(numbers)) and min(numbers[3:]) > 0.0


def _find_silence(sensor: Unspoken, silent_s: float, timeout_s: float, check: Check) -> Fact:
    if math.isinf(silent_s):
        return NoDataYet(sensor, check)
    return SensorSilent(sensor, silent_s, timeout_s, check)
