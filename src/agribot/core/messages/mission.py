"""Paths, crop rows, and what the mission wants and reports."""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.facts import AnyFact
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages.arrays import FloatArray
from agribot.core.messages.gate import GateStatus

MissionState = Literal["waiting", "running", "paused", "done", "cancelled", "failed"]


class Path(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A dense path of the body frame's origin in the map.

    All arrays have N points about 2 cm apart: `xy_map_m` (N, 2), `yaw_map_rad` (N,),
    `curvature_radpm` (N,), `row` (N,) the index of the crop row, or -1 between rows,
    `s_m` (N,) the distance from the start.
    """

    xy_map_m: FloatArray
    yaw_map_rad: FloatArray
    curvature_radpm: FloatArray
    row: npt.NDArray[np.int64]
    s_m: FloatArray


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """A crop row from its first to its last plant: a line, or an arc (see row_shape)."""

    index: int
    start_map_m: tuple[float, float]
    end_map_m: tuple[float, float]
    curvature_radpm: float = 0.0  # left positive


class RequestAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """What became of the request with this `id`: taken, or why not, and its text."""

    id: str
    refusal: str = ""
    fact: AnyFact | None = None


class MissionStatus(msgspec.Struct, frozen=True, kw_only=True):
    """Progress: `row` is the row being worked, -1 between rows; `rows_done` those finished.

    `fact`, `stopped_fact`, `held_fact` and `warning_fact` are what the program decides by;
    `reason`, `stopped`, `held` and `warning` are their texts.
    """

    state: MissionState
    reason: str
    row: int
    rows_total: int
    rows_done: tuple[int, ...]
    s_m: float
    length_m: float
    waypoints_total: int
    waypoints_reached: int
    leg: str = ""  # "row 3", "to row 4", "way home"
    distance_left_m: float = 0.0
    eta_s: float | None = None  # until the end of the path, at the planned speeds
    refusal: str = ""  # why the last goal, visit, plan or way home was not taken
    task: str = ""  # the name of the visit that took the place of the mission
    goal_map_m: tuple[float, float] | None = None  # destination of the robot on its path
    rows_unproven: tuple[int, ...] = ()  # driven without evidence that it was this row: not done
    stopped: str = ""  # why it stands until a person clears the stop
    held: str = ""  # why it paused by itself; a person has to look, and to resume it
    warning: str = ""  # cause of its way home, such as a low battery
    answers: tuple[RequestAnswer, ...] = ()  # to the requests that were settled in this tick
    # Offset by an operator, to the left of the row's direction; for the row here.
    row_nudged_m: float = 0.0
    gate: GateStatus = GateStatus()  # status of the supervisor, the last gate before the motors
    fact: AnyFact | None = None
    stopped_fact: AnyFact | None = None
    held_fact: AnyFact | None = None
    warning_fact: AnyFact | None = None
    refusal_fact: AnyFact | None = None


class Goal(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Goal of the mission now: follow `path` from `s_m`, at most this fast.

    `path` is None until it is planned. `tracked_x_m` ahead on the body is what stays on it.
    `frees_itself`: where the robot is stuck, the mission backs out of it and tries again.
    """

    path: Path | None
    s_m: float
    max_speed_mps: float
    tool_on: bool
    status: MissionStatus
    tracked_x_m: float = 0.0
    frees_itself: bool = False
    bounds: FieldBounds | None = None  # bounds of the field that must not be left
