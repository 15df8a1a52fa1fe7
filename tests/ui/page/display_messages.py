"""A message for each kind of display as rosbridge gives it, each at a place of its own."""

from __future__ import annotations

import base64
import io
import math
import struct
from typing import Any

import numpy as np
from PIL import Image

from agribot.core.geo import Datum, MapFrame
from tests.ui.page.fake_robot import DATUM

Message = dict[str, Any]
MAP = {"frame_id": "map"}
FRAME = MapFrame(Datum(lat_deg=DATUM.lat_deg, lon_deg=DATUM.lon_deg))
RED, GREEN, BLUE = (220, 20, 20), (20, 190, 40), (20, 40, 230)


def lat_lon(x_m: float, y_m: float) -> tuple[float, float]:
    lat_deg, lon_deg, _ = FRAME.geodetic_from_map(x_m, y_m)
    return lat_deg, lon_deg


def turned(yaw_rad: float) -> Message:
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)}


def pose(x_m: float, y_m: float, yaw_rad: float = 0.0) -> Message:
    return {"position": {"x": x_m, "y": y_m, "z": 0.0}, "orientation": turned(yaw_rad)}


def raw_image(rgb: tuple[int, int, int], width: int = 4, height: int = 2) -> Message:
    data = base64.b64encode(bytes(rgb) * (width * height)).decode()
    return {
        "width": width,
        "height": height,
        "encoding": "rgb8",
        "step": 3 * width,
        "data": data,
    }


def png(rgb: tuple[int, int, int], width: int = 40, height: int = 20) -> str:
    file = io.BytesIO()
    Image.new("RGB", (width, height), rgb).save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()


def fix(x_m: float, y_m: float, **more: Any) -> Message:
    lat_deg, lon_deg = lat_lon(x_m, y_m)
    return {"header": {"frame_id": "gps"}, "latitude": lat_deg, "longitude": lon_deg, **more}


def scan() -> Message:
    """A quarter circle of 2 m before the robot, one ray without an echo."""
    ranges = [2.0] * 31
    ranges[3] = math.inf
    return {
        "header": {"frame_id": "base_link"},
        "angle_min": -math.pi / 4,
        "angle_increment": math.pi / 60,
        "range_min": 0.1,
        "range_max": 10.0,
        "ranges": [None if math.isinf(r) else r for r in ranges],
    }


def cloud(x_m: float, y_m: float) -> Message:
    """Three points a metre apart, each a metre higher, with a packed colour."""
    rows = [struct.pack("<fffI", x_m + i, y_m, float(i), 0xFF0000 >> 8 * i) for i in range(3)]
    fields = [
        {"name": name, "offset": 4 * i, "datatype": 7}
        for i, name in enumerate(("x", "y", "z", "rgb"))
    ]
    data = base64.b64encode(b"".join(rows)).decode()
    size = {"width": 3, "height": 1, "point_step": 16}
    return {"header": MAP, "fields": fields, "is_bigendian": False, **size, "data": data}


def marker(number: int, kind: int, x_m: float, y_m: float, **more: Any) -> Message:
    colour = {"r": 1.0, "g": 0.5, "b": 0.0, "a": 1.0}
    size = {"x": 0.6, "y": 0.6, "z": 0.6}
    own = {"ns": "test", "id": number, "type": kind, "action": 0, "pose": pose(x_m, y_m)}
    return {"header": MAP, **own, "scale": size, "color": colour, **more}


def points(*places: tuple[float, float]) -> list[Message]:
    return [{"x": x_m, "y": y_m, "z": 0.0} for x_m, y_m in places]


MARKER_X = {
    name: 2.0 * i
    for i, name in enumerate(
        ("arrow", "cube", "sphere", "cylinder", "strip", "list", "cubes", "spheres", "points",
         "text", "mesh", "triangle")
    )
}  # fmt: skip
MARKER_Y = -19.0


def markers() -> Message:
    """One of each kind in a row; the last is deleted again."""
    made = []
    for number, name in enumerate(MARKER_X):
        x_m = MARKER_X[name]
        more: Message = {}
        if name in {"strip", "list", "cubes", "spheres", "points"}:
            more["points"] = points((-0.4, 0.0), (0.4, 0.0))
            more["scale"] = {"x": 0.2, "y": 0.2, "z": 0.2}
        if name == "triangle":
            more["points"] = points((-0.5, -0.5), (0.5, -0.5), (0.0, 0.6))
        if name == "text":
            more["text"] = "weed 7"
        made.append(marker(number, number, x_m, MARKER_Y, **more))
    made += [marker(99, 1, -3.0, MARKER_Y), {**marker(99, 1, -3.0, MARKER_Y), "action": 2}]
    return {"markers": made}


def grid(x_m: float, y_m: float) -> Message:
    """4 x 4 cells of half a metre: free on the left, occupied on the right, unknown on top."""
    cells = np.zeros((4, 4), dtype=np.int8)
    cells[:, 2:] = 100
    cells[3] = -1
    info = {"resolution": 0.5, "width": 4, "height": 4, "origin": pose(x_m, y_m)}
    return {"header": MAP, "info": info, "data": [int(cell) for cell in cells.ravel()]}


def disparity() -> Message:
    near = base64.b64encode(np.full((4, 8), 60.0, dtype="<f4").tobytes()).decode()
    image = {"width": 8, "height": 4, "encoding": "32FC1", "step": 32, "data": near}
    return {"header": MAP, "image": image, "min_disparity": 0.0, "max_disparity": 60.0}


def route(x_m: float, y_m: float) -> Message:
    stops = [{"pose": pose(x_m, y_m)}, {"pose": pose(x_m + 2.0, y_m)}]
    return {"header": MAP, "route_points": stops, "position_m": 0.5}


def path(x_m: float, y_m: float) -> Message:
    return {"header": MAP, "poses": [{"pose": pose(x_m, y_m)}, {"pose": pose(x_m + 2.0, y_m)}]}


ROLLED_RAD = math.pi / 6
IMU = {
    "header": {"frame_id": "imu"},
    "orientation": {
        "x": math.sin(ROLLED_RAD / 2),
        "y": 0.0,
        "z": 0.0,
        "w": math.cos(ROLLED_RAD / 2),
    },
}
ODOMETRY_COVARIANCE = [0.25 if i == 0 else 0.04 if i == 7 else 0.0 for i in range(36)]
CORNERS = {"attitude_indicator": "bottom right", "image": "top centre", "disparity": "top left"}

# Display type: the message, and the options that a program gives with it.
MESSAGES: dict[str, tuple[Message, Message]] = {
    "attitude_indicator": (IMU, {"anchor": "bottom right"}),
    "disparity": (disparity(), {"anchor": "top left", "offset_x": 80, "w": 80, "h": 40}),
    "float": ({"data": 3.14159}, {"anchor": "bottom left", "postfix": " m/s", "color": "#ff00ff"}),
    "gps": (fix(0.0, -7.0, track=90.0), {"style": "arrows", "color": "#c40000", "size": 10}),
    "grid": ({}, {"x": 4.0, "y": -9.0, "size": 0.5, "rows": 4, "columns": 4, "color": "#0000c4"}),
    "image": (
        {"format": "png", "data": png(GREEN)},
        {"anchor": "top centre", "w": 80, "h": 40},
    ),
    "laserscan": (scan(), {"by": "one colour", "color": "#00c8c8"}),
    "marker": (markers(), {}),
    "navsat": (fix(8.0, -7.0), {"style": "points", "color": "#008000"}),
    "occupancy_grid": (grid(12.0, -8.0), {}),
    "odometry": (
        {"header": MAP, "pose": {"pose": pose(18.0, -7.0), "covariance": ODOMETRY_COVARIANCE}},
        {"color": "#8b2fc9"},
    ),
    "path": (path(20.0, -7.0), {"color": "#123456"}),
    "pointcloud2": (cloud(0.0, -11.0), {"by": "rgb"}),
    "pose": (
        {"header": MAP, "pose": pose(4.0, -11.0, math.pi / 2)},
        {"style": "arrows", "size": 8, "color": "#ff8800"},
    ),
    "robot_image": (
        {"header": MAP, "pose": pose(8.0, -11.0, math.pi / 2)},
        {"image": f"data:image/png;base64,{png(BLUE)}", "w": 2.0},
    ),
    "route": (route(12.0, -11.0), {"color": "#224466", "icon": "#ff0000"}),
    "string": ({"data": "all is well"}, {"anchor": "bottom centre", "color": "#ffff00"}),
    "textured_marker": (
        {"header": MAP, "pose": pose(18.0, -11.0), "resolution": 0.5, "image": raw_image(RED)},
        {},
    ),
    "tf_frame": (
        {
            "header": MAP,
            "child_frame_id": "tool",
            "transform": {"translation": {"x": 22.0, "y": -11.0}, "rotation": turned(0.0)},
        },
        {},
    ),
}


def panels() -> list[Message]:
    return [
        {
            "id": f"layer-{kind}",
            "kind": "layer",
            "type": kind,
            "title": f"Test {kind}",
            "style": style,
            "refresh_s": 2.0,
        }
        for kind, (_, style) in MESSAGES.items()
    ] + [{"id": "listener-polygon", "kind": "listener", "title": "polygon", "what": "polygon"}]
