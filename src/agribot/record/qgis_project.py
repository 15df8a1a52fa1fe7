"""A recording as a QGIS project: track, plan, goals and weeds as GeoJSON, and the project's XML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import msgspec

from agribot.core import topics
from agribot.core.errors import RecordingError
from agribot.core.geo import MapFrame
from agribot.record.bag.track import read_track
from agribot.record.mcap_file import read_messages
from agribot.record.replay import read_config, read_weed_map
from agribot.record.report import write_file
from agribot.record.weeds import weeds_geojson
from agribot.ros.messages.rosmsg import load_types

PROJECT = "agribot.qgs"
_VERSION = "3.22"
_WGS84 = "EPSG:4326"
_DECIMALS = 9
Colour = tuple[int, int, int]
_RED, _GREEN, _BLUE, _DARK = (217, 38, 31), (51, 153, 64), (30, 110, 220), (40, 40, 40)


class Layer(NamedTuple):
    """`colours` are those of the values of `by`, or with an empty `by` one for all."""

    name: str
    geometry: str  # Point or Line
    root: dict[str, Any]
    colours: dict[str, Colour]
    by: str = ""

    @property
    def id(self) -> str:
        """QGIS gives short ones a new name of its own, under which its tree finds nothing."""
        return f"{self.name}_of_agribot"


def write_qgis(recording: Path, folder: Path) -> Path:
    """Write the project and its layers; a layer without data is left out.

    Raises: RecordingError: nothing in it has a place on Earth, or a file cannot be written.
    """
    layers = _make_layers(recording)
    for layer in layers:
        text = msgspec.json.encode(layer.root)
        write_file(folder / f"{layer.name}.geojson", text + b"\n")
    write_file(folder / PROJECT, _make_project(layers))
    return folder / PROJECT


def _make_layers(recording: Path) -> list[Layer]:
    """Make the layers from the bottom to the top."""
    try:
        config = read_config(recording)
    except RecordingError:
        track = read_track(recording)
        return [_make_line("track", [(p.lon_deg, p.lat_deg) for p in track.points], _GREEN)]
    track = read_track(recording, topics.ODOMETRY.name)
    layers = [_make_line("track", [(p.lon_deg, p.lat_deg) for p in track.points], _GREEN)]
    frame = MapFrame(config.field.datum)
    for message in list(read_messages(recording, topics.PATH))[-1:]:
        path: Any = load_types().deserialize_cdr(message.data, topics.PATH.ros_type)
        layers.append(
            _make_line("plan", _place_on_earth(frame, [s.pose for s in path.poses]), _BLUE)
        )
    for message in list(read_messages(recording, topics.GOALS))[-1:]:
        goals: Any = load_types().deserialize_cdr(message.data, topics.GOALS.ros_type)
        layers.append(_make_points("goals", _place_on_earth(frame, goals.poses), _DARK))
    try:
        weeds = weeds_geojson(read_weed_map(recording), config.field.datum)
    except RecordingError:
        return layers  # the run was cut off before its map was written
    return [*layers, Layer("weeds", "Point", weeds, {"weed": _RED, "crop": _GREEN}, by="class")]


def _place_on_earth(frame: MapFrame, poses: Sequence[Any]) -> list[tuple[float, float]]:
    found = [frame.geodetic_from_map(pose.position.x, pose.position.y) for pose in poses]
    return [(lon_deg, lat_deg) for lat_deg, lon_deg, _ in found]


def _make_line(name: str, places: Sequence[tuple[float, float]], colour: Colour) -> Layer:
    geometry = {"type": "LineString", "coordinates": _round_places(places)}
    return Layer(name, "Line", _make_collection([geometry]), {"": colour})


def _make_points(name: str, places: Sequence[tuple[float, float]], colour: Colour) -> Layer:
    geometries = [{"type": "Point", "coordinates": place} for place in _round_places(places)]
    return Layer(name, "Point", _make_collection(geometries), {"": colour})


def _round_places(places: Sequence[tuple[float, float]]) -> list[list[float]]:
    return [[round(lon_deg, _DECIMALS), round(lat_deg, _DECIMALS)] for lon_deg, lat_deg in places]


def _make_collection(geometries: Sequence[dict[str, Any]]) -> dict[str, Any]:
    features = [
        {"type": "Feature", "properties": {"number": number}, "geometry": geometry}
        for number, geometry in enumerate(geometries, start=1)
    ]
    return {"type": "FeatureCollection", "features": features}


def _make_project(layers: Sequence[Layer]) -> bytes:
    root = ElementTree.Element("qgis", projectname="AGRIBOT", version=_VERSION)
    ElementTree.SubElement(root, "title").text = "AGRIBOT"
    _add_reference(ElementTree.SubElement(root, "projectCrs"))
    systems = ElementTree.SubElement(ElementTree.SubElement(root, "properties"), "SpatialRefSys")
    ElementTree.SubElement(systems, "ProjectionsEnabled", type="int").text = "1"
    tree = ElementTree.SubElement(root, "layer-tree-group")
    for layer in reversed(layers):
        ElementTree.SubElement(
            tree, "layer-tree-layer", id=layer.id, name=layer.name, checked="Qt::Checked"
        )
    found = ElementTree.SubElement(root, "projectlayers")
    for layer in layers:
        found.append(_make_map_layer(layer))
    ElementTree.indent(root)
    return b"<!DOCTYPE qgis>\n" + ElementTree.tostring(root) + b"\n"


def _make_map_layer(layer: Layer) -> ElementTree.Element:
    node = ElementTree.Element("maplayer", type="vector", geometry=layer.geometry)
    for name, text in (
        ("id", layer.id),
        ("datasource", f"./{layer.name}.geojson"),
        ("layername", layer.name),
    ):
        ElementTree.SubElement(node, name).text = text
    ElementTree.SubElement(node, "provider", encoding="UTF-8").text = "ogr"
    _add_reference(ElementTree.SubElement(node, "srs"))
    node.append(_make_renderer(layer))
    return node


def _add_reference(node: ElementTree.Element) -> None:
    system = ElementTree.SubElement(node, "spatialrefsys")
    for name, text in {"srsid": "3452", "srid": "4326", "authid": _WGS84}.items():
        ElementTree.SubElement(system, name).text = text


def _make_renderer(layer: Layer) -> ElementTree.Element:
    node = ElementTree.Element("renderer-v2", type="singleSymbol")
    if layer.by:
        node.set("type", "categorizedSymbol")
        node.set("attr", layer.by)
        categories = ElementTree.SubElement(node, "categories")
        for number, value in enumerate(layer.colours):
            ElementTree.SubElement(
                categories, "category", symbol=str(number), value=value, label=value, render="true"
            )
    symbols = ElementTree.SubElement(node, "symbols")
    for number, colour in enumerate(layer.colours.values()):
        symbols.append(_make_symbol(layer.geometry, number, colour))
    return node


def _make_symbol(geometry: str, number: int, colour: Colour) -> ElementTree.Element:
    is_line = geometry == "Line"
    node = ElementTree.Element("symbol", name=str(number), type="line" if is_line else "marker")
    kind = "SimpleLine" if is_line else "SimpleMarker"
    part = ElementTree.SubElement(node, "layer", {"class": kind})
    text = ",".join(map(str, (*colour, 255)))
    for key in ("line_color",) if is_line else ("color", "outline_color"):
        ElementTree.SubElement(part, "prop", k=key, v=text)
    return node
