"""Is this a field that a robot can work? Every reason why not, with its place."""

from __future__ import annotations

import math
from typing import Any

from agribot.core.geo import Datum, MapFrame
from agribot.gis.ground import clean_area
from agribot.ui import wire
from agribot.ui.server.answers import Unusable

KINDS = ("boundary", "obstacle", "row", "crop", "ab_line", "waypoint", "path")
SHAPES = {
    "boundary": ("Polygon",),
    "obstacle": ("Polygon",),
    "row": ("LineString",),
    "crop": ("LineString",),
    "ab_line": ("LineString",),
    "waypoint": ("Point",),
    "path": ("LineString",),
}
MAX_FEATURES = 10_000
MAX_VERTICES = 200_000
MAX_DISTANCE_M = 20_000.0  # distance from the field's origin; farther, the map is another one

LonLat = tuple[float, float]


def check_field(collection: Any, datum: Datum) -> wire.FieldReply:
    """Reasons against it, its area without obstacles and the length of its lines.

    Raises: Unusable: it is no FeatureCollection at all.
    """
    from shapely.ops import unary_union

    features = _features(collection)
    frame = MapFrame(datum)
    reasons: list[wire.FieldReason] = []
    shapes: dict[str, list[Any]] = {kind: [] for kind in KINDS}
    for number, feature in enumerate(features, start=1):
        kind = str((feature.get("properties") or {}).get("kind", ""))
        try:
            shapes.setdefault(kind, []).append(_shape_of(feature, kind, frame))
        except _Fault as fault:
            what = f"feature {number} ({kind or 'no kind'}): {fault}"
            reasons.append(_reason(what, fault.at_map_m))
    reasons += _find_misplaced(shapes, frame)
    area_m2 = unary_union(shapes["boundary"]).difference(unary_union(shapes["obstacle"])).area
    lines = (*shapes["row"], *shapes["path"])
    return wire.FieldReply(
        ok=not reasons,
        reasons=reasons,
        area_m2=round(area_m2, 2),
        length_m=round(sum(line.length for line in lines), 2),
    )


def _features(collection: Any) -> list[Any]:
    if not isinstance(collection, dict) or collection.get("type") != "FeatureCollection":
        raise Unusable(422, "this is not a field; send a GeoJSON FeatureCollection")
    features = collection.get("features")
    if not isinstance(features, list) or not all(isinstance(f, dict) for f in features):
        raise Unusable(422, "the FeatureCollection has no list of features; add it")
    if len(features) > MAX_FEATURES:
        raise Unusable(422, f"{len(features)} features, more than {MAX_FEATURES}; thin them out")
    return features


class _Fault(Exception):
    """What is wrong with one feature, and where in the map."""

    def __init__(self, text: str, at_map_m: wire.Vec2 | None = None) -> None:
        super().__init__(text)
        self.at_map_m = at_map_m


def _shape_of(feature: dict[str, Any], kind: str, frame: MapFrame) -> Any:
    """Convert the shape to the map, metres.

    Raises: _Fault: it is not a shape of this kind.
    """
    import shapely
    from shapely.geometry import shape as shape_of

    geometry = feature.get("geometry") or {}
    if kind not in SHAPES:
        raise _Fault(f"kind is unknown; give one of {', '.join(KINDS)}")
    if geometry.get("type") not in SHAPES[kind]:
        raise _Fault(f"a {geometry.get('type')}; draw a {' or '.join(SHAPES[kind])}")
    try:
        lonlat = shape_of(geometry)
    except (
        ValueError,
        TypeError,
        LookupError,
        OverflowError,
        shapely.errors.ShapelyError,
    ) as error:
        raise _Fault(f"unusable shape ({error}); draw it anew") from error
    coordinates = shapely.get_coordinates(lonlat)
    if len(coordinates) == 0 or len(coordinates) > MAX_VERTICES:
        raise _Fault(f"{len(coordinates)} vertices; 1 to {MAX_VERTICES} can be worked with")
    far = _too_far(coordinates, frame)
    if far is not None:
        what = f"farther than {MAX_DISTANCE_M / 1e3:g} km from the field's origin; move it there"
        raise _Fault(what, far)
    shape = shapely.transform(lonlat, lambda points: _in_map(points, frame))
    cleaned = clean_area(shape) if isinstance(shape, shapely.Polygon) else shape
    if cleaned is None or not cleaned.is_valid:
        reason = shapely.is_valid_reason(shape).lower().split("[")[0]
        raise _Fault(f"{reason}; draw it anew", _fault_place(shape))
    return cleaned


def _in_map(points: Any, frame: MapFrame) -> Any:
    import numpy as np

    return np.array([frame.map_from_geodetic(lat, lon, 0.0)[:2] for lon, lat in points])


def _too_far(coordinates: Any, frame: MapFrame) -> wire.Vec2 | None:
    for lon_deg, lat_deg in coordinates:
        if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
            return 0.0, 0.0
        x_m, y_m, _ = frame.map_from_geodetic(float(lat_deg), float(lon_deg), 0.0)
        if math.hypot(x_m, y_m) > MAX_DISTANCE_M:
            return x_m, y_m
    return None


def _fault_place(shape: Any) -> wire.Vec2 | None:
    """Where a polygon crosses itself, from the library's text `Self-intersection[x y]`."""
    import shapely

    text = shapely.is_valid_reason(shape)
    inner = text.partition("[")[2].rstrip("]").split()
    try:
        return float(inner[0]), float(inner[1])
    except (ValueError, IndexError):
        return None


def _find_misplaced(shapes: dict[str, list[Any]], frame: MapFrame) -> list[wire.FieldReason]:
    """Things that lie outside the boundary, and rows through obstacles."""
    from shapely.ops import unary_union

    reasons: list[wire.FieldReason] = []
    if not shapes["boundary"]:
        return reasons
    field = unary_union(shapes["boundary"])
    near = field.buffer(0.01)
    for kind in ("row", "waypoint", "obstacle"):
        for number, shape in enumerate(shapes[kind], start=1):
            if not (near.intersects(shape) if kind == "obstacle" else near.covers(shape)):
                at = shape.difference(field).representative_point()
                reasons.append(_reason(f"{kind} {number} lies outside the boundary", (at.x, at.y)))
    for number, row in enumerate(shapes["row"], start=1):
        hit = next((o for o in shapes["obstacle"] if o.intersects(row)), None)
        if hit is not None:
            at = hit.intersection(row).representative_point()
            reasons.append(_reason(f"row {number} runs into an obstacle", (at.x, at.y)))
    return reasons


def _reason(text: str, at_map_m: wire.Vec2 | None = None) -> wire.FieldReason:
    return wire.FieldReason(text=text, at_map_m=at_map_m)


def datum_of(field: wire.Field) -> Datum:
    return Datum(lat_deg=field.datum.lat_deg, lon_deg=field.datum.lon_deg)
