"""Headings, speeds and tracks in a recording of another robot, or in a cut one of agribot."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from agribot.core.errors import RecordingError
from agribot.core.geo import MapFrame, compass_deg_from_yaw, is_place, make_datum
from agribot.core.messages import FloatArray
from agribot.record.bag.opening import open_bag
from agribot.record.bag.source import Bag, BagTopic
from agribot.record.frames_path import read_frames_path
from agribot.ros.messages.fixes import GPSFIXES, NAVSATFIX
from agribot.ros.messages.utm import ODOMETRY

_NUMBER = "std_msgs/msg/Float64"
_RAW_NAMES = ("/agribot/heading/raw", "Rawheading")
_FILTERED_NAMES = ("/agribot/heading/filtered", "Filteredheading")
# An odometry that states worse is one that does not know yet where it is.
_UNKNOWN_POS_STD_M, _UNKNOWN_YAW_STD_RAD = 100.0, math.pi / 2
_DISTANCE_NAMES = ("/agribot/distance", "distance")


class PlotLine(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A plotted series (N, 2) of seconds since the start and value, and its topic."""

    label: str
    points: FloatArray


class ForeignData(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Headings are degrees as recorded; of odometry and IMU clockwise from North.

    `tracks` are (N, 2) metres East and North of the first fix, of odometry in its own frame, of
    a recording with neither in the outermost frame of its tf.
    `missing` lists what could not be shown and what that needs.
    """

    heading_raw: tuple[PlotLine, ...]
    heading_filtered: tuple[PlotLine, ...]
    distance: tuple[PlotLine, ...]
    speed: tuple[PlotLine, ...]
    tracks: tuple[PlotLine, ...]
    missing: tuple[str, ...]
    notes: tuple[str, ...]
    damage: tuple[str, ...]
    duration_s: float
    messages: int

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing at all to be shown."""
        series = (self.heading_raw, self.heading_filtered, self.distance, self.speed, self.tracks)
        return not any(series)


_Extract = Callable[[Any], float | tuple[float, ...] | None]


def _get_time(row: tuple[float, ...]) -> float:
    """Return the time of a row, for recorders that wrote messages out of order."""
    return row[0]


class _Collector:
    def __init__(self) -> None:
        self.rules: dict[int, list[tuple[str, str, _Extract]]] = {}
        self.rows: dict[tuple[str, str], list[tuple[float, ...]]] = {}

    def request(self, topic: BagTopic, plot: str, label: str, extract: _Extract) -> None:
        self.rules.setdefault(topic.id, []).append((plot, label, extract))

    def lines(self, plot: str) -> tuple[PlotLine, ...]:
        return tuple(
            PlotLine(label=label, points=np.array(sorted(rows, key=_get_time), dtype=float))
            for (kind, label), rows in self.rows.items()
            if kind == plot and rows
        )


def read_foreign(path: Path) -> ForeignData:
    """Read what a recording of another robot holds of a drive.

    Raises: RecordingError: it cannot be read, or nothing in it can be shown.
    """
    with open_bag(path) as bag:
        collector = _Collector()
        for topic in bag.topics:
            if bag.knows(topic) and topic.count > 1:
                _add_rules(topic, collector)
        start_ns, end_ns = bag.times_ns or (0, 0)
        wanted = frozenset(t.name for t in bag.topics if t.id in collector.rules)
        for message, value in bag.values(wanted) if wanted else ():
            t_s = (message.log_ns - start_ns) * 1e-9
            for plot, label, extract in collector.rules.get(message.topic.id, ()):
                found = extract(value)
                if found is not None:
                    row = (t_s, found) if isinstance(found, float) else (t_s, *found)
                    collector.rows.setdefault((plot, label), []).append(row)
        if not collector.lines("track"):
            _follow_frames(bag, collector)
        data = _make_data(bag, collector, (end_ns - start_ns) * 1e-9)
        if data.is_empty:
            raise RecordingError(explain_nothing_to_show(bag))
        return data


def explain_nothing_to_show(bag: Bag) -> str:
    """Say in one line what a recording holds, and what could have been shown."""
    return (
        f"{bag.path} holds nothing that can be shown; it has {bag.contents}; what can be: "
        "NavSatFix, GPSFix, Odometry, tf with a frame that moves, Imu, MagneticField, Twist, and "
        "Float64 headings and distances; agribot bag csv makes a table of any topic"
    )


def _follow_frames(bag: Bag, collector: _Collector) -> None:
    path = read_frames_path(bag)
    if path is not None:
        label = f"tf {path.fixed} to {path.frame}"
        rows = [tuple(row) for row in path.points.tolist()]
        collector.rows["track", label] = rows


def _make_data(bag: Bag, collector: _Collector, duration_s: float) -> ForeignData:
    plots = {name: collector.lines(name) for name in ("raw", "filtered", "distance", "speed")}
    timed = collector.lines("track")
    tracks = tuple(PlotLine(label=line.label, points=line.points[:, 1:]) for line in timed)
    plots["distance"] += tuple(
        PlotLine(label=f"driven, by {line.label}", points=_sum_distance(line.points))
        for line in timed
    )
    needs = {
        "raw": "raw heading: no Float64 called Rawheading and no magnetometer",
        "filtered": "filtered heading: no Float64 called Filteredheading, no odometry, no IMU",
        "distance": "distance: no Float64 called distance, no fixes, no odometry and no moving tf",
        "speed": "speed: no odometry, Twist or GPSFix",
    }
    missing = [need for name, need in needs.items() if not plots[name]]
    if not tracks:
        missing.append("track: no fix with a position, no odometry and no tf that moves")
    return ForeignData(
        heading_raw=plots["raw"],
        heading_filtered=plots["filtered"],
        distance=plots["distance"],
        speed=plots["speed"],
        tracks=tracks,
        missing=tuple(missing),
        notes=tuple(bag.notes),
        damage=tuple(damage.describe() for damage in bag.damage),
        duration_s=duration_s,
        messages=bag.count,
    )


def _add_rules(topic: BagTopic, collector: _Collector) -> None:
    kind, name = topic.ros_type, topic.name
    if kind == _NUMBER:
        for plot, names in (
            ("raw", _RAW_NAMES), ("filtered", _FILTERED_NAMES), ("distance", _DISTANCE_NAMES),
        ):  # fmt: skip
            if any(name.lower().strip("/").endswith(n.lower().strip("/")) for n in names):
                collector.request(topic, plot, name, lambda message: _drop_not_finite(message.data))
    elif kind in (NAVSATFIX, *GPSFIXES):
        collector.request(topic, "track", name, _Places())
        if kind in GPSFIXES:
            collector.request(topic, "speed", name, lambda message: _drop_not_finite(message.speed))
    elif kind == ODOMETRY:
        collector.request(topic, "track", name, _read_odometry_place)
        collector.request(topic, "filtered", name, _read_odometry_compass)
        collector.request(topic, "speed", name, lambda m: _drop_not_finite(m.twist.twist.linear.x))
    else:
        _add_heading_and_speed_rules(topic, collector)


def _add_heading_and_speed_rules(topic: BagTopic, collector: _Collector) -> None:
    kind, name = topic.ros_type, topic.name
    if kind == "sensor_msgs/msg/Imu":
        collector.request(topic, "filtered", name, _read_imu_compass)
    elif kind == "sensor_msgs/msg/MagneticField":
        collector.request(topic, "raw", name, lambda m: _compass_deg_from_field(m.magnetic_field))
    elif kind == "geometry_msgs/msg/Vector3Stamped" and "mag" in name.lower():
        collector.request(topic, "raw", name, lambda m: _compass_deg_from_field(m.vector))
    elif kind == "geometry_msgs/msg/Twist":
        collector.request(topic, "speed", name, lambda m: _drop_not_finite(m.linear.x))
    elif kind == "geometry_msgs/msg/TwistStamped":
        collector.request(topic, "speed", name, lambda m: _drop_not_finite(m.twist.linear.x))


class _Places:
    """Fixes as metres from the first of them."""

    def __init__(self) -> None:
        self._frame: MapFrame | None = None

    def __call__(self, fix: Any) -> tuple[float, float] | None:
        if fix.status.status < 0 or not is_place(fix.latitude, fix.longitude):
            return None
        if self._frame is None:
            self._frame = MapFrame(make_datum(fix.latitude, fix.longitude, fix.altitude))
        # All at one altitude: a fix with one among others without would be drawn aside.
        east_m, north_m, _ = self._frame.map_from_geodetic(fix.latitude, fix.longitude, math.nan)
        return east_m, north_m


def _read_odometry_place(message: Any) -> tuple[float, float] | None:
    x_m2, y_m2 = message.pose.covariance[0], message.pose.covariance[7]
    if max(x_m2, y_m2) > _UNKNOWN_POS_STD_M**2:
        return None
    position = message.pose.pose.position
    return position.x, position.y


def _read_odometry_compass(message: Any) -> float | None:
    if message.pose.covariance[35] > _UNKNOWN_YAW_STD_RAD**2:
        return None
    return _compass_deg_from_quaternion(message.pose.pose.orientation)


def _sum_distance(timed: FloatArray) -> FloatArray:
    """Convert seconds and place, (N, 3), to seconds and metres driven since the first, (N, 2)."""
    steps_m = np.hypot(*np.diff(timed[:, 1:3], axis=0, prepend=timed[:1, 1:3]).T)
    return np.column_stack([timed[:, 0], np.cumsum(steps_m)])


def _drop_not_finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _compass_deg_from_quaternion(q: Any) -> float | None:
    """Compute the heading clockwise from North in an East-North-Up frame."""
    norm = q.x**2 + q.y**2 + q.z**2 + q.w**2
    if not math.isfinite(norm) or norm < 0.5:
        return None
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
    return compass_deg_from_yaw(yaw)


def _read_imu_compass(message: Any) -> float | None:
    if message.orientation_covariance[0] == -1.0:  # it measures no orientation
        return None
    return _compass_deg_from_quaternion(message.orientation)


def _compass_deg_from_field(field: Any) -> float | None:
    """Compute the heading of a level magnetometer, clockwise from magnetic North."""
    return _drop_not_finite(math.degrees(math.atan2(field.y, field.x)) % 360.0)
