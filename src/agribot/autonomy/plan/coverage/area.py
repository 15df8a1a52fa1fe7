"""What a field plan is made from and what it consists of; metres in the map frame."""

from __future__ import annotations

import math
from typing import Literal

import msgspec
import numpy as np

from agribot.core.messages import FloatArray, MapPoint

MapLine = tuple[MapPoint, ...]
LegKind = Literal["swath", "headland", "row", "link", "arc", "reverse"]
TurnStyle = Literal["auto", "pivot", "arc", "three-point"]
WORKING: tuple[LegKind, ...] = ("swath", "headland", "row")
MARGIN_M, MOST_MARGIN_M = 0.05, 10.0  # to every edge, for a robot that knows where it is; limit
# Largest part of the margin that also counts to crop where the robot turns.
MOST_CROP_MARGIN_M = 0.5


class FieldArea(msgspec.Struct, frozen=True, kw_only=True):
    """A field: outer ring, holes that must not be entered, and what is marked in it.

    Rings do not repeat their first point. `rows` are crop rows to be straddled, `crop` rows that
    stand there, maybe beyond the boundary, and are not worked: no wheel comes near them. The
    swaths run along `ab_line`, from its first to its last point. `margin_m` is the default margin
    of a plan between the footprint and every edge.
    """

    boundary: MapLine
    holes: tuple[MapLine, ...] = ()
    rows: tuple[MapLine, ...] = ()
    crop: tuple[MapLine, ...] = ()
    ab_line: MapLine = ()
    waypoints: MapLine = ()
    margin_m: float = MARGIN_M
    left_out: str = ""  # omitted contents of the file, in one line

    @property
    def standing(self) -> tuple[MapLine, ...]:
        """All rows of crop, worked or not."""
        return (*self.rows, *self.crop)

    def choose_margin_m(self, asked_m: float | None) -> float:
        return self.margin_m if asked_m is None else asked_m


class Leg(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stretch of the way: points (N, 2) in driving order, at least two.

    The robot turns in place between legs and at the corners of a `link`; along all other kinds
    it bends no tighter than the drive can. A `reverse` leg is driven backwards. `row` numbers the
    working legs, -1 elsewhere.
    """

    kind: LegKind
    xy_map_m: FloatArray
    row: int = -1

    @property
    def tool_on(self) -> bool:
        return self.kind in WORKING

    @property
    def is_reverse(self) -> bool:
        return self.kind == "reverse"

    @property
    def length_m(self) -> float:
        return float(np.sum(np.hypot(*np.diff(self.xy_map_m, axis=0).T)))


class PlanRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Requirements of a field plan.

    `headland_passes` None: as few as do, none with crop rows. `swath_yaw_rad` None: searched for.
    `start` None: the best place to begin.
    """

    implement_width_m: float
    overlap_m: float = 0.05  # overlap of neighbouring swaths, for the error of the steering
    margin_m: float = MARGIN_M  # distance of the footprint from everything that is forbidden
    headland_passes: int | None = None
    swath_yaw_rad: float | None = None
    start_map_m: MapPoint | None = None
    turns: TurnStyle = "auto"
    plant_clearance_m: float = 0.1
    min_coverage_ratio: float = 0.99
    tool_x_m: float = 0.0  # tool point on the body; negative behind the origin

    @property
    def turn_clearance_m(self) -> float:
        """Distance of wheels from crop in turns: the margin of an edge counts there too."""
        return max(self.plant_clearance_m, min(self.margin_m, MOST_CROP_MARGIN_M))

    @property
    def spacing_m(self) -> float:
        return self.implement_width_m - self.overlap_m

    def passes(self, has_rows: bool) -> int:
        """Count the headland passes: a swath can be left until its tool has worked it."""
        if self.headland_passes is not None:
            return self.headland_passes
        if has_rows:
            return 0
        depth_m = abs(self.tool_x_m) - self.overlap_m / 2.0
        return max(1, math.ceil(depth_m / self.spacing_m + 0.5 - 1e-9))


class FieldPlan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Legs that join end to end, and the direction of the swaths."""

    legs: tuple[Leg, ...]
    swath_yaw_rad: float
    warnings: tuple[str, ...] = ()
