"""What a robot at work publishes for each display of the map, around one place of the farm."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from agribot.core.geo import Datum, MapFrame
from agribot.record.bag.definitions import ros2_store
from tests.ros.messages import shown_samples as samples

ROBOT = (3.5, 5.0, math.pi / 2.0)  # x, y (m) and heading in the map
CENTRE = (3.5, 7.0)  # of what is shown, m
_ANGLES = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
Way = list[tuple[float, float, float]]  # x, y, heading


class Shown(NamedTuple):
    """A display, the topic that it shows, and what it is set to, by the labels of the dialog."""

    display: str
    topic: str  # none where it needs none
    messages: Sequence[Any]
    rate_hz: float = 0.0  # one after the other, again and again; 0: once, latched
    options: dict[str, str] = {}  # noqa: RUF012 - of a NamedTuple
    part: str = ""  # a layer of it that comes later: fill, line, point or label


CENTRED = {"Corner": "centre"}


def make_gallery(datum: Datum) -> list[Shown]:
    """Make one for each display that shows a topic; fixes lie where `datum` says."""
    frame = MapFrame(datum)
    way = lap(4.2, 3.2)
    arrows = {"Draw as": "arrows", "Size": "7"}
    points = {"Draw as": "points", "Size": "5"}
    return [
        Shown("laserscan", "/scan", [make_scan()], 5.0),
        Shown("pointcloud2", "/cloud", [make_cloud()], 2.0),
        Shown("marker", "/markers", [make_markers()], 2.0),
        Shown("textured_marker", "/photo", [make_photo()]),
        Shown("occupancy_grid", "/map", [make_yard()]),
        Shown("image", "/camera/image_raw", [samples.image(draw_rows())], 2.0, CENTRED),
        Shown("disparity", "/disparity", [samples.disparity(draw_disparity())], 2.0, CENTRED),
        Shown("path", "/plan", [make_path()]),
        Shown("route", "/route", [make_route()], part="fill"),
        Shown("odometry", "/odom", [make_odometry(*at) for at in way], 2.0),
        Shown("gps", "/gps", [make_gps(frame, *at) for at in way], 2.0, {**arrows, "Size": "9"}),
        Shown("navsat", "/fix", [make_fix(frame, *at) for at in way], 2.0, points),
        Shown("pose", "/pose", [make_pose(*at) for at in way], 2.0, arrows),
        Shown("robot_image", "/base/pose", [make_pose(3.5, 8.0, 0.6)], 2.0, {"Length": "3"}),
        Shown("tf_frame", "frame:laser", [], 0.0, {"Length of the axes": "1.6"}),
        Shown("attitude_indicator", "/imu", [make_imu(0.25, -0.12)], 10.0, CENTRED),
        Shown("float", "/speed", [make_number(0.42)], 5.0,
              {**CENTRED, "Text before": "speed ", "Text after": " m/s", "Size": "22"}),
        Shown("string", "/status", [make_text("row 4 of 6: hoeing")], 2.0,
              {**CENTRED, "Size": "22"}),
        Shown("geojson", "/obstacles", [make_geojson(frame)]),
        Shown("grid", "", [], 0.0, {"East": "0", "North": "3.5", "Cell": "1", "Rows": "7",
              "Columns": "7", "Line width": "2"}),
    ]  # fmt: skip


def make_frames() -> Any:
    """The laser on the front of the robot, placed in the map."""
    x, y, yaw = ROBOT
    pose = samples.make("geometry_msgs/msg/Transform", samples.vector(x, y + 0.4, 0.5), turn(yaw))
    stamped = samples.make(
        "geometry_msgs/msg/TransformStamped", samples.header("map"), "laser", pose
    )
    return samples.make("tf2_msgs/msg/TFMessage", [stamped])


def turn(yaw_rad: float, roll_rad: float = 0.0, pitch_rad: float = 0.0) -> Any:
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(angle / 2.0), math.sin(angle / 2.0)) for angle in (roll_rad, pitch_rad, yaw_rad)
    )
    return samples.quaternion(
        sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy,
    )  # fmt: skip


def pose(x: float, y: float, yaw: float = 0.0) -> Any:
    return samples.make("geometry_msgs/msg/Pose", samples.point(x, y), turn(yaw))


def lap(half_x: float, half_y: float) -> Way:
    """Once around the rows, anticlockwise."""
    x, y = half_x * np.cos(_ANGLES), half_y * np.sin(_ANGLES)
    yaw = np.arctan2(half_y * np.cos(_ANGLES), -half_x * np.sin(_ANGLES))
    return [(CENTRE[0] + a, CENTRE[1] + b, c) for a, b, c in zip(x, y, yaw, strict=True)]


def make_scan() -> Any:
    """Stems of the rows to both sides, and a wall behind them."""
    angles = np.linspace(-math.pi / 2.0, math.pi / 2.0, 361)
    ranges = np.minimum(8.0, 4.5 / np.maximum(np.abs(np.sin(angles)), 0.4))
    for x in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5):
        for y in np.arange(0.4, 6.0, 0.5):
            far, bearing = math.hypot(x, y), math.atan2(x, y)
            hit = np.abs(angles - bearing) < 0.06 / far
            ranges[hit] = np.minimum(ranges[hit], far)
    message = samples.scan(list(ranges), frame="laser", step=math.pi / 360.0)
    message.angle_min, message.angle_max = -math.pi / 2.0, math.pi / 2.0
    return message


def make_cloud() -> Any:
    """Six ridges, each with its plants, 1 point every 6 cm."""
    x, y = np.meshgrid(np.arange(0.5, 6.5, 0.06), np.arange(3.0, 11.0, 0.06))
    beside, along = np.abs(x - np.round(x)), np.abs((y / 0.5) % 1.0 - 0.5) * 0.5
    z = 0.12 * np.cos(math.pi * beside) + np.where((beside < 0.12) & (along < 0.12), 0.25, 0.0)
    return samples.cloud(np.stack([x, y, z, z], axis=-1).reshape(-1, 4))


def make_yard() -> Any:
    """Sheds and a hedge around a free yard; what lies behind them is unknown."""
    cells = np.full((90, 140), -1, dtype=np.int8)
    cells[8:82, 8:132] = 0
    cells[8:12, 8:132] = cells[78:82, 8:132] = cells[8:82, 8:12] = 100
    cells[8:82, 128:132] = np.where(np.arange(74) % 20 < 14, 100, 0)[:, None]
    cells[50:70, 24:52] = cells[20:32, 92:116] = 100
    for row, column, reach in ((30, 40, 6), (58, 96, 9)):
        y, x = np.ogrid[:90, :140]
        cells[np.hypot(y - row, x - column) < reach] = 60
    grid = samples.grid(cells, resolution=0.1)
    grid.info.origin = pose(CENTRE[0] - 7.0, CENTRE[1] - 4.5)
    return grid


def make_markers() -> Any:
    """Plants, the border of the field, the way, and one of each other kind with its name."""
    made = [
        mark(5, 8, (0.0, 0.0), (0.25, 0.25), (30, 130, 50), plants(), ns="plants"),
        mark(6, 4, (0.0, 0.0), (0.12, 0.0), (120, 70, 20), border(), ns="border"),
        mark(7, 0, (-3.3, 8.6), (1.6, 0.2), (210, 90, 0)),
        mark(8, 1, (-2.5, 6.9), (1.0, 0.7), (40, 90, 200)),
        mark(9, 3, (-2.5, 5.2), (0.9, 0.9), (150, 40, 160)),
        mark(10, 11, (9.6, 8.4), (1.0, 1.0), (200, 40, 40), [(-0.6, 0.0), (0.6, 0.0), (0.0, 1.0)]),
        mark(11, 5, (9.6, 6.8), (0.1, 0.0), (20, 120, 120),
             [(-0.6, 0.3), (0.6, 0.3), (-0.6, -0.1), (0.6, -0.1)]),
        mark(12, 6, (9.6, 5.2), (0.4, 0.4), (90, 90, 90), [(-0.5, 0.0), (0.0, 0.0), (0.5, 0.0)]),
        label(20, (-2.5, 7.9), "arrow"), label(21, (-2.5, 6.2), "cube"),
        label(22, (-2.5, 4.4), "cylinder"), label(23, (9.6, 8.0), "triangles"),
        label(24, (9.6, 6.2), "lines"), label(25, (9.6, 4.6), "cubes"),
        label(26, (3.5, 11.1), "field 7"),
    ]  # fmt: skip
    return samples.make("visualization_msgs/msg/MarkerArray", made)


def mark(
    number: int,
    kind: int,
    at: tuple[float, float],
    size: tuple[float, float],
    rgb: tuple[int, int, int],
    points: Sequence[tuple[float, float]] = (),
    ns: str = "gallery",
) -> Any:
    made = samples.marker(number, kind=kind, at=at)
    made.ns, made.scale = ns, samples.vector(size[0], size[1], 0.2)
    made.color = samples.make("std_msgs/msg/ColorRGBA", *(c / 255.0 for c in rgb), 1.0)
    made.points = [samples.point(*one) for one in points]
    return made


def label(number: int, at: tuple[float, float], text: str) -> Any:
    made = mark(number, 9, at, (0.0, 0.0), (0, 0, 0))
    made.text = text
    return made


def plants() -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x in range(1, 7) for y in np.arange(4.0, 10.1, 0.5)]


def border() -> list[tuple[float, float]]:
    return [(0.3, 3.4), (6.7, 3.4), (6.7, 10.4), (0.3, 10.4), (0.3, 3.4)]


def draw_rows(side: int = 240) -> Any:
    """Rows of green on soil, seen from above."""
    y, x = np.mgrid[0:side, 0:side]
    rng = np.random.default_rng(7)
    beside = np.abs((x / 40.0) % 1.0 - 0.5)
    pixels = np.full((side, side, 3), (134, 104, 74), dtype=float)
    pixels[beside < 0.16 + 0.05 * np.sin(y / 5.0)] = (62, 124, 48)
    pixels += rng.normal(0.0, 12.0, (side, side, 1))
    return np.clip(pixels, 0.0, 255.0).astype(np.uint8)


def draw_disparity() -> Any:
    """Ground that comes nearer downwards, with two stems before it; no sky."""
    y, x = np.mgrid[0:180, 0:240]
    ground = np.where(y > 50, (y - 50) * 0.6, -1.0)
    for column, foot in ((70, 150), (170, 110)):
        stem = (np.abs(x - column) < 8) & (y < foot) & (y > foot - 90)
        ground = np.where(stem, (foot - 50) * 0.6, ground)
    return ground.astype("<f4")


def make_photo() -> Any:
    """A photograph of the ground, turned by 20 degrees."""
    made = samples.texture(draw_rows(), resolution=0.03)
    made.pose = pose(*CENTRE, math.radians(20.0))
    return samples.make("marti_visualization_msgs/msg/TexturedMarkerArray", [made])


def make_path() -> Any:
    """Up one row and down the next, with turns on the headland."""
    places: list[tuple[float, float]] = []
    for number, x in enumerate((0.5, 1.5, 2.5, 3.5, 4.5, 5.5)):
        ends = (3.6, 10.4) if number % 2 == 0 else (10.4, 3.6)
        places += [(x, ends[0]), (x, ends[1])]
        side = 1.0 if number % 2 == 0 else -1.0
        bend = np.linspace(0.0, math.pi, 9)[1:-1] if x < 5.5 else np.zeros(0)
        places += [(x + 0.5 - 0.5 * math.cos(a), ends[1] + side * 0.5 * math.sin(a)) for a in bend]
    poses = [make_pose(x, y, 0.0) for x, y in places]
    return samples.make("nav_msgs/msg/Path", samples.header("map"), poses)


def make_route() -> Any:
    corners = [(-2.5, 3.5), (0.0, 3.5), (0.0, 10.5), (7.0, 10.5), (7.0, 6.0), (9.5, 6.0)]
    made = samples.make_default(ros2_store(), "marti_nav_msgs/msg/Route")
    made.header = samples.header("map")
    for number, (x, y) in enumerate(corners):
        point = samples.make_default(ros2_store(), "marti_nav_msgs/msg/RoutePoint")
        point.pose, point.id = pose(x, y), str(number)
        made.route_points.append(point)
    return made


def make_route_position() -> Any:
    """Half of the way from the third corner to the fourth."""
    return samples.make("marti_nav_msgs/msg/RoutePosition", samples.header("map"), "", "2", 3.5)


def make_pose(x: float, y: float, yaw: float) -> Any:
    return samples.make("geometry_msgs/msg/PoseStamped", samples.header("map"), pose(x, y, yaw))


def make_odometry(x: float, y: float, yaw: float) -> Any:
    """The error across the way is twice that along it."""
    made = samples.make_default(ros2_store(), "nav_msgs/msg/Odometry")
    made.header, made.child_frame_id = samples.header("map"), "base_link"
    made.pose.pose = pose(x, y, yaw)
    c, s = math.cos(yaw), math.sin(yaw)
    axes = np.array([[c, -s], [s, c]])
    within = axes @ np.diag([0.2**2, 0.4**2]) @ axes.T
    made.pose.covariance[[0, 1, 6, 7]] = within.ravel()
    return made


def make_fix(frame: MapFrame, x: float, y: float, _yaw: float) -> Any:
    made = samples.make_default(ros2_store(), "sensor_msgs/msg/NavSatFix")
    made.header = samples.header("gps")
    made.latitude, made.longitude, made.altitude = frame.geodetic_from_map(x, y)
    return made


def make_gps(frame: MapFrame, x: float, y: float, yaw: float) -> Any:
    made = samples.make_default(ros2_store(), "gps_msgs/msg/GPSFix")
    made.header = samples.header("gps")
    made.latitude, made.longitude, made.altitude = frame.geodetic_from_map(x, y)
    made.track = (90.0 - math.degrees(yaw)) % 360.0
    return made


def make_imu(roll_rad: float, pitch_rad: float) -> Any:
    made = samples.make_default(ros2_store(), "sensor_msgs/msg/Imu")
    made.header, made.orientation = samples.header("imu"), turn(0.0, roll_rad, pitch_rad)
    return made


def make_number(value: float) -> Any:
    return samples.make("marti_common_msgs/msg/Float64Stamped", samples.header(""), value)


def make_text(text: str) -> Any:
    return samples.make("marti_common_msgs/msg/StringStamped", samples.header(""), text)


def make_geojson(frame: MapFrame) -> Any:
    """A pond, and a pole beside it."""
    ring = [(7.5 + 1.4 * math.cos(a), 7.0 + 2.2 * math.sin(a)) for a in _ANGLES]

    def at(x: float, y: float) -> list[float]:
        lat_deg, lon_deg, _ = frame.geodetic_from_map(x, y)
        return [lon_deg, lat_deg]

    pond = {"type": "Polygon", "coordinates": [[at(*one) for one in [*ring, ring[0]]]]}
    pole = {"type": "Point", "coordinates": at(-1.5, 7.0)}
    features = [
        {"type": "Feature", "properties": {"color": "#1f6fd0"}, "geometry": pond},
        {"type": "Feature", "properties": {}, "geometry": pole},
    ]
    text = json.dumps({"type": "FeatureCollection", "features": features})
    return samples.make("std_msgs/msg/String", text)
