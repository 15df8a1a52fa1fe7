"""Lines around a field as its outline: closed, without what was walked twice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import FloatArray
from agribot.gis.geojson import MAX_POINTS, LonLat, close_ring

if TYPE_CHECKING:
    import shapely

GAP_M = 10.0  # distance of the begin and the end of a walk around a field
GAP_RATIO = 0.05  # the same as a share of the way around
# Area by the square of the way around: 0.063 of a square, 0.02 of ten by one. A line to and fro
# along neighbouring rows has less and is no outline.
LEAST_COMPACTNESS = 0.005
END_RATIO = 0.25  # share of a walk's points in which its end is searched for on its begin
LEAST_MAIN_RATIO = 0.95  # least share of the largest part in the area that a line encloses
CROSSINGS = "loops where it crosses itself cut off"
_LEAST_CORNERS = 4


class ClosedLine(NamedTuple):
    """A closed ring, and in a few words what was changed to make it one; empty for nothing."""

    ring: list[LonLat]
    change: str = ""


def find_gap_m(way_m: float) -> float:
    """Return the largest gap over which a walk of this length is closed."""
    return min(GAP_M, GAP_RATIO * way_m)


def close_line(points: Sequence[LonLat], *, is_area: bool = False) -> ClosedLine | None:
    """Close a line that goes around an area; None where it does not, unless `is_area` says so."""
    if not _LEAST_CORNERS <= len(points) <= MAX_POINTS:
        return ClosedLine(close_ring(list(points))) if is_area and points else None
    frame = MapFrame(Datum(lat_deg=points[0][1], lon_deg=points[0][0]))
    xy_m = frame.map_from_lonlat(np.array(points, float))
    steps_m = np.hypot(*np.diff(xy_m, axis=0).T)
    first, last = _find_ends(xy_m, float(steps_m.sum()))
    gap_m = math.dist(xy_m[first], xy_m[last])
    if gap_m > find_gap_m(float(steps_m.sum())) and not is_area:
        return None
    drawn = _draw(xy_m[first : last + 1])
    enclosed = _find_enclosed(drawn)
    around_m = float(steps_m[first:last].sum()) + gap_m
    if not is_area and sum(part.area for part in enclosed) < LEAST_COMPACTNESS * around_m**2:
        return None
    ring = close_ring(list(points[first : last + 1]))
    walked_m = float(steps_m[:first].sum() + steps_m[last:].sum())
    change = _describe(gap_m, walked_m)
    if drawn.is_valid or not enclosed or not _is_main(enclosed):
        return ClosedLine(ring, change)
    main = np.array(enclosed[0].exterior.coords)
    cut = [(float(lon), float(lat)) for lon, lat in frame.lonlat_from_map(main)]
    return ClosedLine(cut, ", ".join([change, CROSSINGS] if change else [CROSSINGS]))


def _is_main(parts: Sequence[shapely.Polygon]) -> bool:
    return parts[0].area >= LEAST_MAIN_RATIO * sum(part.area for part in parts)


def join_lines(lines: Sequence[list[LonLat]]) -> list[list[LonLat]]:
    """Join the parts of a walk around a field that was paused; other lines stay as they are."""
    whole = [point for line in lines for point in line]
    if len(lines) < 2 or close_line(whole) is None:
        return list(lines)
    frame = MapFrame(Datum(lat_deg=whole[0][1], lon_deg=whole[0][0]))
    ends = frame.map_from_lonlat(np.array([(line[0], line[-1]) for line in lines]).reshape(-1, 2))
    pauses_m = np.hypot(*(ends[2::2] - ends[1:-1:2]).T)
    steps = np.diff(frame.map_from_lonlat(np.array(whole, float)), axis=0)
    way_m = float(np.hypot(*steps.T).sum())
    return [whole] if float(pauses_m.max()) <= find_gap_m(way_m) else list(lines)


def _find_ends(xy_m: FloatArray, way_m: float) -> tuple[int, int]:
    """Find where a walk begins and where it comes back there; what lies behind is walked twice."""
    last = len(xy_m) - 1
    if math.dist(xy_m[0], xy_m[last]) <= find_gap_m(way_m):
        return 0, last
    count = max(1, int(END_RATIO * len(xy_m)))
    head, tail = xy_m[:count], xy_m[-count:]
    apart_m = np.hypot(*(head[:, None, :] - tail[None, :, :]).transpose(2, 0, 1))
    begin, end = np.unravel_index(int(np.argmin(apart_m)), apart_m.shape)
    return int(begin), len(xy_m) - count + int(end)


def _draw(xy_m: FloatArray) -> shapely.Polygon:
    import shapely

    return shapely.Polygon(xy_m)


def _find_enclosed(drawn: shapely.Polygon) -> list[shapely.Polygon]:
    """Find the areas that a ring encloses, the largest first: several where it crosses itself."""
    import shapely

    if drawn.is_valid:
        return [drawn]
    faces = shapely.get_parts(shapely.polygonize([shapely.node(drawn.exterior)]))
    parts = shapely.get_parts(shapely.union_all(faces)).tolist() if len(faces) else []
    return sorted(parts, key=lambda part: -float(part.area))


def _describe(gap_m: float, walked_m: float) -> str:
    said = []
    if gap_m > 0.0:
        said.append(f"closed over {gap_m:.1f} m")
    if walked_m > 0.0:
        said.append(f"{walked_m:.0f} m behind its end left out")
    return ", ".join(said)
