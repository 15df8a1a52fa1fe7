"""GPX 1.1: tracks, routes and waypoints; `kind` is their type.

GPX knows no areas: a line that ends where it began is one, as when somebody walked around it.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from itertools import pairwise

from agribot.core.geo import Datum, MapFrame
from agribot.gis.formats.untrusted import tag, text_of, xml_bytes, xml_tree
from agribot.gis.geojson import KINDS, Feature, Found, Geometry, LonLat, closed

CLOSED_GAP_M = 5.0  # two fixes of a plain receiver at one place
CLOSED_GAP_RATIO = 0.05  # of the way around
_MIN_CORNERS = 3
_NAMESPACE = "http://www.topografix.com/GPX/1/1"


def read_gpx(data: bytes) -> Found:
    for element in xml_tree(data).iter():
        if tag(element) in {"wpt", "rte", "trk"}:
            kind = text_of(element, "type")  # other programs have theirs, such as "running"
            told = {"name": text_of(element, "name"), "kind": kind if kind in KINDS else ""}
            properties = {key: value for key, value in told.items() if value}
            for geometry in _shapes(element, told["kind"]):
                yield geometry, properties


def _shapes(element: ET.Element, kind: str) -> Iterator[Geometry]:
    if tag(element) == "wpt":
        yield {"type": "Point", "coordinates": _position(element)}
        return
    lines = [e for e in element if tag(e) == "trkseg"] if tag(element) == "trk" else [element]
    for line in lines:
        points = [_position(e) for e in line if tag(e) in {"rtept", "trkpt"}]
        if kind in {"boundary", "obstacle"} or (not kind and _closed(points)):
            yield {"type": "Polygon", "coordinates": [closed(points)]}
        elif points:
            yield {"type": "LineString", "coordinates": points}


def _position(element: ET.Element) -> LonLat:
    return float(element.attrib["lon"]), float(element.attrib["lat"])


def _closed(points: Sequence[LonLat]) -> bool:
    if len(points) <= _MIN_CORNERS:
        return False
    frame = MapFrame(Datum(lat_deg=points[0][1], lon_deg=points[0][0]))
    way = [frame.map_from_geodetic(lat, lon, 0.0)[:2] for lon, lat in points]
    length_m = sum(math.dist(a, b) for a, b in pairwise(way))
    return math.dist(way[0], way[-1]) <= min(CLOSED_GAP_M, CLOSED_GAP_RATIO * length_m)


def write_gpx(features: Sequence[Feature]) -> bytes:
    """Inner rings become obstacles, which mean the same."""
    root = ET.Element("gpx", xmlns=_NAMESPACE, version="1.1", creator="AGRIBOT")
    for points, feature in ((f.parts[0], f) for f in features if f.geometry == "Point"):
        _described(_point(root, "wpt", points[0]), feature.name, feature.kind)
    for feature in features:
        if feature.geometry == "LineString":
            route = ET.SubElement(root, "rte")
            _described(route, feature.name, feature.kind)
            for position in feature.parts[0]:
                _point(route, "rtept", position)
    for feature in features:
        if feature.geometry == "Polygon":
            for number, ring in enumerate(feature.parts):
                track = ET.SubElement(root, "trk")
                _described(track, feature.name, "obstacle" if number else feature.kind)
                segment = ET.SubElement(track, "trkseg")
                for position in ring:
                    _point(segment, "trkpt", position)
    return xml_bytes(root)


def _described(element: ET.Element, name: str, kind: str) -> None:
    if name:
        ET.SubElement(element, "name").text = name
    ET.SubElement(element, "type").text = kind


def _point(parent: ET.Element, name: str, position: LonLat) -> ET.Element:
    lon_deg, lat_deg = position
    return ET.SubElement(parent, name, lat=f"{lat_deg:.9f}", lon=f"{lon_deg:.9f}")
