"""KML and KMZ (OGC 12-007r2); `kind` is extended data of a placemark."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

from agribot.gis.formats.untrusted import (
    encode_xml,
    get_local_name,
    pack,
    parse_xml,
    read_text,
    unpack,
)
from agribot.gis.geojson import Feature, Found, Geometry, LonLat

_NAMESPACE = "http://www.opengis.net/kml/2.2"


def read_kml(data: bytes) -> Found:
    for mark in parse_xml(data).iter():
        if get_local_name(mark) == "Placemark":
            fields = {"name": read_text(mark, "name"), "kind": _read_kind(mark)}
            properties = {key: value for key, value in fields.items() if value}
            for geometry in _read_shapes(mark):
                yield geometry, properties


def read_kmz(data: bytes) -> Found:
    files = unpack(data, ".kml")
    if not files:
        raise ValueError("no .kml file inside")
    yield from read_kml(next(iter(files.values())))


def _read_kind(mark: ET.Element) -> str:
    kinds = (
        e
        for e in mark.iter()
        if get_local_name(e) in {"Data", "SimpleData"} and e.get("name") == "kind"
    )
    return next((read_text(e, "value") or (e.text or "").strip() for e in kinds), "")


def _read_shapes(mark: ET.Element) -> Iterator[Geometry]:
    for element in mark.iter():
        kind = get_local_name(element)
        if kind in {"Point", "LineString"}:
            points = _read_points(element)
            yield {"type": kind, "coordinates": points[0] if kind == "Point" else points}
        elif kind == "Polygon":
            rings = [ring for ring in element.iter() if get_local_name(ring) == "LinearRing"]
            yield {"type": "Polygon", "coordinates": [_read_points(ring) for ring in rings]}


def _read_points(element: ET.Element) -> list[list[float]]:
    text = next((e.text or "" for e in element.iter() if get_local_name(e) == "coordinates"), "")
    return [[float(number) for number in point.split(",")[:2]] for point in text.split()]


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
