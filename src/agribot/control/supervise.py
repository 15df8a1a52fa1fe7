"""The last gate before the motors: it may only make a command safer.

It trusts nobody: silent sensors, an uncertain pose, numbers that are none, a tilt, a place
outside the field and an operator's stop all end in zero speed and a closed implement.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from agribot.config import SafetyConfig
from agribot.messages import (
    STOP,
    DriveCommand,
    Estimate,
    Goal,
    ImplementCommand,
    MissionStatus,
    OperatorEvent,
    Path,
    RobotCommand,
    SensorBatch,
    Vec3,
)  # fmt: skip
from agribot.robot import RobotSpec

TILT_FILTER_S = 0.5  # driving over clods shakes the accelerometer; a fall lasts longer
MAX_DT_S = 0.1
PAUSE_BRAKE_RATIO = 0.5  # of the drive's acceleration, the least braking that a pause must show
STANDSTILL_MPS = 1e-3


class Fence(NamedTuple):
    """Axis-aligned rectangle in the map that the robot may not leave."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float

    @classmethod
    def around(cls, path: Path, margin_m: float) -> Fence:
        (x_min_m, y_min_m), (x_max_m, y_max_m) = (
            path.xy_map_m.min(axis=0),
            path.xy_map_m.max(axis=0),
        )
        return cls(
            float(x_min_m) - margin_m, float(y_min_m) - margin_m,
            float(x_max_m) + margin_m, float(y_max_m) + margin_m,
        )  # fmt: skip

    def holds(self, x_map_m: float, y_map_m: float) -> bool:
        return self.x_min_m <= x_map_m <= self.x_max_m and self.y_min_m <= y_map_m <= self.y_max_m


class Supervisor:
    """Keeps what it needs to judge the next command: sensor times, tilt, the latched stop."""

    def __init__(self, config: SafetyConfig, robot: RobotSpec) -> None:
        self._config = config
        self._fenced_path: Path | None = None
        self._fence: Fence | None = None
        self._max_speed_mps = min(config.max_speed_mps, robot.drive.max_speed_mps)
        self._max_yaw_rate_radps = min(config.max_yaw_rate_radps, robot.drive.max_yaw_rate_radps)
        self._max_accel_mps2 = robot.drive.max_accel_mps2
        self._max_yaw_accel_radps2 = robot.drive.max_yaw_accel_radps2
        self._wheel_t_s = self._imu_t_s = -math.inf
        self._up = (0.0, 0.0, 0.0)
        self._stopped_by = ""
        self._last = STOP
        self._last_t_s = math.nan

    def check(
        self,
        command: RobotCommand,
        estimate: Estimate,
        batch: SensorBatch,
        goal: Goal,
        *,
        is_by_hand: bool = False,
    ) -> tuple[RobotCommand, str]:
        """The command to send, and why it was changed ("" if it was not).

        A person who drives by hand sees where the robot is: neither its own position nor the
        fence nor the mission holds it then, but stops, silent sensors and limits do.
        A closed implement at standstill and the ramp after a stop need no reason.
        """
        status = goal.status
        self._listen(batch)
        self._fence_in(goal.path)
        dt_s = self._elapsed_s(batch.t_s)
        fault = self._fault(command.drive, batch.t_s)
        if not fault and not is_by_hand:
            fault = self._mission_fault(estimate, status)
        if fault:
            drive = STOP
            reason = fault if _moves(command) else ""
        else:
            drive, reason = self._limited(command.drive)
            is_pausing = status.state == "paused" and not is_by_hand
            drive = self._ramped(drive, -PAUSE_BRAKE_RATIO * dt_s if is_pausing else dt_s)
        self._last = drive
        implement = command.implement
        if abs(drive.v_mps) < STANDSTILL_MPS or status.state != "running":
            implement = ImplementCommand(nozzles_open=(False,) * len(implement.nozzles_open))
        return RobotCommand(t_s=command.t_s, drive=drive, implement=implement), reason

    def _listen(self, batch: SensorBatch) -> None:
        for event in batch.events:
            self._latch(event)
        if batch.wheels:
            self._wheel_t_s = batch.wheels[-1].t_s
        for sample in batch.imu:
            self._up = self._smoothed(sample.accel_mps2, sample.t_s - self._imu_t_s)
            self._imu_t_s = sample.t_s

    def _fence_in(self, path: Path | None) -> None:
        if path is not self._fenced_path:
            self._fenced_path = path
            margin_m = self._config.geofence_margin_m
            self._fence = None if path is None else Fence.around(path, margin_m)

    def _latch(self, event: OperatorEvent) -> None:
        if event.action == "stop":
            self._stopped_by = event.source
        elif event.action == "clear_stop":
            self._stopped_by = ""

    def _smoothed(self, accel_mps2: Vec3, dt_s: float) -> Vec3:
        """Low pass of the specific force; one that was lost to a bad value starts afresh."""
        x, y, z = self._up
        if not math.isfinite(x + y + z) or not math.isfinite(dt_s):
            return accel_mps2
        gain = min(max(dt_s, 0.0) / TILT_FILTER_S, 1.0)
        ax, ay, az = accel_mps2
        return (x + gain * (ax - x), y + gain * (ay - y), z + gain * (az - z))

    def _elapsed_s(self, t_s: float) -> float:
        dt_s, self._last_t_s = t_s - self._last_t_s, t_s
        return min(max(dt_s, 0.0), MAX_DT_S) if math.isfinite(dt_s) else 0.0

    def _fault(self, drive: DriveCommand, t_s: float) -> str:
        if self._stopped_by:
            return f"stopped by {self._stopped_by}; clear the stop to go on"
        if not math.isfinite(drive.v_mps + drive.yaw_rate_radps):
            return f"command is not finite: {drive.v_mps} m/s, {drive.yaw_rate_radps} rad/s"
        return self._silent_sensor(t_s)

    def _mission_fault(self, estimate: Estimate, status: MissionStatus) -> str:
        return (
            self._untrusted_pose(estimate) or self._unsafe_place(estimate) or _idle_mission(status)
        )

    def _silent_sensor(self, t_s: float) -> str:
        limit_s = self._config.sensor_timeout_s
        for name, heard_s in (("wheel encoders", self._wheel_t_s), ("IMU", self._imu_t_s)):
            silent_s = t_s - heard_s
            if not silent_s <= limit_s:
                since = "have" if name.endswith("s") else "has"
                if heard_s == -math.inf:
                    return f"{name} {since} not reported yet; check cable and power"
                return f"{name} silent for {silent_s:.2f} s > {limit_s:.2f} s; check the cable"
        if not math.isfinite(sum(self._up)):
            return "IMU reports a number that is none; check the sensor"
        return ""

    def _untrusted_pose(self, estimate: Estimate) -> str:
        if not estimate.ok:
            return f"no position: {estimate.reason or 'the estimate is not ready'}"
        if not math.isfinite(estimate.x_map_m + estimate.y_map_m + estimate.yaw_map_rad):
            return "position is not finite; restart the localisation"
        limit_m, limit_rad = self._config.max_pos_std_m, self._config.max_yaw_std_rad
        if not estimate.pos_std_m <= limit_m:
            return (
                f"position uncertain: {estimate.pos_std_m:.2f} m > {limit_m:.2f} m; wait for GNSS"
            )
        if not estimate.yaw_std_rad <= limit_rad:
            return f"heading uncertain: {estimate.yaw_std_rad:.2f} rad > {limit_rad:.2f} rad"
        return ""

    def _unsafe_place(self, estimate: Estimate) -> str:
        x, y, z = self._up
        tilt_rad = math.atan2(math.hypot(x, y), z)
        if not tilt_rad <= self._config.max_tilt_rad:
            limit_rad = self._config.max_tilt_rad
            return f"tilted by {tilt_rad:.2f} rad > {limit_rad:.2f} rad; drive it down by hand"
        if self._fence is not None and not self._fence.holds(estimate.x_map_m, estimate.y_map_m):
            return (
                f"outside the geofence at East {estimate.x_map_m:.2f} m, North "
                f"{estimate.y_map_m:.2f} m; bring it back or raise safety.geofence_margin_m"
            )
        return ""

    def _limited(self, drive: DriveCommand) -> tuple[DriveCommand, str]:
        """Slower along the same curve when a limit is passed."""
        speed_mps, yaw_rate_radps = abs(drive.v_mps), abs(drive.yaw_rate_radps)
        ratio, reason = 1.0, ""
        if speed_mps > self._max_speed_mps:
            ratio = self._max_speed_mps / speed_mps
            reason = f"speed {speed_mps:.2f} m/s limited to {self._max_speed_mps:.2f} m/s"
        if yaw_rate_radps * ratio > self._max_yaw_rate_radps:
            ratio = self._max_yaw_rate_radps / yaw_rate_radps
            reason = (
                f"yaw rate {yaw_rate_radps:.2f} rad/s limited to "
                f"{self._max_yaw_rate_radps:.2f} rad/s"
            )
        if not reason:
            return drive, ""
        slower = DriveCommand(
            v_mps=_clamped(drive.v_mps * ratio, self._max_speed_mps),
            yaw_rate_radps=_clamped(drive.yaw_rate_radps * ratio, self._max_yaw_rate_radps),
        )
        return slower, reason

    def _ramped(self, drive: DriveCommand, dt_s: float) -> DriveCommand:
        """No faster than the drive can gain in `dt_s` since the last command.

        Braking is never held back; a negative time demands it.
        """
        return DriveCommand(
            v_mps=_gained(drive.v_mps, self._last.v_mps, self._max_accel_mps2 * dt_s),
            yaw_rate_radps=_gained(
                drive.yaw_rate_radps, self._last.yaw_rate_radps, self._max_yaw_accel_radps2 * dt_s
            ),
        )


def _clamped(value: float, limit: float) -> float:
    """Within the limit to the last bit, which a ratio alone does not promise."""
    return min(max(value, -limit), limit)


def _gained(wanted: float, last: float, step: float) -> float:
    """`wanted`, with its magnitude at most one step above what was sent in its direction."""
    reached = max(math.copysign(1.0, wanted) * last, 0.0)
    return math.copysign(min(abs(wanted), max(reached + step * (1.0 + 1e-6), 0.0)), wanted)


def _moves(command: RobotCommand) -> bool:
    drive = command.drive
    return drive != STOP or any(command.implement.nozzles_open)


def _idle_mission(status: MissionStatus) -> str:
    if status.state in ("running", "paused"):
        return ""
    return f"mission {status.state}" + (f": {status.reason}" if status.reason else "")
