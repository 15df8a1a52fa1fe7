"""GPX 1.1: tracks, routes and waypoints; `kind` is their type.

GPX has no areas: a line that ends where it began is one, as of a walk around a field, also where
the walk was paused.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

from agribot.gis.formats.outlines import join_lines
from agribot.gis.formats.untrusted import encode_xml, parse_xml, read_text
from agribot.gis.geojson import KINDS, Feature, Found, Geometry, LonLat

_NAMESPACE = "http://www.topografix.com/GPX/1/1"


def read_gpx(data: bytes) -> Found:
    for element in parse_xml(data).iter():
        if element.tag in {"wpt", "rte", "trk"}:
            kind = read_text(element, "type")  # other programs have theirs, such as "running"
            fields = {"name": read_text(element, "name"), "kind": kind if kind in KINDS else ""}
            properties = {key: value for key, value in fields.items() if value}
            for geometry in _read_shapes(element):
                yield geometry, properties


def _read_shapes(element: ET.Element) -> Iterator[Geometry]:
    if element.tag == "wpt":
        yield {"type": "Point", "coordinates": _read_position(element)}
        return
    parts = [e for e in element if e.tag == "trkseg"] if element.tag == "trk" else [element]
    lines = [[_read_position(e) for e in part if e.tag in {"rtept", "trkpt"}] for part in parts]
    for line in join_lines([line for line in lines if line]):
        yield {"type": "LineString", "coordinates": line}


def _read_position(element: ET.Element) -> LonLat:
    return float(element.attrib["lon"]), float(element.attrib["lat"])


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
