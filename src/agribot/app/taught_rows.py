"""Rows taught by driving: the track of a recording becomes lines that a field is read from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median_low
from typing import NamedTuple

import numpy as np

from agribot.app.run_recording import find_recording
from agribot.autonomy.control.fence import measure_growth_m
from agribot.core.errors import MissionError
from agribot.core.facts import MarksOdd, NoFixesIn, NoStretch, NotMoved, RowWithoutLength
from agribot.core.geo import Datum, MapFrame, make_datum
from agribot.core.messages import FloatArray, MarkMoment
from agribot.gis.drawn_field import DrawnRow, format_drawn_field

STEP_M = 0.05  # distance between points of a track; a robot that stands adds none
# Limits of a row: a larger bend over this way is a turn, and a shorter stretch is no row.
TURN_RADPM, BEND_OVER_M, SHORTEST_M = 0.25, 1.0, 2.0
# Nothing drives faster that teaches rows: between two fixes one of them is wrong. Stamps that do
# not go on are taken for as far apart as those of a quick receiver.
MOST_MPS, LEAST_STEP_S = 15.0, 0.1


class DrivenTrack(NamedTuple):
    """Track of a robot: t_s, x and y (m, map) and 1 sigma of its place, (N, 4).

    `marks_s` are when its driver marked the beginnings and the ends of rows. `unsure_m` is how far
    from an edge the fence would have kept the robot; nothing, where only its fixes are known.
    `left_out` fixes lie where no robot could have driven between the others.
    """

    points: FloatArray
    marks_s: tuple[float, ...]
    datum: Datum
    unsure_m: float = 0.0
    left_out: int = 0


class TaughtField(NamedTuple):
    """The text of a field file, its rows, and how many fixes were left out as wrong."""

    text: str
    rows: int
    left_out: int


def find_drive(recording: Path) -> Path:
    """Find the recording of a run by its folder; a rosbag2 folder or a file is one itself."""
    found = find_recording(recording)
    return found if found.exists() else recording


def teach_rows(recording: Path) -> TaughtField:
    """Make a field file of a drive.

    Rows run from one mark to the next; without marks, every stretch is one on which the robot
    did not turn. Raises: AgribotError: not a recording, or one without a row.
    """
    path = find_drive(recording)
    track = _read(path)
    stretches = split_by_marks(track) if track.marks_s else split_by_turns(track.points)
    if not stretches:
        raise MissionError(NoStretch(str(path), SHORTEST_M))
    rows = [_draw(stretch) for stretch in stretches]
    text = format_drawn_field(rows, track.points[:, 1:3], track.datum, track.unsure_m)
    return TaughtField(text, len(rows), track.left_out)


def split_by_marks(track: DrivenTrack) -> list[FloatArray]:
    """Cut the stretches between the first and second mark, the third and fourth, and so on.

    Raises: MissionError: a row has no end, or no length.
    """
    marks_s = track.marks_s
    if len(marks_s) % 2:
        raise MissionError(MarksOdd(len(marks_s)))
    found = []
    for number, (begin_s, end_s) in enumerate(zip(marks_s[::2], marks_s[1::2], strict=True), 1):
        t_s = track.points[:, 0]
        stretch = track.points[(t_s >= begin_s) & (t_s <= end_s)]
        if len(stretch) < 2:
            raise MissionError(RowWithoutLength(number))
        found.append(stretch)
    return found


def split_by_turns(points: FloatArray) -> list[FloatArray]:
    """Cut a track, (N, 4), where it turns; short stretches between turns are left out."""
    if len(points) < 3:
        return []
    step = np.diff(points[:, 1:3], axis=0)
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
    half_m = BEND_OVER_M / 2.0
    before, behind = (
        np.column_stack([np.interp(way_m + side, way_m, points[:, axis]) for axis in (1, 2)])
        for side in (-half_m, half_m)
    )
    came, goes = points[:, 1:3] - before, behind - points[:, 1:3]
    across = came[:, 0] * goes[:, 1] - came[:, 1] * goes[:, 0]
    turned_rad = np.arctan2(across, np.einsum("ij,ij->i", came, goes))
    is_turn = np.abs(turned_rad) > TURN_RADPM * half_m
    edges = np.flatnonzero(np.diff(is_turn)) + 1
    runs = np.split(np.arange(len(points)), edges)
    return [
        points[run] for run in runs
        if not is_turn[run[0]] and way_m[run[-1]] - way_m[run[0]] >= SHORTEST_M
    ]  # fmt: skip


def keep_driven(points: FloatArray) -> FloatArray:
    """Leave out points of a track, (N, 4), from which no robot could drive to the most others."""
    jumps = [not _is_drivable(a, b) for a, b in pairwise(points)]
    runs = np.split(points, np.flatnonzero(jumps) + 1)
    longest = max(range(len(runs)), key=lambda k: len(runs[k]))
    kept = [runs[longest]]
    for run in runs[longest + 1 :]:
        kept += [run] if _is_drivable(kept[-1][-1], run[0]) else []
    for run in reversed(runs[:longest]):
        kept = [run, *kept] if _is_drivable(run[-1], kept[0][0]) else kept
    return np.concatenate(kept)


def _is_drivable(a: FloatArray, b: FloatArray) -> bool:
    step_s = max(abs(b[0] - a[0]), LEAST_STEP_S)
    return bool(math.dist(a[1:3], b[1:3]) <= MOST_MPS * step_s)


def _draw(stretch: FloatArray) -> DrawnRow:
    known = stretch[np.isfinite(stretch[:, 3]), 3]
    std_m = math.sqrt(float(np.mean(known**2))) if len(known) else math.nan
    return DrawnRow([(float(x_m), float(y_m)) for x_m, y_m in stretch[:, 1:3]], std_m)


def _read(path: Path) -> DrivenTrack:
    """Read a run of ours, or the fixes of any other recording."""
    from agribot.core import topics
    from agribot.record.bag.opening import open_bag

    with open_bag(path) as bag:
        is_ours = any(topic.name == topics.TICK.name for topic in bag.topics)
    return _read_run(path) if is_ours else _read_fixes(path)


def _read_run(path: Path) -> DrivenTrack:
    from agribot.record.replay import read_config, read_ticks

    points: list[tuple[float, float, float, float]] = []
    marks_s: list[float] = []
    config, unsure_m = read_config(path), 0.0
    for record in read_ticks(path):
        here = record.estimate
        marks = [e for e in record.batch.requests if isinstance(e.request, MarkMoment)]
        marks_s += [record.batch.t_s] * len(marks)
        if here.ok and _has_moved(points, here.x_map_m, here.y_map_m):
            if points:  # a robot may not have known its place before it drove
                unsure_m = max(
                    unsure_m, measure_growth_m(here.pos_std_m, here.quality, config.safety)
                )
            points.append((record.batch.t_s, here.x_map_m, here.y_map_m, here.pos_std_m))
    table = _make_table(points, path)
    return DrivenTrack(table, tuple(marks_s), config.field.datum, unsure_m)


def _read_fixes(path: Path) -> DrivenTrack:
    from agribot.record.bag.track import read_track

    fixes = read_track(path).points
    if not fixes:
        raise MissionError(NoFixesIn(str(path)))
    # Any of the places will do, but for that of a receiver that did not know it yet.
    alts_m = [fix.alt_m for fix in fixes if not math.isnan(fix.alt_m)]
    datum = make_datum(
        median_low(fix.lat_deg for fix in fixes),
        median_low(fix.lon_deg for fix in fixes),
        median_low(alts_m or [math.nan]),
    )
    frame, points = MapFrame(datum), list[tuple[float, float, float, float]]()
    for fix in fixes:
        x_m, y_m, _ = frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
        if _has_moved(points, x_m, y_m):
            points.append((fix.t_s, x_m, y_m, math.nan if fix.std_m is None else fix.std_m))
    table = _make_table(points, path)
    driven = keep_driven(table)
    return DrivenTrack(driven, (), datum, left_out=len(table) - len(driven))


def _has_moved(points: Sequence[tuple[float, ...]], x_m: float, y_m: float) -> bool:
    return not points or math.dist(points[-1][1:3], (x_m, y_m)) >= STEP_M


def _make_table(points: Sequence[tuple[float, ...]], path: Path) -> FloatArray:
    if len(points) < 2:
        raise MissionError(NotMoved(str(path)))
    table: FloatArray = np.array(points, dtype=np.float64)
    return table
