"""GPX 1.1: tracks, routes and waypoints; `kind` is their type.

GPX has no areas: a line that ends where it began is one, as of a walk around a field.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from itertools import pairwise

from agribot.core.geo import Datum, MapFrame
from agribot.gis.formats.untrusted import encode_xml, parse_xml, read_text
from agribot.gis.geojson import KINDS, Feature, Found, Geometry, LonLat, close_ring

CLOSED_GAP_M = 5.0  # two fixes of a plain receiver at one place
CLOSED_GAP_RATIO = 0.05  # of the way around
_MIN_CORNERS = 3
_NAMESPACE = "http://www.topografix.com/GPX/1/1"


def read_gpx(data: bytes) -> Found:
    for element in parse_xml(data).iter():
        if element.tag in {"wpt", "rte", "trk"}:
            kind = read_text(element, "type")  # other programs have theirs, such as "running"
            fields = {"name": read_text(element, "name"), "kind": kind if kind in KINDS else ""}
            properties = {key: value for key, value in fields.items() if value}
            for geometry in _read_shapes(element, fields["kind"]):
                yield geometry, properties


def _read_shapes(element: ET.Element, kind: str) -> Iterator[Geometry]:
    if element.tag == "wpt":
        yield {"type": "Point", "coordinates": _read_position(element)}
        return
    lines = [e for e in element if e.tag == "trkseg"] if element.tag == "trk" else [element]
    for line in lines:
        points = [_read_position(e) for e in line if e.tag in {"rtept", "trkpt"}]
        if kind in {"boundary", "obstacle"} or (not kind and _is_closed(points)):
            yield {"type": "Polygon", "coordinates": [close_ring(points)]}
        elif points:
            yield {"type": "LineString", "coordinates": points}


def _read_position(element: ET.Element) -> LonLat:
    return float(element.attrib["lon"]), float(element.attrib["lat"])


def _is_closed(points: Sequence[LonLat]) -> bool:
    if len(points) <= _MIN_CORNERS:
        return False
    frame = MapFrame(Datum(lat_deg=points[0][1], lon_deg=points[0][0]))
    way = [frame.map_from_geodetic(lat, lon, 0.0)[:2] for lon, lat in points]
    length_m = sum(math.dist(a, b) for a, b in pairwise(way))
    return math.dist(way[0], way[-1]) <= min(CLOSED_GAP_M, CLOSED_GAP_RATIO * length_m)


def write_gpx(features: Sequence[Feature]) -> bytes:
    """Write the features; inner rings become obstacles, which have the same meaning."""
    root = ET.Element("gpx", xmlns=_NAMESPACE, version="1.1", creator="AGRIBOT")
    for points, feature in ((f.parts[0], f) for f in features if f.geometry == "Point"):
        _describe(_write_point(root, "wpt", points[0]), feature.name, feature.kind)
    for feature in features:
        if feature.geometry == "LineString":
            route = ET.SubElement(root, "rte")
            _describe(route, feature.name, feature.kind)
            for position in feature.parts[0]:
                _write_point(route, "rtept", position)
    for feature in features:
        if feature.geometry == "Polygon":
            for number, ring in enumerate(feature.parts):
                track = ET.SubElement(root, "trk")
                _describe(track, feature.name, "obstacle" if number else feature.kind)
                segment = ET.SubElement(track, "trkseg")
                for position in ring:
                    _write_point(segment, "trkpt", position)
    return encode_xml(root)


def _describe(element: ET.Element, name: str, kind: str) -> None:
    if name:
        ET.SubElement(element, "name").text = name
    ET.SubElement(element, "type").text = kind


def _write_point(parent: ET.Element, name: str, position: LonLat) -> ET.Element:
    lon_deg, lat_deg = position
    return ET.SubElement(parent, name, lat=f"{lat_deg:.9f}", lon=f"{lon_deg:.9f}")
