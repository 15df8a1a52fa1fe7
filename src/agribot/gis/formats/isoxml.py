"""ISOXML task data (ISO 11783-10), as farm software and tractor terminals exchange it.

A partfield has its boundary and obstacles as polygons, its rows and A-B line as guidance patterns.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath
from typing import Any

from agribot.core.geo import Datum, MapFrame
from agribot.gis.formats.untrusted import encode_xml, get_local_name, pack, parse_xml, unpack
from agribot.gis.geojson import Feature, Found, Geometry, LonLat, close_ring

MAIN_FILE = "TASKDATA.XML"
# Attribute A of polygon, line string, guidance pattern and point (ISO 11783-10, annex D).
_AREAS = {"1": "boundary", "3": "obstacle", "4": "obstacle", "6": "obstacle"}
_OUTER, _INNER, _TRAMLINE, _PATTERN = "1", "2", "3", "5"
_AB, _CURVE = "1", "3"
_OTHER_POINT, _POINT_A, _POINT_B, _POINT_BETWEEN = "2", "6", "7", "9"
_PLACES = {"1", "2", "3", "4", "10", "11"}


def holds_task_data(names: Sequence[str]) -> bool:
    return any(PurePosixPath(name).name.upper() == MAIN_FILE for name in names)


def read_isoxml(data: bytes) -> Found:
    """Read the partfields, also those in separate files; other task data is ignored."""
    files = unpack(data, ".xml")
    trees = {PurePosixPath(name).stem.upper(): parse_xml(text) for name, text in files.items()}
    for field in (e for tree in trees.values() for e in tree.iter() if get_local_name(e) == "PFD"):
        for element in field:
            name = element.get("B") or field.get("C") or ""
            for kind, geometry in _read_shapes(element):
                yield geometry, {"kind": kind, **({"name": name} if name else {})}


def _read_shapes(element: ET.Element) -> Iterator[tuple[str, Geometry]]:
    if get_local_name(element) == "PLN":
        yield from _read_area(element)
    elif get_local_name(element) == "LSG":
        yield from _read_line(element)
    elif get_local_name(element) == "GGP":
        yield from _read_patterns(element)
    elif get_local_name(element) == "PNT" and element.get("A") in _PLACES:
        yield "waypoint", {"type": "Point", "coordinates": _read_position(element)}


def _read_area(polygon: ET.Element) -> Iterator[tuple[str, Geometry]]:
    kind = _AREAS.get(polygon.get("A", ""))
    rings = {
        side: [
            _read_positions(ring)
            for ring in polygon
            if get_local_name(ring) == "LSG" and ring.get("A") == side
        ]
        for side in (_OUTER, _INNER)
    }
    if kind is None:
        return
    for number, ring in enumerate(rings[_OUTER]):
        inner = rings[_INNER] if number == 0 else []
        sides = [close_ring(points) for points in (ring, *inner)]
        yield kind, {"type": "Polygon", "coordinates": sides}


def _read_line(line: ET.Element, kind: str = "row") -> Iterator[tuple[str, Geometry]]:
    if line.get("A") in {_TRAMLINE, _PATTERN}:
        yield kind, {"type": "LineString", "coordinates": _read_positions(line)}


def _read_patterns(group: ET.Element) -> Iterator[tuple[str, Geometry]]:
    for pattern in (e for e in group if get_local_name(e) == "GPN"):
        kind = {_AB: "ab_line", _CURVE: "row"}.get(pattern.get("C", ""))
        for line in (e for e in pattern if get_local_name(e) == "LSG" and kind):
            yield from _read_line(line, str(kind))


def _read_positions(line: ET.Element) -> list[LonLat]:
    return [_read_position(e) for e in line if get_local_name(e) == "PNT"]


def _read_position(point: ET.Element) -> LonLat:
    return float(point.attrib["D"]), float(point.attrib["C"])


def write_isoxml(features: Sequence[Feature]) -> bytes:
    root = ET.Element(
        "ISO11783_TaskData", VersionMajor="4", VersionMinor="2", DataTransferOrigin="1",
        ManagementSoftwareManufacturer="AGRIBOT", ManagementSoftwareVersion="1",
        TaskControllerManufacturer="", TaskControllerVersion="",
    )  # fmt: skip
    outer = [f for f in features if f.kind == "boundary"]
    name = next((f.name for f in outer if f.name), "Field")
    area_m2 = sum(_compute_area_m2(f) for f in outer)
    field = ET.SubElement(root, "PFD", A="PFD1", C=name[:32], D=str(round(area_m2)))
    for feature in features:
        if feature.geometry == "Polygon":
            _write_area(field, feature)
    for feature in features:
        if feature.geometry == "Point":
            _write_point(field, _OTHER_POINT, feature.parts[0][0], B=feature.name[:32])
    lines = [f for f in features if f.geometry == "LineString"]
    if lines:
        group = ET.SubElement(field, "GGP", A="GGP1", B="Rows and lines")
        for number, feature in enumerate(lines, 1):
            _write_pattern(group, number, feature)
    return pack({f"TASKDATA/{MAIN_FILE}": encode_xml(root)})


def _compute_area_m2(feature: Feature) -> float:
    from shapely.geometry import Polygon

    lon_deg, lat_deg = feature.parts[0][0]
    frame = MapFrame(Datum(lat_deg=lat_deg, lon_deg=lon_deg))
    rings = [[frame.map_from_geodetic(y, x, 0.0)[:2] for x, y in ring] for ring in feature.parts]
    return float(Polygon(rings[0], rings[1:]).area)


def _write_area(field: ET.Element, feature: Feature) -> None:
    kind = "6" if feature.kind == "obstacle" else "1"
    polygon = ET.SubElement(field, "PLN", _drop_empty({"A": kind, "B": feature.name[:32]}))
    for number, ring in enumerate(feature.parts):
        line = ET.SubElement(polygon, "LSG", A=_INNER if number else _OUTER)
        for position in ring:
            _write_point(line, _OTHER_POINT, position)


def _write_pattern(group: ET.Element, number: int, feature: Feature) -> None:
    kind = _AB if feature.kind == "ab_line" else _CURVE
    fields = {"A": f"GPN{number}", "B": feature.name[:32], "C": kind}
    pattern = ET.SubElement(group, "GPN", _drop_empty(fields))
    line = ET.SubElement(pattern, "LSG", A=_PATTERN)
    last = len(feature.parts[0]) - 1
    for index, position in enumerate(feature.parts[0]):
        ends = {0: _POINT_A, last: _POINT_B}
        _write_point(line, ends.get(index, _POINT_BETWEEN), position)


def _write_point(parent: ET.Element, kind: str, position: LonLat, **more: Any) -> None:
    lon_deg, lat_deg = position
    fields = _drop_empty({"A": kind, **more, "C": f"{lat_deg:.9f}", "D": f"{lon_deg:.9f}"})
    ET.SubElement(parent, "PNT", fields)


def _drop_empty(attributes: dict[str, str]) -> dict[str, str]:
    """Return the attributes without the empty ones."""
    return {key: value for key, value in attributes.items() if value}
