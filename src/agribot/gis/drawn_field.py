"""A field that a robot drew: rows that it drove, in the file from which fields are read."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agribot.autonomy.plan.coverage.area import MARGIN_M, MOST_CROP_MARGIN_M, MOST_MARGIN_M
from agribot.core.arithmetic import clamp
from agribot.core.errors import MissionError
from agribot.core.facts import NothingDriven
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import FloatArray, MapPoint
from agribot.gis.geojson import make_feature

# Ground to both sides of its track that the robot needs for a plan that turns there, m; a camera
# sees 1 m of it. Hollows narrower than twice CLOSED_M belong to the field, too.
BESIDE_TRACK_M, CLOSED_M = 1.45, 1.2
# The drive that draws a field and one that is planned in it are off by some centimetres each.
LEAST_UNSURE_M = 0.1
# A line keeps this close to what the robot drove, so that it has few corners, a straight one two;
# a robot that does not know its place so well has drawn its own error, which may be more.
SIMPLIFIED_M, MOST_SIMPLIFIED_M = 0.02, 0.1
DECIMALS = 9  # a tenth of a millimetre
EDGE_M = 0.05  # accuracy of the boundary's corners


class DrawnRow(NamedTuple):
    """The line of a row from end to end (m, map), and how well it is known across, 1 sigma.

    NaN: not known.
    """

    line: Sequence[MapPoint]
    std_m: float


def format_drawn_field(
    rows: Sequence[DrawnRow], track_map_m: FloatArray, datum: Datum, unsure_m: float = 0.0
) -> str:
    """Write rows with their uncertainty, and the ground that was driven as the boundary.

    `track_map_m` (N, 2) is where the robot was, `unsure_m` how far its fence keeps such a robot
    off every edge. Plans keep it as a margin, and where they turn keep it from crop as well, so
    the boundary is farther away by both.
    Rows are numbered from the first one to the left.
    Raises: MissionError: there is no row.
    """
    if not rows:
        raise MissionError(NothingDriven())
    frame = MapFrame(datum)
    rows = [row._replace(line=_simplify(row)) for row in _sort(rows)]
    unsure_m = max(unsure_m, LEAST_UNSURE_M)
    margin_m = min(MARGIN_M + unsure_m, MOST_MARGIN_M)
    room_m = BESIDE_TRACK_M + unsure_m + min(unsure_m, MOST_CROP_MARGIN_M)
    ring = _draw_boundary(rows, track_map_m, room_m)
    features = [
        make_feature(
            "Polygon", [_to_degrees([*ring, ring[0]], frame)],
            kind="boundary", margin_m=round(margin_m, 2),
        )
    ]  # fmt: skip
    features += [
        make_feature(
            "LineString", _to_degrees(row.line, frame),
            kind="row", name=f"row {number}",
            std_m=round(row.std_m, 4) if math.isfinite(row.std_m) else None,
        )
        for number, row in enumerate(rows, start=1)
    ]  # fmt: skip
    lines = ",\n".join(json.dumps(feature) for feature in features)
    return f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'


def _simplify(row: DrawnRow) -> list[MapPoint]:
    """Leave out points of a line that lie so near to what is left.

    Source: Douglas and Peucker 1973, "Algorithms for the reduction of the number of points",
    Cartographica 10.
    """
    import shapely

    std_m = row.std_m if math.isfinite(row.std_m) else 0.0
    tolerance_m = clamp(std_m, SIMPLIFIED_M, MOST_SIMPLIFIED_M)
    left = shapely.get_coordinates(shapely.LineString(row.line).simplify(tolerance_m))
    return [(float(x_m), float(y_m)) for x_m, y_m in left]


def _sort(rows: Sequence[DrawnRow]) -> list[DrawnRow]:
    """Put rows side by side in order, all in the direction of the first."""
    (x0, y0), (x1, y1) = rows[0].line[0], rows[0].line[-1]
    yaw_rad = math.atan2(y1 - y0, x1 - x0)
    ahead, left = (math.cos(yaw_rad), math.sin(yaw_rad)), (-math.sin(yaw_rad), math.cos(yaw_rad))

    def turn(row: DrawnRow) -> DrawnRow:
        (ax, ay), (bx, by) = row.line[0], row.line[-1]
        is_along = (bx - ax) * ahead[0] + (by - ay) * ahead[1] >= 0.0
        return row if is_along else row._replace(line=tuple(reversed(row.line)))

    def place(row: DrawnRow) -> float:
        middle = np.mean(np.array(row.line), axis=0)
        return -float(middle @ np.array(left))

    return sorted(map(turn, rows), key=place)


def _draw_boundary(
    rows: Sequence[DrawnRow], track_map_m: FloatArray, beside_m: float
) -> list[MapPoint]:
    import shapely

    known = track_map_m[np.all(np.isfinite(track_map_m), axis=1)]
    lines = [shapely.LineString(row.line) for row in rows]
    driven = shapely.union_all([shapely.LineString(known), *lines])
    ground = driven.buffer(beside_m + CLOSED_M).buffer(-CLOSED_M)
    whole = max(shapely.get_parts(ground), key=lambda part: part.area)
    corners = shapely.get_coordinates(whole.exterior.simplify(EDGE_M))[:-1]
    return [(float(x_m), float(y_m)) for x_m, y_m in corners]


def _to_degrees(line: Sequence[MapPoint], frame: MapFrame) -> list[list[float]]:
    return [
        [round(lon_deg, DECIMALS), round(lat_deg, DECIMALS)]
        for lat_deg, lon_deg, _ in (frame.geodetic_from_map(*point) for point in line)
    ]
