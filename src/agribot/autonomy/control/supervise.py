"""The last gate before the motors: it may only make a command safer.

It trusts nobody: a touch, wheels that do not as told, silent sensors, an uncertain pose, numbers
that are none, a tilt, a place outside the field and an operator's stop all end in zero speed and
an implement that is off.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from agribot.autonomy.control.battery_watch import BatteryWatch
from agribot.autonomy.control.bumper import Bumper
from agribot.autonomy.control.fence import Fence, FieldFence, PathFence
from agribot.autonomy.control.sensor_watch import SensorWatch
from agribot.autonomy.control.wheel_watch import Found, WheelWatch, name_motors
from agribot.core.arithmetic import clamp
from agribot.core.config import SafetyConfig
from agribot.core.field_bounds import FieldBounds
from agribot.core.latch import Latch
from agribot.core.messages import (
    STOP,
    DriveCommand,
    Estimate,
    Goal,
    MissionStatus,
    Path,
    RobotCommand,
    SensorBatch,
)  # fmt: skip
from agribot.core.robot import RobotSpec

PAUSE_BRAKE_RATIO = 0.5  # of the drive's acceleration, the least braking that a pause must show
STANDSTILL_MPS = 1e-3
DRIVEN_OFF = ("wheel", "battery")  # with these at fault a hand may drive, once it is cleared


class _Hazard(NamedTuple):
    """What latches a stop: its kind, for whoever has cleared it, and its reason for people."""

    kind: str
    reason: str


class Supervisor:
    """Keeps what it needs to judge the next command; a hazard closes the latch.

    A protective stop waits for a person. Once that person has cleared it, a motor, a wheel or a
    battery at fault does not stop a hand again, so that the robot can be driven off; the mission
    it stops anew.
    """

    def __init__(self, config: SafetyConfig, robot: RobotSpec, latch: Latch | None = None) -> None:
        """`latch` is shared with the mission, which pauses while it holds."""
        self._config = config
        self._latch = Latch() if latch is None else latch
        self._fenced: tuple[Path | None, FieldBounds | None] = None, None
        self._fences: tuple[Fence, ...] = ()
        self._field_fence: FieldFence | None = None
        self._max_speed_mps = min(config.max_speed_mps, robot.drive.max_speed_mps)
        self._max_yaw_rate_radps = min(config.max_yaw_rate_radps, robot.drive.max_yaw_rate_radps)
        self._max_accel_mps2 = robot.drive.max_accel_mps2
        self._max_yaw_accel_radps2 = robot.drive.max_yaw_accel_radps2
        self._works_backwards = robot.implement is None or robot.implement.works_backwards
        self._sensors = SensorWatch(config)
        self._wheels = WheelWatch(robot.drive, config.sensor_timeout_s)
        self._bumper = Bumper()
        self._battery = BatteryWatch(config)
        self._held_kind = ""  # of the hazard that closed the latch, until it is cleared
        self._accepted: set[str] = set()
        self._last = STOP
        # What the motors were told last; a replay puts in what they were told then.
        self.sent = STOP

    @property
    def warning(self) -> str:
        """What calls the robot home, though it may still drive; empty where nothing does."""
        return self._battery.low

    def check(
        self,
        command: RobotCommand,
        estimate: Estimate,
        batch: SensorBatch,
        goal: Goal,
        *,
        is_by_hand: bool = False,
    ) -> tuple[RobotCommand, str]:
        """Give the command to send, and why it was changed ("" if it was not).

        Of a robot that is to stand while its wheels turn on, the reason tells that.
        A person who drives by hand sees where the robot is: neither its own position nor the
        fence nor the mission holds it then, but stops, touches, silent sensors and limits do.
        An implement switched off at standstill and the ramp after a stop need no reason.
        """
        status = goal.status
        self._fence_in(goal)
        self._sensors.update(batch)
        self._battery.update(batch)
        self._update(batch, status)
        is_to_move = status.state == "running" or not command.drive == self._last == STOP
        motion = self._wheels.watch(self.sent, batch, self._sensors.dt_s)
        hazard = self._hazard(batch, motion, is_by_hand=is_by_hand, is_to_move=is_to_move)
        if hazard and not self._latch.reason:
            self._held_kind = hazard.kind
            self._latch.hold(hazard.reason)
        fault = self._fault(command, batch.t_s)
        if not fault and not is_by_hand:
            fault = self._mission_fault(command.drive, estimate, goal)
        if fault:
            drive = STOP
            reason = fault if _moves(command) else ""
        else:
            drive, reason = self._limit(self._bumper.away(command.drive))
            dt_s = self._sensors.dt_s
            is_pausing = status.state == "paused" and not is_by_hand
            drive = self._ramp(drive, -PAUSE_BRAKE_RATIO * dt_s if is_pausing else dt_s)
            reason = reason or self._held_back(command.drive)
        if drive == STOP:
            reason = motion.runaway or reason
        self._last = self.sent = drive
        implement = command.implement
        if not self._may_work(drive, status):
            implement = implement.switch_off()
        return RobotCommand(t_s=command.t_s, drive=drive, implement=implement), reason

    def _may_work(self, drive: DriveCommand, status: MissionStatus) -> bool:
        """Whether the implement may do what it is told: on the move in a running mission only."""
        if abs(drive.v_mps) < STANDSTILL_MPS or status.state != "running":
            return False
        return drive.v_mps > 0.0 or self._works_backwards

    def _update(self, batch: SensorBatch, status: MissionStatus) -> None:
        if status.state == "running":
            self._accepted.clear()
        for event in batch.events:
            if event.action == "clear_stop":
                self._bumper.accept()
                self._accepted |= {self._held_kind} & {*DRIVEN_OFF}
                self._held_kind = ""
            self._latch.hear(event)

    def _fence_in(self, goal: Goal) -> None:
        """Box and field of what is driven now.

        The fence of a field outlives the ways in it: it knows that the robot was inside.
        """
        path, bounds = self._fenced
        if goal.path is path and goal.bounds is bounds:
            return
        self._fenced = goal.path, goal.bounds
        self._fences = ()
        if goal.path is not None:
            self._fences = (PathFence.around(goal.path, self._config.geofence_margin_m),)
        if goal.bounds is not None:
            fence = self._field_fence
            if fence is None or fence.bounds is not goal.bounds:
                fence = FieldFence(goal.bounds, self._config, self._max_accel_mps2)
            self._field_fence, self._fences = fence, (*self._fences, fence)

    def _hazard(
        self, batch: SensorBatch, motion: Found, *, is_by_hand: bool, is_to_move: bool
    ) -> _Hazard | None:
        """Say what a protective stop is for; but for a touch, only of a robot that is to move."""
        motors = tuple(dict.fromkeys(name for wheel in batch.wheels for name in wheel.faults))
        touch = self._bumper.feel(batch)
        if not touch and not is_to_move:
            return None
        found = (
            _Hazard("bumper", touch),
            _Hazard("sensor", self._sensors.clock_fault or self._sensors.silence(batch.t_s)),
            _Hazard("battery", self._battery.empty),
            _Hazard("wheel", name_motors(motors) if motors else motion.wheels),
        )
        for hazard in found:
            if hazard.reason and not (is_by_hand and hazard.kind in self._accepted):
                return hazard
        return None if is_by_hand else self._hazard_of_mission(motion.doubt)

    def _hazard_of_mission(self, doubt: str) -> _Hazard | None:
        """Say what a person who drives by hand sees anyway and need not be stopped for."""
        if sides := self._bumper.sides:
            where = " and ".join(sides)
            return _Hazard(
                "bumper", f"the bumper still touches something {where}; back off by hand"
            )
        found = self._sensors.tilt() or doubt
        return _Hazard("mission", found) if found else None

    def _held_back(self, wanted: DriveCommand) -> str:
        """Why a hand does not get what it asked for."""
        if self._bumper.away(wanted) == wanted:
            return ""
        where = " and ".join(self._bumper.sides)
        return f"the bumper touches something {where}; only straight away from it by hand"

    def _fault(self, command: RobotCommand, t_s: float) -> str:
        drive = command.drive
        if self._latch.reason:
            return f"{self._latch.reason}; clear the stop to go on"
        if not math.isfinite(drive.v_mps + drive.yaw_rate_radps):
            return f"command is not finite: {drive.v_mps} m/s, {drive.yaw_rate_radps} rad/s"
        if not command.implement.is_finite:
            return f"implement command is not finite: {command.implement.setpoints}"
        return self._sensors.unheard() or self._sensors.silence(t_s)

    def _mission_fault(self, drive: DriveCommand, estimate: Estimate, goal: Goal) -> str:
        if untrusted := self._untrusted_pose(estimate):
            return untrusted
        for fence in self._fences:
            if objection := fence.objection(estimate, drive, goal):
                return objection
        return _idle_mission(goal.status)

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
        return estimate.contradiction

    def _limit(self, drive: DriveCommand) -> tuple[DriveCommand, str]:
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
            v_mps=clamp(drive.v_mps * ratio, -self._max_speed_mps, self._max_speed_mps),
            yaw_rate_radps=clamp(
                drive.yaw_rate_radps * ratio, -self._max_yaw_rate_radps, self._max_yaw_rate_radps
            ),
        )
        return slower, reason

    def _ramp(self, drive: DriveCommand, dt_s: float) -> DriveCommand:
        """No faster than the drive can gain in `dt_s` since the last command.

        Braking is never held back; a negative time demands it.
        """
        return DriveCommand(
            v_mps=_limit_gain(drive.v_mps, self._last.v_mps, self._max_accel_mps2 * dt_s),
            yaw_rate_radps=_limit_gain(
                drive.yaw_rate_radps, self._last.yaw_rate_radps, self._max_yaw_accel_radps2 * dt_s
            ),
        )


def _limit_gain(wanted: float, last: float, step: float) -> float:
    """`wanted`, with its magnitude at most one step above what was sent in its direction."""
    reached = max(math.copysign(1.0, wanted) * last, 0.0)
    return math.copysign(min(abs(wanted), max(reached + step * (1.0 + 1e-6), 0.0)), wanted)


def _moves(command: RobotCommand) -> bool:
    drive = command.drive
    return drive != STOP or command.implement.is_on


def _idle_mission(status: MissionStatus) -> str:
    if status.state in ("running", "paused"):
        return ""
    return f"mission {status.state}" + (f": {status.reason}" if status.reason else "")
