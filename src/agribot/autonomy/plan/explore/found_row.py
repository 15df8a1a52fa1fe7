"""A row that the robot finds: where its line runs, as far as it was seen, and how well."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from agribot.autonomy.plan.explore.crop_view import CropView, place_line
from agribot.core.growing_table import GrowingTable
from agribot.core.messages import FloatArray, MapPoint, Row, RowLine
from agribot.core.pose import Pose2

PIECE_M, LOOK_M = 0.25, 0.1
REAL_RATIO = 0.3
# The part of the seen line within these distances behind and ahead of a place gives its direction
# there.
BEHIND_M, AHEAD_M, FEWEST = 2.5, 1.5, 4
DRAWN_M = 3.0
# Leaves this near to the line are the row's.
HALF_STRIP_M, WINDOW_M = 0.15, 0.25
# Crop counts if this many pictures show it: single ones mistake a weed for it.
LOOKS, CELLS, CROP_RATIO = 2, 3, 0.35
WHOLE = 0.5  # share of a piece's cells that must be in view
# Distance over which the direction of a line seen in one picture holds, m.
ARM_M = 0.5
# Errors of a picture's line that its neighbours share; see estimate/filter/row_model.py.
SHARED_STD_M = 0.01
# A row whose middle is nearer to its chord than this is straight.
LEAST_BEND_M = 0.05


class _Looks:
    """Counts of views of a row's pieces, and of those with crop."""

    def __init__(self) -> None:
        self.crop: Counter[int] = Counter()
        self.views: Counter[int] = Counter()

    def add(self, crop: Iterable[int], views: Iterable[int]) -> None:
        self.crop.update(crop)
        self.views.update(views)

    def list_grown(self, least: int = LOOKS) -> list[int]:
        """List pieces that bear crop: `least` pictures show it, and a good part of all."""
        return [
            piece for piece, looks in self.crop.items()
            if looks >= least and looks >= CROP_RATIO * self.views[piece]
        ]  # fmt: skip


class FoundRow:
    """Places on it count along `frame`, which begins at the crop that was seen first."""

    def __init__(self, index: int, frame: Pose2) -> None:
        self.index, self.frame = index, frame
        self.is_driven = False
        self.is_real = True  # a robot that drove it saw crop on it
        self._places = GrowingTable(2)  # along the frame, and to its left
        self._from_beside = GrowingTable(2)  # the same, as a robot saw it from beside
        self._drawn: Row | None = None  # once it is driven, nothing changes any more
        self._looks, self._astride = _Looks(), _Looks()  # all of them, and those from astride it
        self.pos_std_m = 0.0  # position error of the robot while it looked, 1 sigma

    @property
    def has_crop(self) -> bool:
        return bool(self._looks.list_grown())

    @property
    def first_m(self) -> float:
        """Start of its crop, along its frame."""
        return min(self._looks.list_grown(), default=0) * LOOK_M

    @property
    def last_m(self) -> float:
        """End of its crop."""
        return (max(self._looks.list_grown(), default=-1) + 1) * LOOK_M

    @property
    def length_m(self) -> float:
        return self.last_m - self.first_m

    def add_from_beside(self, left_m: float, pieces: Sequence[int], beside: FoundRow) -> None:
        """Take where it bears crop from a row that it runs beside, which has the same frame."""
        for piece in pieces:
            along_m = (piece + 0.5) * PIECE_M
            first = round(piece * PIECE_M / LOOK_M)
            crop = (first, first + 1) * LOOKS
            self._looks.add(crop, crop)
            self._from_beside.append((along_m, left_m + beside._fit(along_m, 1.0)[1]))

    def finish(self) -> None:
        """Note that it was driven: what was seen from beside it is not needed any more."""
        self.is_driven = True
        grown_m = len(self._astride.list_grown()) * LOOK_M
        self.is_real = grown_m >= REAL_RATIO * self.length_m
        if self.is_real:
            self._looks, self._from_beside = self._astride, GrowingTable(2)

    def move(self, left_m: float) -> None:
        """Move all of it to the left of its frame."""
        self.frame = Pose2(*self.frame.transform(0.0, left_m), self.frame.yaw_rad)
        self._drawn = None

    def add_line(self, line: RowLine, pose: Pose2) -> Pose2 | None:
        """Take in a picture's line that was seen from a pose, and place it in the map.

        It is read the way the frame looks. None: the picture has no line.
        """
        there = place_line(line, pose)
        if there is None:
            return None
        for ahead_m in (0.0, ARM_M):
            self._places.append(self.frame.locate(*there.transform(ahead_m, 0.0)))
        is_along = math.cos(there.yaw_rad - self.frame.yaw_rad) > 0.0
        return there if is_along else Pose2(*there.xy_m, there.yaw_rad + math.pi)

    def add_crop(self, view: CropView, line: Pose2 | None = None, *, is_astride: bool) -> None:
        """Add what a picture shows of it; from beside it, this also shows where it runs.

        `line` is where the picture itself shows it.
        """
        crop_map_m = view.crop_map_m
        seen = self._list_seen(view.seen_map_m, line)
        along_m, left_m = self.frame.locate(crop_map_m[:, 0], crop_map_m[:, 1])
        off_m = left_m - self._left_m(along_m, line)
        mine = np.abs(off_m) <= HALF_STRIP_M
        piece, count = np.unique(np.floor(along_m[mine] / LOOK_M), return_counts=True)
        grown = [int(p) for p, n in zip(piece, count, strict=True) if n >= CELLS]
        self._looks.add(grown, seen)
        if is_astride:
            self._astride.add(grown, seen)
            return
        near = np.abs(off_m) <= WINDOW_M
        pieces = np.floor(along_m[near] / PIECE_M)
        for each in np.unique(pieces):
            here = pieces == each
            if np.count_nonzero(here) >= CELLS:
                self._from_beside.append(
                    (float(along_m[near][here].mean()), float(left_m[near][here].mean()))
                )

    def _list_seen(self, seen_map_m: FloatArray, line: Pose2 | None) -> list[int]:
        along_m, left_m = self.frame.locate(seen_map_m[:, 0], seen_map_m[:, 1])
        on = np.abs(left_m - self._left_m(along_m, line)) <= HALF_STRIP_M
        piece, count = np.unique(np.floor(along_m[on] / LOOK_M), return_counts=True)
        return [int(p) for p, n in zip(piece, count, strict=True) if n >= WHOLE * count.max()]

    def measure_bare_m(
        self, seen_map_m: FloatArray, towards: float, line: Pose2 | None = None
    ) -> float:
        """Measure how far a picture shows its line beyond any crop, the way of a sign."""
        along_m, left_m = self.frame.locate(seen_map_m[:, 0], seen_map_m[:, 1])
        on = np.abs(left_m - self._left_m(along_m, line)) <= CELLS * 0.025
        if not np.any(on):
            return -math.inf
        pieces = [*self._looks.list_grown(1), math.floor(self.first_m / LOOK_M)]
        if towards > 0.0:
            return float(along_m[on].max()) - (max(pieces) + 1) * LOOK_M
        return min(pieces) * LOOK_M - float(along_m[on].min())

    def line_at(self, along_m: float, towards: float = 1.0) -> Pose2:
        """Place its line beside a place along it, in the map, read the way of a sign."""
        slope, left_m = self._fit(along_m, towards)
        yaw_rad = self.frame.yaw_rad + math.atan(slope)
        x_m, y_m = self.frame.transform(along_m, left_m)
        return Pose2(x_m, y_m, yaw_rad if towards > 0.0 else yaw_rad + math.pi)

    def _fit(
        self, along_m: float, towards: float, reach_m: float | None = None
    ) -> tuple[float, float]:
        low_m, high_m = (BEHIND_M, AHEAD_M) if towards > 0.0 else (AHEAD_M, BEHIND_M)
        low_m, high_m = (low_m, high_m) if reach_m is None else (reach_m, reach_m)
        # The view astride a row is newer than the view from beside it.
        for places in (self._places.to_array(), self._list_places()):
            near = (places[:, 0] >= along_m - low_m) & (places[:, 0] <= along_m + high_m)
            if np.count_nonzero(near) >= FEWEST and np.ptp(places[near, 0]) >= PIECE_M:
                break
        else:
            near = np.ones(len(places), dtype=bool)
        if np.count_nonzero(near) < FEWEST or np.ptp(places[near, 0]) < PIECE_M:
            return 0.0, 0.0
        slope, left_m = np.polyfit(places[near, 0] - along_m, places[near, 1], 1)
        return float(slope), float(left_m)

    def _list_places(self) -> FloatArray:
        places = self._places.to_array()
        return (
            np.concatenate([places, self._from_beside.to_array()])
            if len(self._from_beside)
            else places
        )

    def _left_m(self, along_m: FloatArray, line: Pose2 | None) -> FloatArray:
        """Place its line left of the frame, at places (N,) that a picture shows together."""
        if not len(along_m):
            return along_m
        if line is not None:
            at_m, left_m = self.frame.locate(*line.xy_m)
            return left_m + math.tan(line.yaw_rad - self.frame.yaw_rad) * (along_m - at_m)
        middle_m = float(np.median(along_m))
        slope, left_m = self._fit(middle_m, 1.0)
        return left_m + slope * (along_m - middle_m)

    def draw(self, step_m: float = 0.5) -> list[MapPoint]:
        """Draw its line from its first to its last crop, a point every `step_m`.

        All that was seen within DRAWN_M of a point determines its place.
        """
        count = max(1, math.ceil(self.length_m / step_m))
        along_m = self.first_m + np.arange(count + 1) * self.length_m / count
        return [self._place(float(at)) for at in along_m]

    def _place(self, along_m: float) -> MapPoint:
        return self.frame.transform(along_m, self._fit(along_m, 1.0, DRAWN_M)[1])

    @property
    def std_m(self) -> float:
        """1 sigma of its place across, the robot's own place and what pictures share included."""
        places = self._list_places()
        rest_m = [left_m - self._fit(along_m, 1.0)[1] for along_m, left_m in places[::5].tolist()]
        scatter_m = float(np.std(rest_m)) if rest_m else 0.0
        return math.hypot(scatter_m, self.pos_std_m, SHARED_STD_M)

    def as_row(self) -> Row:
        """Give its chord, bent as its middle stands off it."""
        if self._drawn is not None:
            return self._drawn
        row = self._draw_chord()
        self._drawn = row if self.is_driven else None
        return row

    def _draw_chord(self) -> Row:
        last_m = max(self.last_m, self.first_m + PIECE_M)
        start, end = self._place(self.first_m), self._place(last_m)
        yaw_rad, chord_m = math.atan2(end[1] - start[1], end[0] - start[0]), math.dist(start, end)
        middle = self._place((self.first_m + last_m) / 2.0)
        _, left_m = Pose2(*start, yaw_rad).locate(*middle)
        bend = -8.0 * left_m / chord_m**2 if abs(left_m) > LEAST_BEND_M else 0.0
        return Row(index=self.index, start_map_m=start, end_map_m=end, curvature_radpm=bend)
