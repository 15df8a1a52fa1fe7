"""KML and KMZ (OGC 12-007r2); `kind` is extended data of a placemark."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

from agribot.gis.formats.untrusted import packed, tag, text_of, unpacked, xml_bytes, xml_tree
from agribot.gis.geojson import Feature, Found, Geometry, LonLat

_NAMESPACE = "http://www.opengis.net/kml/2.2"


def read_kml(data: bytes) -> Found:
    for mark in xml_tree(data).iter():
        if tag(mark) == "Placemark":
            told = {"name": text_of(mark, "name"), "kind": _kind(mark)}
            properties = {key: value for key, value in told.items() if value}
            for geometry in _shapes(mark):
                yield geometry, properties


def read_kmz(data: bytes) -> Found:
    files = unpacked(data, ".kml")
    if not files:
        raise ValueError("no .kml file inside")
    yield from read_kml(next(iter(files.values())))


def _kind(mark: ET.Element) -> str:
    kinds = (e for e in mark.iter() if tag(e) in {"Data", "SimpleData"} and e.get("name") == "kind")
    return next((text_of(e, "value") or (e.text or "").strip() for e in kinds), "")


def _shapes(mark: ET.Element) -> Iterator[Geometry]:
    for element in mark.iter():
        kind = tag(element)
        if kind in {"Point", "LineString"}:
            points = _points(element)
            yield {"type": kind, "coordinates": points[0] if kind == "Point" else points}
        elif kind == "Polygon":
            rings = [ring for ring in element.iter() if tag(ring) == "LinearRing"]
            yield {"type": "Polygon", "coordinates": [_points(ring) for ring in rings]}


def _points(element: ET.Element) -> list[list[float]]:
    text = next((e.text or "" for e in element.iter() if tag(e) == "coordinates"), "")
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
    return xml_bytes(root)


def write_kmz(features: Sequence[Feature]) -> bytes:
    return packed({"doc.kml": write_kml(features)})


def _write_points(element: ET.Element, points: Sequence[LonLat]) -> None:
    text = " ".join(f"{lon_deg:.9f},{lat_deg:.9f}" for lon_deg, lat_deg in points)
    ET.SubElement(element, "coordinates").text = text
