"""The numbers of each tick that the plots need, instead of whole records."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.implements.zones import ZoneMap
from agribot.core.config import RunConfig
from agribot.core.geo import compass_deg_from_yaw
from agribot.core.growing_table import GrowingTable
from agribot.core.messages import FloatArray, MappedPlant, Path, Row, TickRecord
from agribot.core.world import WorldSpec
from agribot.record.events import Event

_MIN_COURSE_SPEED_MPS = 0.15  # speed below which the direction of a GNSS velocity is mostly noise


class RunSeries(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Arrays over the N ticks, (N,) each, NaN where the tick had no value.

    `distance_m` (N,) is driven distance by the estimate; `row` (N,) the row being worked, -1
    between rows; `row_seen` (N,) is 1 where a camera sees crop where that row is to be, else 0.
    `raw_compass` (M, 2), `course_compass` (K, 2): t_s and degrees clockwise from
    North, of the magnetometer and of the GNSS velocity. `truth` (T, 4): t_s, x, y, yaw.
    """

    t_s: FloatArray
    x_map_m: FloatArray
    y_map_m: FloatArray
    compass_deg: FloatArray
    speed_mps: FloatArray
    commanded_mps: FloatArray
    pos_std_m: FloatArray
    cross_track_m: FloatArray
    row: npt.NDArray[np.int64]
    row_seen: FloatArray
    distance_m: FloatArray
    raw_compass: FloatArray
    course_compass: FloatArray
    truth: FloatArray


class RunData(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All that figures and the report page show besides the report's own numbers.

    `world` is the simulated field, None on a real one, and `crushed` its crops that were crushed,
    as indices. `zones` are those of a prescription. `drawn_field` is the text of a field file of
    the rows that the robot found.
    """

    config: RunConfig
    series: RunSeries
    rows: tuple[Row, ...] = ()
    plan: Path | None = None
    goals_map_m: tuple[tuple[float, float], ...] = ()
    plants: tuple[MappedPlant, ...] = ()
    events: tuple[Event, ...] = ()
    crushed: tuple[int, ...] = ()
    world: WorldSpec | None = None
    zones: ZoneMap | None = None
    drawn_field: str = ""


class SeriesTap:
    """A tap that collects the series while the robot runs."""

    def __init__(self) -> None:
        self._ticks = GrowingTable(10)
        self._raw = GrowingTable(2)
        self._course = GrowingTable(2)
        self._truth = GrowingTable(4)

    def __call__(self, record: TickRecord) -> None:
        estimate, tracking = record.estimate, record.tracking
        known = estimate.ok
        self._ticks.append(
            (
                record.batch.t_s,
                estimate.x_map_m if known else math.nan,
                estimate.y_map_m if known else math.nan,
                compass_deg_from_yaw(estimate.yaw_map_rad) if known else math.nan,
                estimate.v_mps,
                record.command.drive.v_mps,
                estimate.pos_std_m if known else math.nan,
                tracking.cross_track_m if tracking is not None else math.nan,
                record.status.row,
                math.nan if estimate.row_seen is None else float(estimate.row_seen),
            )
        )
        for mag in record.batch.mag:
            heading = math.degrees(math.atan2(mag.field_t[1], mag.field_t[0])) % 360.0
            self._raw.append((mag.t_s, heading))
        for fix in record.batch.gnss:
            if fix.velocity_mps is not None:
                east, north, _ = fix.velocity_mps
                if math.hypot(east, north) > _MIN_COURSE_SPEED_MPS:
                    course = compass_deg_from_yaw(math.atan2(north, east))
                    self._course.append((fix.t_s, course))

    def truth(self, t_s: float, pose: tuple[float, float, float]) -> None:
        """Record the true x_map_m, y_map_m, yaw_map_rad of a simulator."""
        self._truth.append((t_s, *pose))

    def series(self) -> RunSeries:
        ticks = self._ticks.to_array()
        return RunSeries(
            t_s=ticks[:, 0],
            x_map_m=ticks[:, 1],
            y_map_m=ticks[:, 2],
            compass_deg=ticks[:, 3],
            speed_mps=ticks[:, 4],
            commanded_mps=ticks[:, 5],
            pos_std_m=ticks[:, 6],
            cross_track_m=ticks[:, 7],
            row=ticks[:, 8].astype(np.int64),
            row_seen=ticks[:, 9],
            distance_m=_sum_distance_m(ticks[:, 0], ticks[:, 4]),
            raw_compass=self._raw.to_array(),
            course_compass=self._course.to_array(),
            truth=self._truth.to_array(),
        )


def collect(records: Iterable[TickRecord], truth: FloatArray | None = None) -> RunSeries:
    """Collect the series of a recording; `truth` (N, 4) is as `replay.read_truth` gives it."""
    tap = SeriesTap()
    for record in records:
        tap(record)
    series = tap.series()
    return series if truth is None else msgspec.structs.replace(series, truth=truth)


def join_series(parts: Sequence[tuple[RunSeries, float]]) -> RunSeries:
    """Join series, each with the time at which it began on the clock of the first."""
    driven_m = 0.0
    columns: dict[str, list[Any]] = {name: [] for name in RunSeries.__struct_fields__}
    for series, began_s in parts:
        for name, values in columns.items():
            values.append(_shift_column(name, getattr(series, name), began_s, driven_m))
        driven_m += float(series.distance_m[-1]) if len(series.distance_m) else 0.0
    return RunSeries(**{name: np.concatenate(values) for name, values in columns.items()})


def _shift_column(name: str, values: FloatArray, began_s: float, driven_m: float) -> FloatArray:
    if name == "distance_m":
        return values + driven_m
    if name == "t_s":
        return values + began_s
    if name in ("raw_compass", "course_compass", "truth"):
        later: FloatArray = values + np.array([began_s] + [0.0] * (values.shape[1] - 1))
        return later
    return values


def _sum_distance_m(t_s: FloatArray, speed_mps: FloatArray) -> FloatArray:
    steps_s = np.diff(t_s, prepend=t_s[:1])
    return np.cumsum(np.abs(speed_mps) * steps_s)
