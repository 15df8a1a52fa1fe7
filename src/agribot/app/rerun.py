"""The stack again on a recording, as it was or with other settings, and what that changes.

The sensors are those of the recorded drive: they do not answer to commands that differ. A rerun
shows what the stack would have estimated, mapped and planned, not where the robot would have gone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec
import numpy as np

from agribot.app.calibration.recorded_robot import read_measured_robot
from agribot.app.field_work import read_field_work
from agribot.app.known_plants import read_plants
from agribot.app.prescribed_zones import read_zones
from agribot.app.robot_stack import build_stack
from agribot.app.run_recording import (
    EARLIER_ATTACHMENT,
    GOALS_ATTACHMENT,
    PLAN_ATTACHMENT,
    PLANTS_ATTACHMENT,
    PRESCRIPTION_ATTACHMENT,
    SAVED_ATTACHMENT,
)
from agribot.autonomy.perception_host import RecordedPerception
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.planning_host import ThreadedPlanning
from agribot.autonomy.weeds.track import Track
from agribot.core.config import RunConfig, assign, from_tree
from agribot.core.errors import EndOfRecording, RecordingError
from agribot.core.messages import STOP, MappedPlant, MapPoint, PlantClass, TickRecord
from agribot.core.toml_tree import drop_none
from agribot.record.mcap_file import read_attachment
from agribot.record.mcap_records import read_part_number
from agribot.record.replay import (
    ReplayPlatform,
    find_late_plans,
    read_ticks,
    recorded_scenes,
)

LATEST_FIRST_TICK_S = 1.0  # first tick of a recording that began with its run
# Settings of these groups shaped the recording itself.
_FIXED = ("perception", "sim", "record", "platform", "world", "robot", "seed", "tick_hz")


class PassSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One pass of the stack over a recording by its own estimate; null: no such value."""

    ticks: int
    end_s: float
    state: str
    reason: str
    rows_done: int
    waypoints_reached: int
    distance_m: float
    speed_mean_mps: float
    commanded_mean_mps: float
    cross_track_rms_m: float | None
    cross_track_p95_m: float | None
    cross_track_max_m: float | None
    pos_std_mean_m: float | None
    weeds_mapped: int
    weeds_treated: int
    implement_on_s: float
    stops: int


class PassDifference(msgspec.Struct, frozen=True, kw_only=True):
    """The difference of two passes, tick by tick; `first` is None when all commands agree."""

    first: int | None
    ticks: int
    share: float
    speed_max_mps: float
    yaw_rate_max_radps: float
    position_rms_m: float | None


def change_settings(config: RunConfig, settings: Sequence[str]) -> RunConfig:
    """Apply `a.b=c` settings to those of a run.

    Raises: ConfigError: a setting that does not exist or does not fit.
    """
    tree = drop_none(msgspec.to_builtins(config))
    for setting in settings:
        assign(tree, setting)
    return from_tree(tree, " ".join(f"--with {setting}" for setting in settings))


def find_ineffective(settings: Iterable[str]) -> list[str]:
    """Find the settings that a rerun cannot try, because the recording was made with them."""
    return [s for s in settings if s.partition("=")[0].split(".")[0].strip() in _FIXED]


def read_pass(path: Path) -> list[TickRecord]:
    """Read the recorded ticks.

    Raises: RecordingError: no ticks, or a part that does not begin at the beginning.
    """
    number = read_part_number(path)
    if number:
        raise RecordingError(
            f"{path} is part {number} of a longer recording and begins in its middle; the stack "
            "can only be run again from the first part on"
        )
    ticks = list(read_ticks(path))
    if not ticks:
        raise RecordingError(f"{path} holds no ticks of the robot's stack; nothing to run again")
    if ticks[0].batch.t_s > LATEST_FIRST_TICK_S:
        raise RecordingError(
            f"{path} was begun {ticks[0].batch.t_s:.1f} s after the robot was started; the stack "
            "can only be run again from its start on"
        )
    return ticks


def rerun(path: Path, config: RunConfig) -> tuple[list[TickRecord], tuple[MappedPlant, ...]]:
    """Run the stack on the recorded batches and scenes; return its ticks and its last weed map."""
    robot = read_measured_robot(path, config)
    goals = read_attachment(path, GOALS_ATTACHMENT)
    goals_map_m = msgspec.json.decode(goals, type=tuple[MapPoint, ...])
    text = read_attachment(path, PLAN_ATTACHMENT).decode() if config.plan else ""
    work = read_field_work(text, config, robot)
    perception = RecordedPerception(recorded_scenes(path))
    resumed = read_attachment(path, SAVED_ATTACHMENT)
    saved = msgspec.json.decode(resumed, type=SavedMission | None)
    planning = ThreadedPlanning(late_s=find_late_plans(path))
    is_zoned = bool(config.treatment.prescription)
    prescription = read_attachment(path, PRESCRIPTION_ATTACHMENT) if is_zoned else b""
    zones = read_zones(prescription, config, work)
    known = read_attachment(path, PLANTS_ATTACHMENT) if config.field.plant_map else b""
    plants = read_plants(known)
    stack = build_stack(
        config, robot, goals_map_m, perception, work, saved, zones, planning, plants
    )
    stack.weed_map.restore(_read_earlier_plants(path))
    ticks: list[TickRecord] = []
    stack.taps.append(ticks.append)
    platform = ReplayPlatform(path)
    try:
        while True:
            stack.tick(platform)
            # The wheels obeyed the recorded command, whatever other settings command now.
            stack.supervisor.sent = platform.recorded_drive()
    except EndOfRecording:
        pass
    finally:
        platform.close()
        stack.close()
    return ticks, stack.weed_map.export_plants()


def _read_earlier_plants(path: Path) -> tuple[Track, ...]:
    """Read the weed map that the run began with; older recordings have none."""
    try:
        plants = read_attachment(path, EARLIER_ATTACHMENT)
    except RecordingError:
        return ()
    return msgspec.json.decode(plants, type=tuple[Track, ...])


def summarise_pass(ticks: Sequence[TickRecord], plants: Sequence[MappedPlant]) -> PassSummary:
    last = ticks[-1]
    t_s = np.array([tick.batch.t_s for tick in ticks])
    step_s = np.diff(t_s, prepend=t_s[0])
    speed_mps = np.array([abs(tick.estimate.v_mps) for tick in ticks])
    tracked = [abs(tick.tracking.cross_track_m) for tick in ticks if tick.tracking is not None]
    known = [tick.estimate.pos_std_m for tick in ticks if tick.estimate.ok]
    is_working = np.array([tick.command.implement.is_on for tick in ticks])
    weeds = [plant for plant in plants if plant.plant == PlantClass.WEED]
    return PassSummary(
        ticks=len(ticks),
        end_s=float(t_s[-1]),
        state=last.status.state,
        reason=last.status.reason,
        rows_done=len(last.status.rows_done),
        waypoints_reached=last.status.waypoints_reached,
        distance_m=float(np.sum(speed_mps * step_s)),
        speed_mean_mps=float(np.mean(speed_mps)),
        commanded_mean_mps=float(np.mean([abs(tick.command.drive.v_mps) for tick in ticks])),
        cross_track_rms_m=math.sqrt(float(np.mean(np.square(tracked)))) if tracked else None,
        cross_track_p95_m=float(np.percentile(tracked, 95.0)) if tracked else None,
        cross_track_max_m=max(tracked, default=None),
        pos_std_mean_m=float(np.mean(known)) if known else None,
        weeds_mapped=len(weeds),
        weeds_treated=sum(weed.treated_s is not None for weed in weeds),
        implement_on_s=float(np.sum(step_s[is_working])),
        stops=_count_stops(ticks),
    )


def compare_passes(before: Sequence[TickRecord], after: Sequence[TickRecord]) -> PassDifference:
    """Compare two passes over the same batches."""
    pairs = list(zip(before, after, strict=False))
    unequal = [i for i, (a, b) in enumerate(pairs) if a.command != b.command]
    if len(before) != len(after):
        unequal += range(len(pairs), max(len(before), len(after)))
    drives = [(a.command.drive, b.command.drive) for a, b in pairs]
    apart_m = [
        math.hypot(a.estimate.x_map_m - b.estimate.x_map_m, a.estimate.y_map_m - b.estimate.y_map_m)
        for a, b in pairs
        if a.estimate.ok and b.estimate.ok
    ]
    return PassDifference(
        first=unequal[0] if unequal else None,
        ticks=len(unequal),
        share=len(unequal) / max(len(before), len(after), 1),
        speed_max_mps=max((abs(a.v_mps - b.v_mps) for a, b in drives), default=0.0),
        yaw_rate_max_radps=max(
            (abs(a.yaw_rate_radps - b.yaw_rate_radps) for a, b in drives), default=0.0
        ),
        position_rms_m=math.sqrt(float(np.mean(np.square(apart_m)))) if apart_m else None,
    )


def _count_stops(ticks: Sequence[TickRecord]) -> int:
    """Count how often the supervisor brought a moving robot to a halt."""
    held = [bool(tick.reason) and tick.command.drive == STOP for tick in ticks]
    moving = [False, *(tick.command.drive != STOP for tick in ticks)]
    return sum(now and before for now, before in zip(held, moving, strict=False))
