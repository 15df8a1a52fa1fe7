"""The last gate before the motors: it may only make a command safer.

It trusts no other part: it checks the table of hazards in every tick. What it finds leads to less
speed, or to a stop with the implement off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.control.battery_watch import BatteryWatch
from agribot.autonomy.control.bumper import Bumper
from agribot.autonomy.control.camera_watch import CameraWatch
from agribot.autonomy.control.fence import Fence, FieldFence, PathFence
from agribot.autonomy.control.gate_machine import GateMachine, Seen
from agribot.autonomy.control.hazards import Situation, check_start, find_hazard
from agribot.autonomy.control.input_watch import InputWatch
from agribot.autonomy.control.obstacle_zone import ObstacleZone
from agribot.autonomy.control.power_cut import PowerCut
from agribot.autonomy.control.progress_watch import ProgressWatch
from agribot.autonomy.control.sensor_watch import SensorWatch
from agribot.autonomy.control.wheel_watch import WheelWatch
from agribot.core.arithmetic import clamp
from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    Fact,
    MissionIdle,
    OnlyAway,
    SpeedLimited,
    StopToClear,
    YawRateLimited,
)
from agribot.core.field_bounds import FieldBounds
from agribot.core.keep_out import BodyBox
from agribot.core.latch import Latch
from agribot.core.messages import (
    STOP,
    ClearStop,
    DriveCommand,
    Estimate,
    GateStatus,
    Goal,
    MissionStatus,
    Path,
    RobotCommand,
    Scene,
    SensorBatch,
)  # fmt: skip
from agribot.core.robot import RobotSpec

# Waiting time of a mission after which its list before the start is published, too.
CHECK_AFTER_S = 5.0
SHOWN_EXCESS = 0.01  # m/s or rad/s over a limit, the least for which two decimals differ
# Least braking that a pause must show, as a share of the drive's acceleration.
PAUSE_BRAKE_RATIO = 0.5
NO_BODY = BodyBox(0.0, 0.0, 0.0)


class Supervisor:
    """Keeps what it needs to judge the next command; a hazard closes the latch.

    A protective stop waits for a person. Once that person has cleared it, a motor, a wheel or a
    battery at fault does not stop a hand again, so that the robot can be driven off; the mission
    it stops anew.
    """

    def __init__(
        self,
        config: SafetyConfig,
        robot: RobotSpec,
        latch: Latch | None = None,
        keep_out: Fence | None = None,
        obstacles: ObstacleZone | None = None,
    ) -> None:
        """`latch` is shared with the mission, which pauses while it holds.

        `keep_out` is a fence that stands on every way, `obstacles` is what a robot with a sensor
        of obstacles watches.
        """
        self._always: tuple[Fence, ...] = () if keep_out is None else (keep_out,)
        self._obstacles = obstacles or ObstacleZone(config, NO_BODY, must_report=False)
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
        self._inputs = InputWatch(config)
        self._wheels = WheelWatch(robot.drive, config.sensor_timeout_s)
        self._power = PowerCut(config.sensor_timeout_s)
        self._progress = ProgressWatch(robot.drive)
        # Why the robot does not get on though its wheels turn; None where it does.
        self.stuck: Fact | None = None
        self._bumper = Bumper()
        self._battery = BatteryWatch(config)
        self._camera = CameraWatch(config)
        self._machine = GateMachine()
        self._waiting_since_s = math.inf  # on the platform's clock
        self._held_kind = ""  # kind of the hazard that closed the latch, until it is cleared
        self._accepted: frozenset[str] = frozenset()
        self._cleared_by = ""
        self._is_tool_working = False
        self._last = STOP
        # The last command to the motors; a replay puts in the recorded one.
        self.sent = STOP

    @property
    def gate(self) -> GateStatus:
        """Its state after the last tick, and why."""
        return self._machine.status

    @property
    def warning(self) -> Fact | None:
        """Cause that calls the robot home, though it may still drive; None without one."""
        return self._battery.low

    @property
    def in_way(self) -> Fact | None:
        """The person or thing that the mission waits for; None where its way is free."""
        return self._obstacles.stop

    def check(
        self,
        command: RobotCommand,
        estimate: Estimate,
        batch: SensorBatch,
        goal: Goal,
        scenes: Sequence[Scene] = (),
        *,
        is_by_hand: bool = False,
    ) -> tuple[RobotCommand, Fact | None]:
        """Give the command to send, and why it was changed (None if it was not).

        If wheels turn during a stop, that is the reason.
        A person who drives by hand sees where the robot is: the table of hazards says what of it
        holds a hand. An implement switched off at standstill and the ramp after a stop need no
        reason.
        """
        self._hear(batch, goal.status)
        now = self._look(command, estimate, batch, goal, scenes)
        is_to_move = goal.status.state == "running" or not command.drive == self._last == STOP
        self._latch_hazard(now, is_by_hand=is_by_hand, is_to_move=is_to_move)
        held = self._why_held(now, is_by_hand=is_by_hand)
        stopped = self._latch.cause and StopToClear(self._latch.cause)
        limited: Fact | None = None
        if stopped or held:
            drive = STOP
            reason = (stopped or held) if _moves(command) else None
        else:
            drive, limited = self._slow_down(self._bumper.away(command.drive), is_by_hand)
            drive = self._ramp(drive, self._ramp_s(goal.status, is_by_hand=is_by_hand))
            reason = limited or self._held_back(command.drive)
        warning, alarm = self._find_warning(now)
        if drive == STOP:
            reason = alarm or reason
        self._last = self.sent = drive
        implement = command.implement
        if self._is_tool_off(now, drive):
            implement = implement.switch_off()
        self._is_tool_working = implement.is_on
        hand = _name_hand(batch) if is_by_hand and command.drive != STOP else ""
        self._step_machine(now, Seen(
            stopped=self._latch.cause, hand=hand, held=held, idle=_describe_idle(goal.status),
            limited=limited, cleared_by=self._cleared_by,
        ), warning)  # fmt: skip
        sent = RobotCommand(
            t_s=command.t_s, drive=drive, implement=implement, is_power_cut=self._power.is_cut
        )
        return sent, reason

    def _find_warning(self, now: Situation) -> tuple[Fact | None, Fact | None]:
        """Return the warning and the alarm: of a robot that may drive, and of one that must not."""
        found = find_hazard(now, "report")
        if found is None:
            return now.camera_fault, None
        hazard, fact = found
        return fact, fact if hazard.at_rest else None

    def _is_tool_off(self, now: Situation, drive: DriveCommand) -> bool:
        """Whether the tool must not work over what the robot is going to do."""
        command = RobotCommand(t_s=now.batch.t_s, drive=drive)
        then = now._replace(command=command)
        return find_hazard(then, "tool off") is not None

    def _step_machine(self, now: Situation, seen: Seen, warning: Fact | None) -> None:
        if now.goal.status.state not in ("waiting", "running", "paused"):
            self._machine.end_mission()
        is_to_drive = not (seen.idle or seen.stopped) or self._waits_long(now)
        is_starting = is_to_drive and not self._machine.is_started
        self._machine.step(seen, warning, check_start(now) if is_starting else ())

    def _waits_long(self, now: Situation) -> bool:
        """Return whether a mission has waited long enough to set off that a person will ask why."""
        t_s = now.batch.t_s
        if now.goal.status.state != "waiting":
            self._waiting_since_s = math.inf
        self._waiting_since_s = min(self._waiting_since_s, t_s)
        return t_s - self._waiting_since_s > CHECK_AFTER_S

    def _ramp_s(self, status: MissionStatus, *, is_by_hand: bool) -> float:
        """Return the time that a ramp has; a negative one demands braking."""
        dt_s = self._sensors.dt_s
        return -PAUSE_BRAKE_RATIO * dt_s if status.state == "paused" and not is_by_hand else dt_s

    def _hear(self, batch: SensorBatch, status: MissionStatus) -> None:
        """Open and close the latch as people ask."""
        self._cleared_by = ""
        if status.state == "running":
            self._accepted = frozenset()
        for event in batch.requests:
            if isinstance(event.request, ClearStop):
                self._bumper.accept()
                self._inputs.accept(batch.t_s)
                self._progress.restart()
                self._accepted |= {self._held_kind} - {""}
                self._held_kind, self._cleared_by = "", event.who.name
            self._latch.hear(event)

    def _look(
        self,
        command: RobotCommand,
        estimate: Estimate,
        batch: SensorBatch,
        goal: Goal,
        scenes: Sequence[Scene],
    ) -> Situation:
        """Ask every watch about this tick."""
        self._fence_in(goal)
        self._sensors.update(batch)
        self._inputs.update(batch)
        self._battery.update(batch)
        self._camera.update(batch, scenes)
        self._obstacles.update(batch, estimate, goal)
        is_held = self._progress.stays_behind(batch.t_s)
        motion = self._wheels.watch(
            self.sent, batch, self._sensors.dt_s, is_held=is_held,
            is_stop_pressed=any(event.request.word == "stop" for event in batch.requests),
            has_power=self._power.has_power,
        )  # fmt: skip
        demand = self._inputs.button() or motion.runaway
        is_stopped = self._latch.cause is not None
        self._power.update(batch, self._wheels.fastest_radps, demand, is_stopped=is_stopped)
        is_early = not self._machine.is_started
        self.stuck = self._progress.watch(batch) or motion.held
        return Situation(
            config=self._config, command=command, estimate=estimate, batch=batch, goal=goal,
            sensors=self._sensors, inputs=self._inputs,
            motion=motion, power=self._power,
            stuck=self.stuck,
            bumper=self._bumper, touch=self._bumper.feel(batch),
            battery=self._battery, obstacles=self._obstacles,
            camera_fault=self._camera.fault,
            has_camera=self._camera.is_used, fences=(*self._fences, *self._always),
            works_backwards=self._works_backwards,
            is_tool_working=is_early and self._is_tool_working,
        )  # fmt: skip

    def _fence_in(self, goal: Goal) -> None:
        """Box and field of what is driven now.

        The fence of a field outlives the ways in it: it knows that the robot was inside.
        """
        path, bounds = self._fenced
        if goal.path is path and goal.bounds is bounds:
            return
        if goal.path is not path:  # on another way it may get on
            self._progress.restart()
            self._wheels.restart()
        self._fenced = goal.path, goal.bounds
        self._fences = ()
        if goal.path is not None:
            margin_m = self._config.geofence_margin_m
            self._fences = (PathFence.around(goal.path, margin_m, self._max_accel_mps2),)
        if goal.bounds is not None:
            fence = self._field_fence
            if fence is None or fence.bounds is not goal.bounds:
                fence = FieldFence(goal.bounds, self._config, self._max_accel_mps2)
            self._field_fence, self._fences = fence, (*self._fences, fence)

    def _latch_hazard(self, now: Situation, *, is_by_hand: bool, is_to_move: bool) -> None:
        """Close the latch for what a person must look at, of a robot that is to move or touches."""
        found = find_hazard(now, "latch", is_by_hand=is_by_hand, accepted=self._accepted)
        if found is None or self._latch.cause is not None:
            return
        hazard, cause = found
        if is_to_move or hazard.at_rest:
            self._held_kind = hazard.kind if hazard.for_hand == "until cleared" else ""
            self._latch.hold(cause)

    def _why_held(self, now: Situation, *, is_by_hand: bool) -> Fact | None:
        found = find_hazard(now, "wait", is_by_hand=is_by_hand, accepted=self._accepted)
        return None if found is None else found[1]

    def _held_back(self, wanted: DriveCommand) -> OnlyAway | None:
        """Why a hand does not get what it asked for."""
        return None if self._bumper.away(wanted) == wanted else OnlyAway(self._bumper.ends)

    def _slow_down(self, drive: DriveCommand, is_by_hand: bool) -> tuple[DriveCommand, Fact | None]:
        """Keep within the limits, and drive slowly near people and things; a hand sees them."""
        near, most_mps = self._obstacles.slow, self._obstacles.most_mps
        if is_by_hand or near is None or abs(drive.v_mps) <= most_mps:
            return self._limit(drive)
        ratio = most_mps / abs(drive.v_mps)
        slower = DriveCommand(
            v_mps=drive.v_mps * ratio, yaw_rate_radps=drive.yaw_rate_radps * ratio
        )
        return self._limit(slower)[0], near

    def _limit(self, drive: DriveCommand) -> tuple[DriveCommand, Fact | None]:
        """Slow down along the same curve when a limit is passed.

        The reason is None if the difference is too small to show.
        """
        speed_mps, yaw_rate_radps = abs(drive.v_mps), abs(drive.yaw_rate_radps)
        ratio = 1.0
        reason: Fact | None = None
        if speed_mps > self._max_speed_mps:
            ratio = self._max_speed_mps / speed_mps
            if speed_mps - self._max_speed_mps >= SHOWN_EXCESS:
                reason = SpeedLimited(speed_mps, self._max_speed_mps)
        if yaw_rate_radps * ratio > self._max_yaw_rate_radps:
            ratio = self._max_yaw_rate_radps / yaw_rate_radps
            if yaw_rate_radps - self._max_yaw_rate_radps >= SHOWN_EXCESS:
                reason = YawRateLimited(yaw_rate_radps, self._max_yaw_rate_radps)
        if ratio == 1.0:
            return drive, None
        slower = DriveCommand(
            v_mps=clamp(drive.v_mps * ratio, -self._max_speed_mps, self._max_speed_mps),
            yaw_rate_radps=clamp(
                drive.yaw_rate_radps * ratio, -self._max_yaw_rate_radps, self._max_yaw_rate_radps
            ),
        )
        return slower, reason

    def _ramp(self, drive: DriveCommand, dt_s: float) -> DriveCommand:
        """Limit the speed to what the drive can gain in `dt_s` since the last command.

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


def _describe_idle(status: MissionStatus) -> MissionIdle | None:
    """Find why the mission does not drive; None where it does."""
    return None if status.state == "running" else MissionIdle(status.state, status.fact)


def _name_hand(batch: SensorBatch) -> str:
    return batch.hand[-1].who.name if batch.hand else "a person"
