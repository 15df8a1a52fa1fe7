"""The table of hazards: what may go wrong on the way to the motors, and what is done about it.

Each row is one hazard from its detection to the fault of the simulator that proves it. The
supervisor works through the rows from top to bottom; the first that finds something speaks.
Rows without `find` are looked after elsewhere, where `seen_by` says.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

from agribot.autonomy.control.battery_watch import BatteryWatch
from agribot.autonomy.control.bumper import Bumper
from agribot.autonomy.control.fence import Fence, FieldFence
from agribot.autonomy.control.input_watch import InputWatch
from agribot.autonomy.control.keep_out_fence import KeepOutFence
from agribot.autonomy.control.obstacle_zone import ObstacleZone
from agribot.autonomy.control.power_cut import PowerCut
from agribot.autonomy.control.sensor_watch import SensorWatch
from agribot.autonomy.control.wheel_watch import Found
from agribot.core.config import SafetyConfig
from agribot.core.fact_text import render
from agribot.core.facts import (
    CommandNotFinite,
    EntersKeepOut,
    EstimateNotReady,
    Fact,
    HeadingUnsure,
    ImplementNotFinite,
    InKeepOut,
    LeavesField,
    MissionIdle,
    MotorsReportFault,
    NoContactor,
    NoPosition,
    PositionNotFinite,
    PositionOld,
    PositionUnsure,
    Runaway,
    StillTouches,
    ToolAtRest,
    ToolBackwards,
    ToolEarly,
)
from agribot.core.messages import Check, Estimate, Goal, RobotCommand, SensorBatch

# latch: stands until a person clears the stop. wait: stands until it is over. slow: along the same
# curve. tool off: it drives on, the tool does not work. home: the mission turns home.
# report: a message, and the robot drives on.
Reaction = Literal["latch", "wait", "slow", "tool off", "home", "report"]
# Whether a person who drives is held, too; "until cleared": once, and then drives the robot off.
ForHand = Literal["yes", "until cleared", "no"]
STANDSTILL_MPS = 1e-3


class Situation(NamedTuple):
    """All that the gate knows in a tick; `command` is what is asked for."""

    config: SafetyConfig
    command: RobotCommand
    estimate: Estimate
    batch: SensorBatch
    goal: Goal
    sensors: SensorWatch
    inputs: InputWatch
    motion: Found
    power: PowerCut
    stuck: Fact | None
    bumper: Bumper
    touch: Fact | None
    battery: BatteryWatch
    obstacles: ObstacleZone
    camera_fault: Fact | None
    has_camera: bool  # pictures came at least once
    fences: tuple[Fence, ...]
    works_backwards: bool
    is_tool_working: bool


class Hazard(NamedTuple):
    """One row. `limit` names settings by their keys, or says the limit in words.

    `check` is the item of the list before the start that it belongs to. Accepting one hazard of
    a `kind` accepts all of it. `faults` are those of the simulator that prove the row.
    """

    name: str
    seen_by: str
    limit: str
    reaction: Reaction
    find: Callable[[Situation], Fact | None] | None
    for_hand: ForHand = "no"
    kind: str = ""
    faults: tuple[str, ...] = ()
    check: str = ""
    for_mission: bool = True
    at_rest: bool = False  # counts also for a robot that is not to move


def _motor_flags(now: Situation) -> MotorsReportFault | None:
    names = dict.fromkeys(name for wheel in now.batch.wheels for name in wheel.faults)
    return MotorsReportFault(tuple(names)) if names else None


def _still_touches(now: Situation) -> StillTouches | None:
    return StillTouches(now.bumper.ends) if now.bumper.ends else None


def _crossing(now: Situation) -> EntersKeepOut | InKeepOut | LeavesField | None:
    if _pose_missing(now) or _pose_stale(now) or _pose_unsure(now):
        return None
    fences = (fence for fence in now.fences if isinstance(fence, FieldFence | KeepOutFence))
    return next((f.crossing(now.estimate, now.command.drive) for f in fences), None)


def _not_finite(now: Situation) -> CommandNotFinite | ImplementNotFinite | None:
    drive, implement = now.command.drive, now.command.implement
    if not math.isfinite(drive.v_mps + drive.yaw_rate_radps):
        return CommandNotFinite(drive.v_mps, drive.yaw_rate_radps)
    return None if implement.is_finite else ImplementNotFinite(str(implement.setpoints))


def _pose_missing(now: Situation) -> NoPosition | PositionNotFinite | None:
    estimate = now.estimate
    if not estimate.ok:
        return NoPosition(estimate.fact or EstimateNotReady())
    is_finite = math.isfinite(estimate.x_map_m + estimate.y_map_m + estimate.yaw_map_rad)
    return None if is_finite else PositionNotFinite()


def _pose_stale(now: Situation) -> PositionOld | None:
    old_s, limit_s = now.batch.t_s - now.estimate.t_s, now.config.sensor_timeout_s
    return None if abs(old_s) <= limit_s else PositionOld(old_s, limit_s)


def _pose_unsure(now: Situation) -> PositionUnsure | None:
    std_m, limit_m = now.estimate.pos_std_m, now.config.max_pos_std_m
    return None if std_m <= limit_m else PositionUnsure(std_m, limit_m)


def _heading_unsure(now: Situation) -> HeadingUnsure | None:
    std_rad, limit_rad = now.estimate.yaw_std_rad, now.config.max_yaw_std_rad
    return None if std_rad <= limit_rad else HeadingUnsure(std_rad, limit_rad)


def _beyond_fence(now: Situation) -> Fact | None:
    drive, goal = now.command.drive, now.goal
    found = (fence.objection(now.estimate, drive, goal) for fence in now.fences)
    return next(filter(None, found), None)


def _mission_idle(now: Situation) -> MissionIdle | None:
    status = now.goal.status
    if status.state in ("running", "paused"):
        return None
    return MissionIdle(status.state, status.fact)


def _tool_early(now: Situation) -> ToolEarly | None:
    return ToolEarly() if now.is_tool_working else None


def _tool_at_rest(now: Situation) -> ToolAtRest | ToolBackwards | None:
    drive, status = now.command.drive, now.goal.status
    if abs(drive.v_mps) < STANDSTILL_MPS or status.state != "running":
        return ToolAtRest()
    return None if drive.v_mps > 0.0 or now.works_backwards else ToolBackwards()


def _runs_away(now: Situation) -> Runaway | None:
    cause, power = now.motion.runaway, now.power
    if cause is None:
        return None
    is_cut = power.is_cut and not power.does_not_open
    return Runaway(cause, is_cut, is_contactor_stuck=power.is_cut and not is_cut)


def _stuck(now: Situation) -> Fact | None:
    return None if now.goal.frees_itself else now.stuck


def _frees_itself(now: Situation) -> Fact | None:
    return now.stuck if now.goal.frees_itself else None


HAZARDS = (
    Hazard(name="touch", seen_by="bumper, in its very tick", limit="any touch", reaction="latch",
           for_hand="yes", find=lambda now: now.touch, at_rest=True,
           faults=("bumper.contact", "obstacle.unmapped")),
    Hazard(name="red button", seen_by="motor board, which stops the motors itself",
           limit="pressed", reaction="latch", for_hand="yes",
           find=lambda now: now.inputs.button(), check="red button", at_rest=True,
           faults=("button.pressed",)),
    Hazard(name="wheels turn although they are to stand",
           seen_by="encoders and torque; a contactor takes the motors' power",
           limit="0.4 s after they had to stand; out of rest 0.3 m/s for 0.1 s, driven by motors "
                 "for 0.12 s, one wheel alone for 0.4 s",
           reaction="latch", for_hand="yes", find=lambda now: now.motion.runaway, at_rest=True,
           faults=("motor.runaway",)),
    Hazard(name="contactor does not answer or obey",
           seen_by="its own report, and the encoders",
           limit="`safety.sensor_timeout_s`; 1 s to open or close", reaction="latch",
           for_hand="yes", find=lambda now: now.power.fault(), check="contactor",
           faults=("contactor.welded", "contactor.silent")),
    Hazard(name="wheels turn without power", seen_by="encoders, after the contactor opened",
           limit="0.2 rad/s", reaction="latch", for_hand="yes",
           find=lambda now: now.power.still_turns(), at_rest=True),
    Hazard(name="clock jumps or stands",
           seen_by="time of the tick", limit="`safety.clock_jump_s`", reaction="latch",
           for_hand="yes", find=lambda now: now.sensors.clock_fault, check="clock",
           faults=("clock.step", "program.stalled")),
    Hazard(name="encoders or IMU silent, or NaN", seen_by="their samples",
           limit="`safety.sensor_timeout_s`", reaction="latch", for_hand="yes",
           find=lambda now: now.sensors.silence(now.batch.t_s), check="wheels and IMU",
           faults=("board.silent", "imu.unplugged", "imu.late", "link.noise")),
    Hazard(name="safety input silent", seen_by="age of the board's report",
           limit="`safety.sensor_timeout_s`, battery 5 s, of each of `safety.must_report`",
           reaction="latch", for_hand="yes", find=lambda now: now.inputs.silence(),
           check="safety inputs", faults=("inputs.silent",)),
    Hazard(name="IMU sends impossible numbers", seen_by="range of its numbers",
           limit="3 in 5 s beyond 160 m/s^2 or 40 rad/s", reaction="latch", for_hand="yes",
           find=lambda now: now.sensors.spoilt_line(), check="wheels and IMU",
           faults=("link.noise",)),
    Hazard(name="battery empty", seen_by="charge or voltage, for 5 s",
           limit="`safety.empty_charge_ratio`, `safety.empty_battery_v`", reaction="latch",
           for_hand="until cleared", kind="battery", find=lambda now: now.battery.empty,
           check="battery", faults=("battery.empty",)),
    Hazard(name="lidar silent", seen_by="age of its newest scan",
           limit="`safety.sensor_timeout_s`", reaction="latch", for_hand="until cleared",
           kind="lidar", find=lambda now: now.obstacles.silence(now.batch.t_s), check="lidar"),
    Hazard(name="motor board reports a fault or restarted", seen_by="motor board",
           limit="any", reaction="latch", for_hand="until cleared", kind="board",
           find=lambda now: now.inputs.fault, check="motors",
           faults=("wheels.reversed", "board.hung")),
    Hazard(name="motor reports a fault", seen_by="motor board", limit="any flag",
           reaction="latch", for_hand="until cleared", kind="wheel", find=_motor_flags,
           check="motors", faults=("motor.weak", "motor.dead")),
    Hazard(name="motor board holds a stop of its own", seen_by="motor board",
           limit="3 s after a person cleared the stop", reaction="latch", for_hand="yes",
           find=lambda now: now.inputs.stop(), check="motors", at_rest=True,
           faults=("board.hung", "battery.empty")),
    Hazard(name="wheels stand, run away, reverse or are swapped",
           seen_by="encoders against the command",
           limit="30 % and 0.6 rad/s off for 0.4 s", reaction="latch",
           for_hand="until cleared", kind="wheel", find=lambda now: now.motion.wheels,
           faults=("wheels.stuck", "wheels.reversed", "motor.runaway", "motor.weak")),
    Hazard(name="leaves the field by hand",
           seen_by="position, boundary, braking distance",
           limit="`safety.fence_tolerance_m`", reaction="latch", for_mission=False,
           for_hand="until cleared", kind="edge", find=_crossing),
    Hazard(name="something still touches", seen_by="bumper", limit="any touch",
           reaction="latch", find=_still_touches, check="bumper",
           faults=("bumper.contact",)),
    Hazard(name="tilt", seen_by="accelerometer, over 0.5 s", limit="`safety.max_tilt_rad`",
           reaction="latch", find=lambda now: now.sensors.tilt(), check="upright",
           faults=("robot.tipped",)),
    Hazard(name="motor without torque whose wheel rolls along",
           seen_by="torque of each wheel", limit="none for 0.5 s while the others work",
           reaction="latch", find=lambda now: now.motion.dead_motor, faults=("motor.dead",)),
    Hazard(name="IMU repeats itself", seen_by="its samples while the wheels turn",
           limit="0.5 s", reaction="latch", find=lambda now: now.motion.frozen_imu,
           faults=("imu.frozen",)),
    Hazard(name="gyro contradicts the wheels", seen_by="gyro against the wheels' difference",
           limit="0.24 rad/s and 20 %, or half; in tight turns up to 85 % less turn passes",
           reaction="latch", find=lambda now: now.motion.wrong_turn, faults=("imu.bias",)),
    Hazard(name="stuck or slipping",
           seen_by="wheels against GNSS and gyro",
           limit="for 2.5 s less than 35 % of 0.5 m (1.5 m without corrections), or hardly a turn; "
                 "after `mission.free_tries`",
           reaction="latch", find=_stuck, faults=("soil.mud",)),
    Hazard(name="stuck, and the mission backs out",
           seen_by="as above", limit="as above, up to `mission.free_tries`", reaction="wait",
           find=_frees_itself, faults=("soil.mud",)),
    Hazard(name="command is NaN", seen_by="the command", limit="finite",
           reaction="wait", for_hand="yes", find=_not_finite),
    Hazard(name="encoders or IMU never reported", seen_by="their samples", limit="one sample",
           reaction="wait", for_hand="yes", find=lambda now: now.sensors.unheard(),
           check="wheels and IMU"),
    Hazard(name="safety input never reported", seen_by="motor board",
           limit="once, of each of `safety.must_report`", reaction="wait", for_hand="yes",
           find=lambda now: now.inputs.unheard(), check="safety inputs"),
    Hazard(name="lidar never spoke", seen_by="its scans", limit="one scan", reaction="wait",
           find=lambda now: now.obstacles.unheard(), check="lidar"),
    Hazard(name="motors without power", seen_by="contactor",
           limit="until the wheels stood for 0.5 s after the stop was cleared", reaction="wait",
           for_hand="yes", find=lambda now: now.power.waiting()),
    Hazard(name="no position", seen_by="estimate",
           limit="`estimate.wheel_timeout_s`, `estimate.imu_timeout_s`; `estimate.gnss_timeout_s` "
           "without a fix, then `estimate.dead_reckoning_std_m`",
           reaction="wait", find=_pose_missing, check="position",
           faults=("gnss.outage", "start.aside", "start.turned")),
    Hazard(name="position is old", seen_by="time of the estimate",
           limit="`safety.sensor_timeout_s`", reaction="wait", find=_pose_stale,
           check="position"),
    Hazard(name="position uncertain", seen_by="estimate", limit="`safety.max_pos_std_m`",
           reaction="wait", find=_pose_unsure, check="position"),
    Hazard(name="heading uncertain", seen_by="estimate", limit="`safety.max_yaw_std_rad`",
           reaction="wait", find=_heading_unsure, check="heading"),
    Hazard(name="sensors contradict each other", seen_by="estimate", limit="its own",
           reaction="wait", find=lambda now: now.estimate.contradiction_fact, check="position",
           faults=("gnss.jump", "gnss.wrong_fix", "gnss.frozen", "carried", "camera.shifted",
                   "camera.creeping")),
    Hazard(name="leaves the field or the box around its path",
           seen_by="position and its uncertainty, footprint, braking distance",
           limit="`safety.fence_tolerance_m`, `safety.fence_sigma`, `safety.fence_single_sigma`, "
                 "`safety.geofence_margin_m`",
           reaction="wait", find=_beyond_fence, check="field"),
    Hazard(name="person or thing in the way", seen_by="lidar, where the robot has one",
           limit="`safety.obstacle_stop_m` along the way, 0.2 m beside the body",
           reaction="wait", find=lambda now: now.obstacles.stop),
    Hazard(name="no mission runs", seen_by="mission", limit="-", reaction="wait",
           find=_mission_idle),
    Hazard(name="may be off its row", seen_by="protection level, by the mission",
           limit="clearance from wheels to crop", reaction="slow", find=None,
           faults=("gnss.drift", "imu.bias", "camera.mirrored")),
    Hazard(name="person or thing near the way", seen_by="lidar, where the robot has one",
           limit="`safety.obstacle_slow_m`, 1 m beside the body",
           reaction="slow", find=None),
    Hazard(name="too fast", seen_by="the command",
           limit="`safety.max_speed_mps`, `safety.max_yaw_rate_radps`, the drive",
           reaction="slow", for_hand="yes", find=None),
    Hazard(name="battery low", seen_by="charge or voltage, for 5 s",
           limit="`safety.low_charge_ratio`, `safety.low_battery_v`", reaction="home",
           find=lambda now: now.battery.low),
    Hazard(name="tool on while the robot stands or is driven by hand", seen_by="the command",
           limit="at rest, no mission, or backwards", reaction="tool off", for_hand="yes",
           find=_tool_at_rest),
    Hazard(name="tool on before the start", seen_by="last command", limit="off",
           reaction="wait", find=_tool_early, check="tool"),
    Hazard(name="camera or network silent or late", seen_by="pictures and plants",
           limit="`safety.camera_timeout_s`", reaction="tool off",
           find=lambda now: now.camera_fault, check="camera",
           faults=("camera.off", "camera.late", "network.hung")),
    Hazard(name="pictures show nothing usable, or no crop on the rows",
           seen_by="light, focus, the network's doubt, crop on rows",
           limit="3 pictures; 1 m of row", reaction="tool off",
           find=lambda now: now.estimate.plants_fact),
    Hazard(name="runaway", seen_by="encoders and torque", limit="as for wheels that turn",
           reaction="report", for_hand="yes", find=_runs_away, at_rest=True,
           faults=("motor.runaway",)),
    Hazard(name="one of two contactors is welded", seen_by="their auxiliary contacts",
           limit="1 s to open", reaction="report", for_hand="yes",
           find=lambda now: now.power.find_weld(), at_rest=True, faults=("contactor.welded",)),
    Hazard(name="one impossible number of the IMU", seen_by="range of its numbers",
           limit="160 m/s^2, 40 rad/s", reaction="report", for_hand="yes",
           find=lambda now: now.sensors.spoilt_number(), faults=("link.noise",)),
    Hazard(name="tilt unknown", seen_by="IMU without acceleration",
           limit="its newest reading", reaction="report", for_hand="yes",
           find=lambda now: None if now.camera_fault else now.sensors.unknown_tilt()),
    Hazard(name="hand or its link is gone", seen_by="age of its requests",
           limit="`safety.hand_timeout_s`", reaction="wait", for_hand="yes", find=None),
    Hazard(name="operator's page is gone", seen_by="the page's server",
           limit="`safety.on_operator_lost`", reaction="wait", find=None),
    Hazard(name="the robot's program dies or hangs", seen_by="motor board",
           limit="`drive.command_timeout_s`, 0.3 to 0.5 s without a command",
           reaction="wait", for_hand="yes", find=None, faults=("program.stalled",)),
    Hazard(name="a second program drives the robot or writes the run",
           seen_by="a lock for each folder and platform",
           limit="one", reaction="wait", for_hand="yes", find=None),
)  # fmt: skip


def find_hazard(
    now: Situation,
    reaction: Reaction,
    *,
    is_by_hand: bool = False,
    accepted: frozenset[str] = frozenset(),
) -> tuple[Hazard, Fact] | None:
    """Find the first row of a reaction that has something to say, and what.

    Kinds that were `accepted` do not hold a hand.
    """
    for hazard, find in _COUNTING[reaction, is_by_hand]:
        found = find(now)
        if found is not None and not (is_by_hand and hazard.kind in accepted):
            return hazard, found
    return None


_REACTIONS: tuple[Reaction, ...] = ("latch", "wait", "slow", "tool off", "home", "report")
_COUNTING = {
    (reaction, is_by_hand): tuple(
        (hazard, hazard.find)
        for hazard in HAZARDS
        if hazard.find is not None
        and hazard.reaction == reaction
        and (hazard.for_hand != "no" if is_by_hand else hazard.for_mission)
    )
    for reaction in _REACTIONS
    for is_by_hand in (False, True)
}
CONTACTOR = "contactor"
LIDAR = "lidar"
OF_BOARD = ("red button", "safety inputs")  # items that only a motor board can report
CHECKS = tuple(dict.fromkeys(hazard.check for hazard in HAZARDS if hazard.check))
_BY_CHECK = {
    name: tuple(hazard.find for hazard in HAZARDS if hazard.check == name and hazard.find)
    for name in CHECKS
}


def check_start(now: Situation) -> tuple[Check, ...]:
    """Go through the list before the first motion; what the robot does not have is no item."""
    checks = []
    absent = (() if now.has_camera else ("camera",)) + (() if now.inputs.is_there else OF_BOARD)
    absent += () if now.obstacles.is_there else (LIDAR,)
    for name in CHECKS:
        if name in absent:
            continue
        found = next(filter(None, (find(now) for find in _BY_CHECK[name])), None)
        remark = NoContactor() if name == CONTACTOR and not now.power.is_there else None
        fact = found or remark
        checks.append(Check(name=name, is_ok=found is None, text=render(fact), fact=fact))
    return tuple(checks)
