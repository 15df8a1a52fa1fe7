"""A field plan as GeoJSON for any map program: field, legs and certificate."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from agribot.autonomy.plan.coverage.area import (
    FieldArea,
    FieldPlan,
    Leg,
    LegKind,
    MapLine,
    PlanRequest,
)
from agribot.autonomy.plan.coverage.plan_certificate import Certificate
from agribot.core.errors import MissionError
from agribot.core.facts import LegUnfit, NotPlan, PlanBroken
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import FloatArray
from agribot.gis.field_file import parse_field
from agribot.gis.geojson import KINDS, make_feature, parse_features, read_json

FORMAT = 1
DECIMALS = 10  # a hundredth of a millimetre: short pieces of arcs keep their direction


class SavedPlan(NamedTuple):
    plan: FieldPlan
    area: FieldArea
    request: PlanRequest
    datum: Datum


def format_plan(saved: SavedPlan, certificate: Certificate) -> str:
    frame = MapFrame(saved.datum)
    area = saved.area
    collected = [
        make_feature(
            "Polygon",
            [_to_degrees_ring(r, frame) for r in (area.boundary, *area.holes)],
            kind="boundary",
        )
    ]
    for kind, rows in (("row", area.rows), ("crop", area.crop)):
        collected += [
            make_feature("LineString", _to_degrees(row, frame), kind=kind) for row in rows
        ]
    if area.ab_line:
        collected.append(
            make_feature("LineString", _to_degrees(area.ab_line, frame), kind="ab_line")
        )
    for number, leg in enumerate(saved.plan.legs):
        collected.append(
            make_feature(
                "LineString", _to_degrees(leg.xy_map_m, frame), kind=f"leg:{leg.kind}", leg=number,
                tool_on=leg.tool_on, row=leg.row, length_m=round(leg.length_m, 3),
            )
        )  # fmt: skip
    header = {
        "format": FORMAT,
        "datum": msgspec.to_builtins(saved.datum),
        "swath_yaw_deg": math.degrees(saved.plan.swath_yaw_rad),
        "request": msgspec.to_builtins(saved.request),
        "warnings": list(saved.plan.warnings),
        "certificate": msgspec.to_builtins(certificate),
    }
    lines = ",\n".join(json.dumps(feature) for feature in collected)
    head = json.dumps(header)
    return f'{{"type": "FeatureCollection", "agribot": {head}, "features": [\n{lines}\n]}}\n'


def read_plan(path: Path, datum: Datum | None = None) -> SavedPlan:
    """Read a plan in the map of `datum`; without one, in the map in which it was made.

    Raises: MissionError: the file is not a plan, or a part of it is broken.
    """
    return parse_plan(read_json(path), path.name, datum)


def parse_plan(root: Any, source_name: str, datum: Datum | None = None) -> SavedPlan:
    header = root.get("agribot") if isinstance(root, dict) else None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise MissionError(NotPlan(source_name, str(FORMAT)))
    try:
        request = msgspec.convert(header["request"], PlanRequest)
        datum = datum or msgspec.convert(header["datum"], Datum)
        swath_yaw_rad = math.radians(float(header["swath_yaw_deg"]))
    except (KeyError, TypeError, ValueError, OverflowError, msgspec.ValidationError) as error:
        raise MissionError(PlanBroken(source_name, str(error))) from error
    found = parse_features(root, source_name)
    area, _ = parse_field([f for f in found if f.kind in KINDS], source_name, datum)
    frame = MapFrame(datum)
    legs = []
    for feature in found:
        if feature.kind.startswith("leg:"):
            legs.append(_read_leg(feature.kind.removeprefix("leg:"), feature, frame))
    return SavedPlan(FieldPlan(legs=tuple(legs), swath_yaw_rad=swath_yaw_rad), area, request, datum)


def _read_leg(kind: str, feature: Any, frame: MapFrame) -> Leg:
    try:
        checked_kind: LegKind = msgspec.convert(kind, LegKind)
        row = msgspec.convert(feature.properties.get("row", -1), int)
    except msgspec.ValidationError as error:
        raise MissionError(PlanBroken(feature.where, str(error))) from error
    if feature.geometry != "LineString" or len(feature.parts[0]) < 2:
        raise MissionError(LegUnfit(feature.where))
    xy = [frame.map_from_geodetic(lat, lon, frame.datum.alt_m)[:2] for lon, lat in feature.parts[0]]
    return Leg(kind=checked_kind, xy_map_m=np.array(xy), row=row)


def _to_degrees(points: MapLine | FloatArray, frame: MapFrame) -> list[list[float]]:
    found = []
    for east_m, north_m in points:
        lat_deg, lon_deg, _ = frame.geodetic_from_map(float(east_m), float(north_m))
        found.append([round(lon_deg, DECIMALS), round(lat_deg, DECIMALS)])
    return found


def _to_degrees_ring(points: MapLine, frame: MapFrame) -> list[list[float]]:
    line = _to_degrees(points, frame)
    return [*line, line[0]]
