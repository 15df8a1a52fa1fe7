"""Where the robot was: the track of any recording, as GPX, KML or CSV."""

from __future__ import annotations

import csv
import io
import math
import tomllib
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import msgspec

from agribot.core.config import RunConfig
from agribot.core.errors import RecordingError
from agribot.core.geo import MapFrame, is_place
from agribot.record.bag.opening import open_bag
from agribot.record.bag.source import Bag, BagTopic
from agribot.record.recorder import CONFIG_ATTACHMENT
from agribot.ros.messages.fixes import GPSFIXES, NAVSATFIX
from agribot.ros.messages.utm import ODOMETRY

POSES = (ODOMETRY, "geometry_msgs/msg/PoseStamped")
FIXES = (NAVSATFIX, *GPSFIXES)
SUFFIXES = (".gpx", ".kml", ".csv")

_GPX, _KML = "http://www.topografix.com/GPX/1/1", "http://www.opengis.net/kml/2.2"
_PREFERRED = ("/agribot/fix", "/fix")
# Time below which stamps are simulated or those of an unset clock.
_CLOCK_SET_S = 10 * 365 * 86400.0


class TrackPoint(msgspec.Struct, frozen=True, kw_only=True):
    """`std_m` is the horizontal 1 sigma. Where unknown it is None, and the altitude NaN."""

    t_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    std_m: float | None = None


class GeoTrack(msgspec.Struct, frozen=True, kw_only=True):
    """Points of a drive; `without_fix` messages had no position."""

    topic: str
    points: tuple[TrackPoint, ...]
    without_fix: int


def read_track(path: Path, topic_name: str = "") -> GeoTrack:
    """Read the track of the given topic, the robot's own fixes, or the first topic with fixes.

    Poses in the map of a run of ours are placed by the datum in its settings.
    Raises: RecordingError: no such topic, or none with positions.
    """
    with open_bag(path) as bag:
        topic = bag.find(topic_name) if topic_name else _find_topic(bag)
        point_of = _choose_reader(bag, topic)
        found = [
            (message.log_ns, point_of(value))
            for message, value in bag.values(frozenset({topic.name}))
        ]
        found.sort(key=lambda each: each[0])  # a recorder may write them in another order
        points = tuple(point for _, point in found if point is not None)
        return GeoTrack(topic=topic.name, points=points, without_fix=len(found) - len(points))


def encode_track(track: GeoTrack, suffix: str, name: str) -> bytes:
    """Encode a track as the bytes of a .gpx, .kml or .csv file.

    Raises: RecordingError: another suffix.
    """
    if suffix == ".gpx":
        return _encode_gpx(track, name)
    if suffix == ".kml":
        return _encode_kml(track, name)
    if suffix == ".csv":
        return _encode_csv(track)
    raise RecordingError(f"'{suffix}' is no track format; choose {', '.join(SUFFIXES)}")


def _find_topic(bag: Bag) -> BagTopic:
    found = [topic for topic in bag.topics if topic.ros_type in FIXES and topic.count]
    if not found:
        raise RecordingError(
            f"{bag.path} has no topic with positions on Earth ({', '.join(FIXES)}), only "
            f"{bag.contents}; name one with odometry of a run of ours (agribot bag track BAG "
            "--topic NAME -o FILE), or draw paths without a place on Earth: agribot report"
        )
    preferred = [topic for topic in found if topic.name in _PREFERRED]
    return (preferred or found)[0]


def _choose_reader(bag: Bag, topic: BagTopic) -> Callable[[Any], TrackPoint | None]:
    if topic.ros_type in FIXES:
        return _read_fix
    if topic.ros_type not in POSES:
        raise RecordingError(
            f"{topic.name} is {topic.ros_type or topic.encoding}; "
            f"a track needs {', '.join((*FIXES, *POSES))}"
        )
    frame = _map_frame(bag)
    return lambda message: _read_pose(message, frame)


def _read_fix(fix: Any) -> TrackPoint | None:
    if fix.status.status < 0 or not is_place(fix.latitude, fix.longitude):
        return None
    variance = float(fix.position_covariance[0] + fix.position_covariance[4]) / 2.0
    known = fix.position_covariance_type and 0.0 < variance < math.inf
    return TrackPoint(
        t_s=_seconds(fix.header.stamp),
        lat_deg=fix.latitude,
        lon_deg=fix.longitude,
        alt_m=fix.altitude if math.isfinite(fix.altitude) else math.nan,
        std_m=math.sqrt(variance) if known else None,
    )


def _read_pose(message: Any, frame: MapFrame) -> TrackPoint:
    outer = message.pose
    pose = getattr(outer, "pose", outer)
    lat_deg, lon_deg, alt_m = frame.geodetic_from_map(pose.position.x, pose.position.y)
    variance = float(outer.covariance[0] + outer.covariance[7]) / 2.0 if outer is not pose else -1.0
    return TrackPoint(
        t_s=_seconds(message.header.stamp),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        alt_m=alt_m,
        std_m=math.sqrt(variance) if variance >= 0.0 else None,
    )


def _map_frame(bag: Bag) -> MapFrame:
    for file in bag.files():
        if file.name == CONFIG_ATTACHMENT:
            config = msgspec.convert(tomllib.loads(file.data.decode()), RunConfig)
            return MapFrame(config.field.datum)
    raise RecordingError(
        f"{bag.path} does not say where on Earth its map lies; choose a topic with fixes"
    )


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _list_times(track: GeoTrack) -> Iterator[tuple[TrackPoint, str]]:
    """List the points with their UTC time, empty for simulated time."""
    for point in track.points:
        text = ""
        if point.t_s > _CLOCK_SET_S:
            moment = datetime.fromtimestamp(point.t_s, UTC)
            text = f"{moment:%Y-%m-%dT%H:%M:%S}.{moment.microsecond // 1000:03d}Z"
        yield point, text


def _encode_gpx(track: GeoTrack, name: str) -> bytes:
    root = ElementTree.Element("gpx", xmlns=_GPX, version="1.1", creator="AGRIBOT")
    line = ElementTree.SubElement(root, "trk")
    ElementTree.SubElement(line, "name").text = name
    segment = ElementTree.SubElement(line, "trkseg")
    for point, time in _list_times(track):
        node = ElementTree.SubElement(
            segment, "trkpt", lat=f"{point.lat_deg:.9f}", lon=f"{point.lon_deg:.9f}"
        )
        if alt := _write_alt(point):
            ElementTree.SubElement(node, "ele").text = alt
        if time:
            ElementTree.SubElement(node, "time").text = time
    return _encode_xml(root)


def _encode_kml(track: GeoTrack, name: str) -> bytes:
    root = ElementTree.Element("kml", xmlns=_KML)
    document = ElementTree.SubElement(root, "Document")
    ElementTree.SubElement(document, "name").text = name
    place = ElementTree.SubElement(document, "Placemark")
    ElementTree.SubElement(place, "name").text = track.topic
    line = ElementTree.SubElement(place, "LineString")
    ElementTree.SubElement(line, "tessellate").text = "1"
    ElementTree.SubElement(line, "coordinates").text = " ".join(
        ",".join(filter(None, (f"{p.lon_deg:.9f}", f"{p.lat_deg:.9f}", _write_alt(p))))
        for p in track.points
    )
    return _encode_xml(root)


def _encode_csv(track: GeoTrack) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("t_s", "time_utc", "lat_deg", "lon_deg", "alt_m", "std_m"))
    for p, time in _list_times(track):
        std = "" if p.std_m is None else f"{p.std_m:.4f}"
        place = (f"{p.lat_deg:.9f}", f"{p.lon_deg:.9f}", _write_alt(p))
        writer.writerow((f"{p.t_s:.9f}", time, *place, std))
    return text.getvalue().encode()


def _write_alt(point: TrackPoint) -> str:
    """Write the altitude; empty without one."""
    return "" if math.isnan(point.alt_m) else f"{point.alt_m:.3f}"


def _encode_xml(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"
