"""What must survive a crash for a mission to go on at the same place."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence

import msgspec

from agribot.autonomy.plan.mission.covered import WorkedStretch
from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.autonomy.plan.mission.row_log import RowResult
from agribot.core.errors import MissionError
from agribot.core.facts import AnyFact, CarriedAway, OtherMission, Said
from agribot.core.messages import Estimate, MissionState, Path

PoseTuple = tuple[float, float, float]
LENGTH_TOLERANCE_M = 0.01


class SavedErrand(msgspec.Struct, frozen=True, kw_only=True):
    """A drive beside the work that was under way; `goal` is that of a place, as it was asked."""

    to: ErrandKind
    source: str
    goal: tuple[float, ...] = ()


class SavedMission(msgspec.Struct, frozen=True, kw_only=True):
    """Progress as rows, and the pose in which the robot was last.

    `covered` is the worked part of the rows, in the map, and `skipped` the rows left out: with them
    the mission can go on under another plan over the same rows.

    `planned_from` is the pose from which the path was planned: from it the same path is planned
    again; None before the first path. `detours` are the points of the path from which a row was
    left out, and the rows. `task` identifies the task. `is_away` says that the robot was driven
    elsewhere since the work stopped; `visit` are the places of a visit that replaced the mission,
    which `visit_name` names. `stopped_fact` is the stop that was not cleared, `paused_fact` why the
    robot stood still; both are None where it drove. `stopped` and `paused` are their texts, and all
    that earlier versions saved.
    """

    task: str
    state: MissionState
    t_s: float
    planned_from: PoseTuple | None
    pose: PoseTuple
    length_m: float
    s_m: float
    row: int
    rows: tuple[RowResult, ...]
    waypoints_reached: tuple[bool, ...] = ()
    detours: tuple[tuple[int, int], ...] = ()
    covered: tuple[WorkedStretch, ...] = ()
    skipped: tuple[WorkedStretch, ...] = ()
    errand: SavedErrand | None = None
    is_away: bool = False
    visit: tuple[tuple[float, float], ...] = ()
    visit_name: str = ""
    stopped: str = ""
    paused: str = ""
    format: int = 1
    stopped_fact: AnyFact | None = None
    paused_fact: AnyFact | None = None

    def release(self) -> SavedMission:
        """Return it without its stop and without what it paused for: a person has looked."""
        return msgspec.structs.replace(
            self, stopped="", paused="", stopped_fact=None, paused_fact=None
        )

    @property
    def stop(self) -> AnyFact | None:
        """The stop that was not cleared."""
        return self.stopped_fact or (Said(self.stopped) if self.stopped else None)

    @property
    def pause(self) -> AnyFact | None:
        """Why the robot stood still."""
        return self.paused_fact or (Said(self.paused) if self.paused else None)

    @property
    def asks_first(self) -> bool:
        """An operator had sent the robot away from its work: what goes on is an operator's word."""
        return self.errand is not None or self.is_away or bool(self.visit_name)


def take_pose(estimate: Estimate) -> PoseTuple:
    """Take x and y (m) and yaw (rad) in the map."""
    return estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad


def name_task(rows: Sequence[int], waypoints: Sequence[tuple[float, float]], path: Path) -> str:
    """Name a task: the same for the same rows, waypoints and path."""
    text = msgspec.json.encode((list(rows), list(waypoints)))
    text += path.xy_map_m[::25].round(3).tobytes()
    return hashlib.sha256(text).hexdigest()[:16]


def check_same_task(saved: SavedMission, task: str, length_m: float) -> None:
    """Refuse another task than the saved one.

    Raises: MissionError: the settings or the plan were changed since.
    """
    if saved.task != task or abs(saved.length_m - length_m) > LENGTH_TOLERANCE_M:
        raise MissionError(OtherMission(saved.length_m, length_m))


def check_not_carried_away(estimate: Estimate, place: tuple[float, float], limit_m: float) -> None:
    """Refuse a robot that is not where it stood.

    Raises: MissionError: it is farther away than its own uncertainty explains.
    """
    away_m = math.dist((estimate.x_map_m, estimate.y_map_m), place)
    allowed_m = limit_m + 2.0 * estimate.pos_std_m
    if not away_m <= allowed_m:
        raise MissionError(CarriedAway(away_m, *place, allowed_m))
