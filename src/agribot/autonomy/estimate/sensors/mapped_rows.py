"""Rows as the map of a field draws them: any number of lines, each with its own course."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from agribot.autonomy.estimate.filter.field_rows import RowFrame, find_axes
from agribot.core.geo import wrap_rad
from agribot.core.messages import MapPoint

# Way on either side of a corner of its line over which a row turns.
BLEND_M = 0.5
# Points of a line nearer to each other than this are one.
SAME_POINT_M = 1e-3
NO_ROW = -1


class MappedRows:
    """Lines of two or more points (m, map), from the first plant to the last, in any order.

    A place belongs to the line that is nearest to it; beyond its ends a line goes straight on.
    All lines are read in one direction, that of the first one: `along_m` counts on the line of
    the place, `right_m` is counted from that line too.
    """

    def __init__(self, lines: Sequence[Sequence[MapPoint]], spacing_m: float | None = None) -> None:
        self.spacing_m = spacing_m
        kept = [points for line in lines if len(points := _drop_repeated(line)) > 1]
        self.yaw_rad = math.atan2(*_chord(kept[0])[::-1]) if kept else 0.0
        ahead = (math.cos(self.yaw_rad), math.sin(self.yaw_rad))
        ways = [line if _dot(_chord(line), ahead) >= 0.0 else line[::-1] for line in kept]
        pieces = [piece for row, way in enumerate(ways) for piece in _list_pieces(row, way)]
        table = np.array(pieces, dtype=np.float64).reshape(-1, 9)
        self._start, self._ahead = table[:, :2], table[:, 2:4]
        self._length_m, self._along_m = table[:, 4], table[:, 5]
        self._turns_rad = table[:, 6:8]  # directions from the piece to the middle of its corners
        self._row = table[:, 8].astype(int)
        self._row_length_m = [_measure_length_m(way) for way in ways]

    @property
    def has_rows(self) -> bool:
        return bool(self._row_length_m)

    def at(self, x_map_m: float, y_map_m: float) -> RowFrame:
        if not self.has_rows:
            return RowFrame(
                0.0, 0.0, self.yaw_rad, *find_axes(self.yaw_rad), 1.0, NO_ROW, 0.0, 0.0, math.inf
            )
        dx, dy = x_map_m - self._start[:, 0], y_map_m - self._start[:, 1]
        on_m = dx * self._ahead[:, 0] + dy * self._ahead[:, 1]
        inside_m = np.clip(on_m, 0.0, self._length_m)
        off_x, off_y = dx - inside_m * self._ahead[:, 0], dy - inside_m * self._ahead[:, 1]
        piece = int(np.argmin(off_x * off_x + off_y * off_y))
        row, length_m = int(self._row[piece]), float(self._length_m[piece])
        foot_m, way_m = float(inside_m[piece]), float(on_m[piece])
        cos, sin = self._ahead[piece].tolist()
        right_m = float(dx[piece] * sin - dy[piece] * cos)
        is_past = self._is_past_end(piece, way_m)
        if not is_past and foot_m != way_m:  # outside a bend its corner is what is nearest
            right_m = math.copysign(math.hypot(off_x[piece], off_y[piece]), right_m)
        yaw_rad = wrap_rad(math.atan2(sin, cos) + self._turn_rad(piece, foot_m, length_m))
        forward, right = find_axes(yaw_rad)
        foot = (
            float(self._start[piece, 0]) + foot_m * cos,
            float(self._start[piece, 1]) + foot_m * sin,
        )
        return RowFrame(
            along_m=float(self._along_m[piece]) + (way_m if is_past else foot_m),
            right_m=right_m,
            yaw_rad=yaw_rad,
            forward=forward,
            right=right,
            stretch=1.0,
            row=row,
            row_right_m=0.0,
            length_m=self._row_length_m[row],
            pitch_m=self._measure_pitch_m(row, foot),
        )

    def _is_past_end(self, piece: int, way_m: float) -> bool:
        """Whether a place lies before the first or behind the last point of its row."""
        row = self._row[piece]
        is_first = piece == 0 or self._row[piece - 1] != row
        is_last = piece + 1 == len(self._row) or self._row[piece + 1] != row
        return (is_first and way_m < 0.0) or (is_last and way_m > self._length_m[piece])

    def _turn_rad(self, piece: int, foot_m: float, length_m: float) -> float:
        """Turn of the row at a piece of its line, towards the nearer corner."""
        blend_m = min(BLEND_M, length_m / 2.0)
        before, behind = self._turns_rad[piece].tolist()
        parts = 1.0 - foot_m / blend_m, 1.0 - (length_m - foot_m) / blend_m
        return float(before * max(parts[0], 0.0) + behind * max(parts[1], 0.0))

    def _measure_pitch_m(self, row: int, foot: MapPoint) -> float:
        """Measure from a point of a row to the nearest other one; infinite without any."""
        others = self._row != row
        dx, dy = foot[0] - self._start[others, 0], foot[1] - self._start[others, 1]
        ahead_x, ahead_y = self._ahead[others].T
        on_m = np.clip(dx * ahead_x + dy * ahead_y, 0.0, self._length_m[others])
        apart_m = np.hypot(dx - on_m * ahead_x, dy - on_m * ahead_y)
        return float(apart_m.min()) if len(apart_m) else math.inf


def _list_pieces(row: int, way: Sequence[MapPoint]) -> list[tuple[float, ...]]:
    """List start, direction, length, place along the row, turns at both corners, and the row."""
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(way)]
    yaws = [math.atan2(dy, dx) for dx, dy in steps]
    corners = [0.0, *(wrap_rad(b - a) / 2.0 for a, b in pairwise(yaws)), 0.0]
    pieces: list[tuple[float, ...]] = []
    along_m = 0.0
    for index, (dx, dy) in enumerate(steps):
        length_m = math.hypot(dx, dy)
        turns = (-corners[index], corners[index + 1])
        pieces.append(
            (*way[index], dx / length_m, dy / length_m, length_m, along_m, *turns, float(row))
        )
        along_m += length_m
    return pieces


def _drop_repeated(line: Sequence[MapPoint]) -> list[MapPoint]:
    kept: list[MapPoint] = []
    for x_m, y_m in line:
        if not kept or math.dist(kept[-1], (x_m, y_m)) > SAME_POINT_M:
            kept.append((float(x_m), float(y_m)))
    return kept


def _measure_length_m(way: Sequence[MapPoint]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(way))


def _chord(line: Sequence[MapPoint]) -> MapPoint:
    return line[-1][0] - line[0][0], line[-1][1] - line[0][1]


def _dot(a: MapPoint, b: MapPoint) -> float:
    return a[0] * b[0] + a[1] * b[1]
