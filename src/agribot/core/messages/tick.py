"""All of one tick."""

from __future__ import annotations

import msgspec

from agribot.core.facts import AnyFact
from agribot.core.messages.command import RobotCommand
from agribot.core.messages.estimate import Estimate
from agribot.core.messages.mission import MissionStatus
from agribot.core.messages.seen import Scene
from agribot.core.messages.sensors import SensorBatch


class Tracking(msgspec.Struct, frozen=True, kw_only=True):
    """The follower's errors: signed cross-track (left positive) and heading."""

    s_m: float
    cross_track_m: float
    heading_error_rad: float


class TickRecord(msgspec.Struct, frozen=True, kw_only=True):
    """All that one tick saw and decided: log line, display update and replay key.

    `fact` is why the supervisor changed the command, or that wheels turn during a stop; `reason` is
    its text. `is_plan_late` says that a way was due in this tick and was
    not there: a robot that cannot wait goes on without, and so does a replay.
    """

    batch: SensorBatch
    scenes: tuple[Scene, ...]
    estimate: Estimate
    status: MissionStatus
    tracking: Tracking | None
    command: RobotCommand
    reason: str = ""
    is_plan_late: bool = False
    fact: AnyFact | None = None
