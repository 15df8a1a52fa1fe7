"""ISOXML task data (ISO 11783-10), as farm software and tractor terminals exchange it.

A partfield has its boundary and obstacles as polygons, its rows and A-B line as guidance patterns.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

from agribot.core.errors import MissionError
from agribot.core.facts import TaskDataOfOne
from agribot.gis.formats.partfield_ground import PartfieldGround, frame_at, make_area
from agribot.gis.formats.untrusted import encode_xml, pack, parse_xml, unpack
from agribot.gis.geojson import Feature, Found, LonLat, close_ring, describe_left_out

MAIN_FILE = "TASKDATA.XML"
# Attribute A of polygon, line string and point, C of guidance pattern (ISO 11783-10, annex D).
# Anything else in the field, of an unknown type or without one, is an obstacle.
_BOUNDARY = "1"
_OBSTACLES = {"3", "4", "6"}  # water, building, obstacle
_ZONES = {"2": "treatment zone", "7": "flag", "9": "main field", "10": "headland"}
_OUTER, _INNER = "1", "2"
_TRAMLINE, _PATTERN, _OBSTACLE = "3", "5", "9"
_ROUTES = {"4": "sampling route", "8": "flag"}
_AB, _A_PLUS, _CURVE = "1", "2", "3"
_OTHER_POINT, _POINT_A, _POINT_B, _POINT_BETWEEN = "2", "6", "7", "9"
_PLACES = {"1", "2", "3", "4", "10", "11"}
A_PLUS_M = 100.0  # distance of A and B of an A-B line of the same heading


def holds_task_data(names: Sequence[str]) -> bool:
    return any(PurePosixPath(name).name.upper() == MAIN_FILE for name in names)


def read_isoxml(data: bytes) -> Found:
    """Read the partfields, also those in separate files; other task data is ignored."""
    files = unpack(data, ".xml")
    trees = {PurePosixPath(name).stem.upper(): parse_xml(text) for name, text in files.items()}
    fields = [e for tree in trees.values() for e in tree.iter() if e.tag == "PFD"]
    absent = list_absent(trees, "PFD")
    if absent and not fields:
        raise ValueError(f"{', '.join(absent)} is not inside, which {MAIN_FILE} names")
    for file in absent:
        yield describe_left_out(f"{file}, which is not inside")
    for number, field in enumerate(fields):
        of = {"partfield": number} if len(fields) > 1 else {}
        ground = PartfieldGround([_read_positions(ring) for ring in _find_outlines(field)])
        for element in field:
            read = _SHAPES.get(element.tag, _read_none)
            for geometry, properties in read(element, ground):
                of_field = properties.get("kind") == "boundary" and field.get("C")
                name = properties.get("name") or of_field or element.get("B") or field.get("C")
                known = {**({"name": name} if name else {}), **of}
                yield geometry, properties | (known if geometry else {})


def list_absent(trees: Mapping[str, ET.Element], kind: str) -> list[str]:
    """List the files of partfields (PFD) or tasks (TSK) that are named and not there.

    `trees` are by the name of their file, in capitals and without its ending.
    """
    named = (e.get("A", "").upper() for tree in trees.values() for e in tree.iter("XFR"))
    return sorted({f"{n[:20]}.XML" for n in named if n.startswith(kind) and n not in trees})


def _find_outlines(field: ET.Element) -> Iterator[ET.Element]:
    for polygon in field:
        if polygon.tag == "PLN" and polygon.get("A") == _BOUNDARY:
            yield from (e for e in polygon if e.tag == "LSG" and e.get("A") != _INNER)


def _read_none(element: ET.Element, ground: PartfieldGround) -> Found:
    yield from ()


def _read_area(polygon: ET.Element, ground: PartfieldGround) -> Found:
    """Read a boundary with its holes; every ring of whatever stands in a field is an obstacle."""
    kind = polygon.get("A", "")
    rings = [
        (ring.get("A", ""), close_ring(_read_positions(ring)))
        for ring in polygon
        if ring.tag == "LSG"
    ]
    if kind in _ZONES:
        yield describe_left_out(f"{_ZONES[kind]} {polygon.get('B', '')[:40]}".strip())
    elif kind in _OBSTACLES:
        for _, ring in rings:
            yield make_area("obstacle", ring)
    elif kind != _BOUNDARY:
        for _, ring in rings:
            yield from ground.draw_obstacle(ring, is_area=True)
    else:
        yield from _read_boundary(rings)


def _read_boundary(rings: Sequence[tuple[str, list[LonLat]]]) -> Found:
    """Read the rings of a boundary: those that are not marked are outer ones if none is."""
    is_marked = any(side in (_OUTER, _INNER) for side, _ in rings)
    outer = [ring for side, ring in rings if side == _OUTER or not is_marked]
    other = [ring for side, ring in rings if side != _OUTER and is_marked]
    for number, ring in enumerate(outer):
        yield make_area("boundary", ring, *(other if number == 0 else ()))
    for ring in other if not outer else ():
        yield make_area("obstacle", ring)


def _read_line(line: ET.Element, ground: PartfieldGround, kind: str = "row") -> Found:
    positions, type = _read_positions(line), line.get("A", "")
    if type in {_TRAMLINE, _PATTERN}:
        yield {"type": "LineString", "coordinates": positions}, {"kind": kind}
    elif type in _ROUTES:
        yield describe_left_out(f"{_ROUTES[type]} {line.get('B', '')[:40]}".strip())
    elif positions:  # drainage, fence, obstacle
        yield from ground.draw_obstacle(positions, float(line.get("C") or 0.0) / 2000.0)


def _read_point(point: ET.Element, ground: PartfieldGround) -> Found:
    position = _read_position(point)
    if point.get("A") in _PLACES:
        yield {"type": "Point", "coordinates": position}, {"kind": "waypoint"}
    else:
        yield from ground.draw_obstacle([position])


def _read_patterns(group: ET.Element, ground: PartfieldGround) -> Found:
    for pattern in (e for e in group if e.tag == "GPN"):
        named = {"name": pattern.get("B") or group.get("B") or ""}
        for geometry, properties in _read_pattern(pattern, ground):
            yield geometry, properties | (named if geometry else {})


def _read_pattern(pattern: ET.Element, ground: PartfieldGround) -> Found:
    type = pattern.get("C", "")
    lines = [e for e in pattern if e.tag == "LSG"]
    if type not in (_AB, _A_PLUS, _CURVE):
        what = f"of type {type}" if type else "without a type"
        yield describe_left_out(f"guidance line {pattern.get('B', '')[:40]} {what}")
    for line in lines if type in (_AB, _CURVE) else ():
        yield from _read_line(line, ground, "ab_line" if type == _AB else "row")
    for line in lines if type == _A_PLUS else ():
        yield from _read_heading(line, pattern.get("G"))


def _read_heading(line: ET.Element, heading: str | None) -> Found:
    """Read an A+ line, which has one point and a compass heading, as an A-B line."""
    positions = _read_positions(line)
    if heading is None or not positions:
        yield describe_left_out("A+ line without a point or heading")
        return
    east, north = math.sin(math.radians(float(heading))), math.cos(math.radians(float(heading)))
    lat_deg, lon_deg, _ = frame_at(positions[0]).geodetic_from_map(
        A_PLUS_M * east, A_PLUS_M * north
    )
    ends = [positions[0], (lon_deg, lat_deg)]
    yield {"type": "LineString", "coordinates": ends}, {"kind": "ab_line"}


_SHAPES: dict[str, Callable[[ET.Element, PartfieldGround], Found]] = {
    "PLN": _read_area,
    "LSG": _read_line,
    "GGP": _read_patterns,
    "PNT": _read_point,
}


def _read_positions(line: ET.Element) -> list[LonLat]:
    return [_read_position(e) for e in line if e.tag == "PNT"]


def _read_position(point: ET.Element) -> LonLat:
    return float(point.attrib["D"]), float(point.attrib["C"])


def write_isoxml(features: Sequence[Feature]) -> bytes:
    root = ET.Element(
        "ISO11783_TaskData", VersionMajor="4", VersionMinor="2", DataTransferOrigin="1",
        ManagementSoftwareManufacturer="AGRIBOT", ManagementSoftwareVersion="1",
        TaskControllerManufacturer="", TaskControllerVersion="",
    )  # fmt: skip
    outer = [f for f in features if f.kind == "boundary"]
    if len(outer) > 1:
        names = ", ".join(f"'{f.name}'" for f in outer)[:200]
        raise MissionError(TaskDataOfOne(len(outer), names))
    name = next((f.name for f in outer if f.name), "Field")
    area_m2 = sum(_compute_area_m2(f) for f in outer)
    field = ET.SubElement(root, "PFD", A="PFD1", C=name[:32], D=str(round(area_m2)))
    for feature in features:
        if feature.geometry == "Polygon":
            _write_area(field, feature)
    for feature in features:
        if feature.geometry == "Point":
            _write_point(field, _OTHER_POINT, feature.parts[0][0], B=feature.name[:32])
    for feature in (f for f in features if f.kind == "crop"):
        _write_line(ET.SubElement(field, "LSG", A=_OBSTACLE), feature)
    lines = [f for f in features if f.geometry == "LineString" and f.kind != "crop"]
    if lines:
        group = ET.SubElement(field, "GGP", A="GGP1", B="Rows and lines")
        for number, feature in enumerate(lines, 1):
            _write_pattern(group, number, feature)
    return pack({f"TASKDATA/{MAIN_FILE}": encode_xml(root)})


def _compute_area_m2(feature: Feature) -> float:
    from shapely.geometry import Polygon

    frame = frame_at(feature.parts[0][0])
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
    _write_line(ET.SubElement(pattern, "LSG", A=_PATTERN), feature)


def _write_line(line: ET.Element, feature: Feature) -> None:
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
