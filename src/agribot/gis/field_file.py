"""A field from a file: boundary, obstacles, crop rows, AB line and waypoints, checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.autonomy.plan.coverage.area import (
    MARGIN_M,
    MOST_MARGIN_M,
    FieldArea,
    MapLine,
)
from agribot.core.errors import MissionError
from agribot.core.facts import (
    AbLineClosed,
    BoundaryCount,
    FieldFar,
    KindUnknown,
    LineShort,
    ManyAbLines,
    MarginWrong,
    RowOutside,
    ShapeWrong,
)
from agribot.core.geo import Datum, MapFrame
from agribot.core.json_number import is_number, quote_value
from agribot.core.messages import MapPoint
from agribot.gis.field_choice import choose_field, split_choice
from agribot.gis.formats.table import read_fields
from agribot.gis.geojson import KINDS, Feature, LonLat, parse_features
from agribot.gis.ground import clean_ground, make_fault

if TYPE_CHECKING:
    import shapely
    from shapely.geometry.base import BaseGeometry

MAX_EXTENT_M = 20_000.0
MAX_OFFSET_M = 20_000.0  # largest offset: a local map is flat only near its origin
MIN_LINE_M = 0.1


def read_field(
    path: Path, datum: Datum | None = None, *, uses_ab_line: bool = True
) -> tuple[FieldArea, Datum]:
    """Read a field in the map of `datum`; without one, its first corner becomes the origin.

    The file's suffix selects one of `agribot.gis.formats`; names after a `#` choose one of several
    fields and A-B lines. Without `uses_ab_line` no A-B line is needed.
    Raises: MissionError: a fault of the field, with its place.
    """
    root, name = read_fields(path), split_choice(path)[0].name
    if not uses_ab_line:
        root["features"] = [f for f in root["features"] if f["properties"]["kind"] != "ab_line"]
    found = parse_features(choose_field(root, [], name), name)
    area, datum = parse_field(found, name, datum)
    left_out = "; ".join(line for line in (root.get("left_out", ""), area.left_out) if line)
    return msgspec.structs.replace(area, left_out=left_out), datum


def parse_field(
    found: Sequence[Feature], source_name: str, datum: Datum | None = None
) -> tuple[FieldArea, Datum]:
    kinds = _sort_by_kind(found, source_name)
    outline = kinds["boundary"][0].parts
    if datum is None:
        lon_deg, lat_deg = outline[0][0]
        datum = Datum(lat_deg=lat_deg, lon_deg=lon_deg)
    frame = MapFrame(datum)
    _check_place(outline[0], datum, source_name)
    rings = [*outline[1:], *(ring for f in kinds["obstacle"] for ring in f.parts[:1])]
    area = FieldArea(
        boundary=_to_map_ring(outline[0], frame),
        holes=tuple(_to_map_ring(ring, frame) for ring in rings),
        rows=tuple(_to_map_line(f.parts[0], frame) for f in kinds["row"]),
        crop=tuple(_to_map_line(f.parts[0], frame) for f in kinds["crop"]),
        ab_line=_to_map_line(kinds["ab_line"][0].parts[0], frame) if kinds["ab_line"] else (),
        waypoints=tuple(_to_map(f.parts[0][0], frame) for f in kinds["waypoint"]),
        margin_m=_read_margin_m(kinds["boundary"][0]),
    )
    return check_field(area, frame, source_name), datum


def _sort_by_kind(found: Sequence[Feature], source_name: str) -> dict[str, list[Feature]]:
    kinds: dict[str, list[Feature]] = {kind: [] for kind in KINDS}
    for feature in found:
        kind = feature.kind or _guess_kind(feature, has_boundary=bool(kinds["boundary"]))
        if kind not in kinds:
            raise MissionError(KindUnknown(feature.where, repr(kind), ", ".join(KINDS)))
        wanted = {"boundary": "Polygon", "obstacle": "Polygon", "waypoint": "Point"}
        needed = wanted.get(kind, "LineString")
        if feature.geometry != needed:
            raise MissionError(ShapeWrong(feature.where, kind, needed, feature.geometry))
        kinds[kind].append(feature)
    outlines, lines = kinds["boundary"], kinds["ab_line"]
    if len(outlines) != 1:
        raise MissionError(BoundaryCount(source_name, len(outlines), _list_names(outlines)))
    if len(lines) > 1:
        raise MissionError(ManyAbLines(source_name, len(lines), _list_names(lines)))
    return kinds


def _list_names(found: Sequence[Feature]) -> str:
    names = [f"'{feature.name}'" for feature in found if feature.name]
    return f" ({', '.join(names)[:200]})" if len(names) > 1 else ""


def _read_margin_m(boundary: Feature) -> float:
    margin_m = boundary.properties.get("margin_m")
    if margin_m is None:
        return MARGIN_M
    if not is_number(margin_m) or not 0.0 <= margin_m <= MOST_MARGIN_M:
        raise MissionError(MarginWrong(boundary.where, quote_value(margin_m), MOST_MARGIN_M))
    return float(margin_m)


def _guess_kind(feature: Feature, has_boundary: bool) -> str:
    if feature.geometry == "Polygon":
        return "obstacle" if has_boundary else "boundary"
    return {"LineString": "row", "Point": "waypoint"}.get(feature.geometry, "")


def _check_place(ring: Sequence[LonLat], datum: Datum, source_name: str) -> None:
    """Check that the field is near the map's origin and not larger than MAX_EXTENT_M."""
    frame = MapFrame(datum)
    away_m = max(math.hypot(*_to_map(position, frame)) for position in ring)
    if away_m <= MAX_OFFSET_M:
        return
    lon_deg, lat_deg = ring[0]
    instead, origin = "", f"{lat_deg:.6f},{lon_deg:.6f}"
    if abs(lon_deg) <= 90.0:
        swapped_m = math.hypot(*_to_map((lat_deg, lon_deg), frame))
        if swapped_m < MAX_OFFSET_M < math.hypot(*_to_map(ring[0], frame)):
            instead = f"[{round(lat_deg, 7)}, {round(lon_deg, 7)}]"
    raise MissionError(
        FieldFar(source_name, away_m, datum.lat_deg, datum.lon_deg, MAX_OFFSET_M, origin, instead)
    )


def _to_map(position: LonLat, frame: MapFrame) -> MapPoint:
    east_m, north_m, _ = frame.map_from_geodetic(position[1], position[0], frame.datum.alt_m)
    return east_m, north_m


def _to_map_ring(ring: Sequence[LonLat], frame: MapFrame) -> MapLine:
    points = ring[:-1] if len(ring) > 1 and ring[0] == ring[-1] else ring
    return tuple(_to_map(position, frame) for position in points)


def _to_map_line(line: Sequence[LonLat], frame: MapFrame) -> MapLine:
    return tuple(_to_map(position, frame) for position in line)


def check_field(area: FieldArea, frame: MapFrame, source_name: str) -> FieldArea:
    """Check that all parts of a field fit each other, and cut overlapping obstacles out of it."""
    _check_lines(area, source_name, frame)
    ground, left_out = clean_ground(area.boundary, area.holes, source_name, frame)
    _check_rows(area.rows, ground, source_name, frame)
    return msgspec.structs.replace(
        area,
        boundary=_list_points(ground.exterior),
        holes=tuple(_list_points(ring) for ring in ground.interiors),
        left_out=left_out,
    )


def _list_points(ring: shapely.LinearRing) -> MapLine:
    return tuple((float(x), float(y)) for x, y in ring.coords[:-1])


def _check_lines(area: FieldArea, source_name: str, frame: MapFrame) -> None:
    lines = [*((f"row {n}", row) for n, row in enumerate(area.rows, 1))]
    lines += [*((f"crop row {n}", row) for n, row in enumerate(area.crop, 1))]
    lines += [("the ab_line", area.ab_line)] if area.ab_line else []
    for name, line in lines:
        length_m = sum(math.dist(a, b) for a, b in pairwise(line))
        if length_m < MIN_LINE_M:
            short = LineShort(f"{source_name}: {name}", length_m, MIN_LINE_M)
            raise make_fault(short, line[0], frame)
    if area.ab_line and math.dist(area.ab_line[0], area.ab_line[-1]) < MIN_LINE_M:
        raise make_fault(AbLineClosed(source_name), area.ab_line[0], frame)


def _check_rows(
    rows: Sequence[MapLine], field: BaseGeometry, source_name: str, frame: MapFrame
) -> None:
    import shapely

    for number, row in enumerate(rows, 1):
        outside = shapely.LineString(row).difference(field)
        if not outside.is_empty:
            place = shapely.get_coordinates(outside)[0]
            length_m = float(outside.length)
            raise make_fault(RowOutside(source_name, number, length_m), place, frame)
