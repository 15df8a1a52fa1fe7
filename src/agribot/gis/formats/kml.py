"""KML and KMZ (OGC 12-007r2); `kind` is extended data of a placemark."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence

from agribot.gis.formats.untrusted import (
    encode_xml,
    pack,
    parse_xml,
    read_text,
    unpack,
)
from agribot.gis.geojson import Feature, Found, Geometry, LonLat, describe_left_out

_NAMESPACE = "http://www.opengis.net/kml/2.2"
_MAIN_FILE = "doc.kml"
_COMMAS = 3  # commas in one place, with one behind its altitude
_COMMA = re.compile(r"\s*,\s*")  # many programs write spaces beside the commas of a place


def read_kml(data: bytes) -> Found:
    for mark in parse_xml(data).iter():
        if mark.tag == "Placemark":
            fields = {"name": read_text(mark, "name"), "kind": _read_kind(mark)}
            properties = {key: value for key, value in fields.items() if value}
            for element in mark:
                yield from _read_shape(element, properties)
        elif mark.tag in _WITHOUT_SHAPE:
            yield describe_left_out(mark.tag)


def read_kmz(data: bytes) -> Found:
    files = unpack(data, ".kml")
    if not files:
        raise ValueError("no .kml file inside")
    yield from read_kml(files.get(_MAIN_FILE) or next(iter(files.values())))


def _read_kind(mark: ET.Element) -> str:
    kinds = (e for e in mark.iter() if e.tag in {"Data", "SimpleData"} and e.get("name") == "kind")
    return next((read_text(e, "value") or (e.text or "").strip() for e in kinds), "")


def _read_shape(element: ET.Element, properties: dict[str, str]) -> Found:
    """Read a geometry, or all of them in a collection; a ring that stands alone is an area."""
    kind = element.tag
    if kind in _COLLECTIONS:
        for part in element:
            yield from _read_shape(part, properties)
    elif kind in _SHAPES:
        shape = _SHAPES[kind](element)
        name = f" '{properties['name'][:40]}'" if "name" in properties else ""
        yield (
            (shape, properties) if shape else describe_left_out(f"{kind}{name} without coordinates")
        )


def _read_point(element: ET.Element) -> Geometry | None:
    points = _read_points(element)
    return {"type": "Point", "coordinates": points[0]} if points else None


def _read_line(element: ET.Element) -> Geometry | None:
    points = _read_points(element)
    return {"type": "LineString", "coordinates": points} if points else None


def _read_track(element: ET.Element) -> Geometry | None:
    """Read gx:Track, whose places are `lon lat altitude` each; a gx:MultiTrack was paused."""
    places = [(e.text or "").split()[:2] for e in element.iter("coord")]
    points = [[float(number) for number in place] for place in places if place]
    return {"type": "LineString", "coordinates": points} if points else None


def _read_area(element: ET.Element) -> Geometry | None:
    """Read a polygon with its outer ring first, whatever the order in the file."""
    sides = sorted(element, key=lambda side: side.tag == "innerBoundaryIs")
    rings = [ring for side in sides for ring in side.iter() if ring.tag == "LinearRing"]
    return {"type": "Polygon", "coordinates": [_read_points(r) for r in rings]} if rings else None


def _read_ring(element: ET.Element) -> Geometry | None:
    points = _read_points(element)
    return {"type": "Polygon", "coordinates": [points]} if points else None


_SHAPES: dict[str, Callable[[ET.Element], Geometry | None]] = {
    "Point": _read_point,
    "LineString": _read_line,
    "LinearRing": _read_ring,
    "Polygon": _read_area,
    "Track": _read_track,
    "MultiTrack": _read_track,
    "Model": lambda _: None,
}
_COLLECTIONS = {"MultiGeometry"}
_WITHOUT_SHAPE = {"NetworkLink", "GroundOverlay", "PhotoOverlay", "ScreenOverlay"}


def _read_points(element: ET.Element) -> list[list[float]]:
    text = next((e.text or "" for e in element.iter() if e.tag == "coordinates"), "")
    places = _COMMA.sub(",", text).split()
    if any(place.count(",") > _COMMAS for place in places):  # one stands behind each place, too
        places = [place.rstrip(",") for place in text.split()]
    return [[float(number) for number in place.split(",")[:2]] for place in places]


def write_kml(features: Sequence[Feature]) -> bytes:
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = ET.SubElement(root, "Document")
    for feature in features:
        mark = ET.SubElement(document, "Placemark")
        ET.SubElement(mark, "name").text = feature.name
        data = ET.SubElement(ET.SubElement(mark, "ExtendedData"), "Data", name="kind")
        ET.SubElement(data, "value").text = feature.kind
        shape = ET.SubElement(mark, feature.geometry)
        if feature.geometry == "Polygon":
            for number, ring in enumerate(feature.parts):
                side = ET.SubElement(shape, "innerBoundaryIs" if number else "outerBoundaryIs")
                _write_points(ET.SubElement(side, "LinearRing"), ring)
        else:
            _write_points(shape, feature.parts[0])
    return encode_xml(root)


def write_kmz(features: Sequence[Feature]) -> bytes:
    return pack({"doc.kml": write_kml(features)})


def _write_points(element: ET.Element, points: Sequence[LonLat]) -> None:
    text = " ".join(f"{lon_deg:.9f},{lat_deg:.9f}" for lon_deg, lat_deg in points)
    ET.SubElement(element, "coordinates").text = text
