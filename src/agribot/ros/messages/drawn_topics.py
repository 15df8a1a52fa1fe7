"""What people show on the map of the page, as ROS messages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from agribot.core import topics
from agribot.core.messages import DrawShape, GoTo, PointOut, RequestEvent
from agribot.core.topics import Topic
from agribot.ros.messages.rosmsg import MAP_FRAME, make_header, make_message, make_point, make_pose

MapPoints = Sequence[tuple[float, float]]


def list_drawn(events: Iterable[RequestEvent], t_s: float) -> Iterator[tuple[Topic, Any]]:
    """List the messages of what was pointed at, drawn and asked for as a goal."""
    for event in events:
        match event.request:
            case GoTo() as goal if _are_finite([goal.place]):
                at_map_m = goal.x_map_m, goal.y_map_m
                yield topics.GOAL_POSE, make_goal(t_s, at_map_m, goal.yaw_map_rad or 0.0)
            case PointOut(x_map_m=x_m, y_map_m=y_m) if _are_finite([(x_m, y_m)]):
                yield topics.CLICKED_POINT, make_clicked_point(t_s, (x_m, y_m))
            case DrawShape(shape=shape, corners_map_m=corners) if _are_finite(corners):
                is_polygon = shape == "polygon"
                topic = topics.DRAWN_POLYGON if is_polygon else topics.DRAWN_ROUTE
                yield topic, (make_polygon if is_polygon else make_route)(t_s, corners)


def _are_finite(places: Sequence[Sequence[float]]) -> bool:
    return bool(places) and all(math.isfinite(sum(place)) for place in places)


def make_goal(t_s: float, at_map_m: tuple[float, float], yaw_rad: float) -> Any:
    header = make_header(t_s, MAP_FRAME)
    return make_message("geometry_msgs/msg/PoseStamped", header, make_pose(*at_map_m, yaw_rad))


def make_clicked_point(t_s: float, at_map_m: tuple[float, float]) -> Any:
    header = make_header(t_s, MAP_FRAME)
    return make_message("geometry_msgs/msg/PointStamped", header, make_point(*at_map_m))


def make_polygon(t_s: float, corners_map_m: MapPoints) -> Any:
    corners = [make_message("geometry_msgs/msg/Point32", x, y, 0.0) for x, y in corners_map_m]
    polygon = make_message("geometry_msgs/msg/Polygon", corners)
    header = make_header(t_s, MAP_FRAME)
    return make_message("geometry_msgs/msg/PolygonStamped", header, polygon)


def make_route(t_s: float, places_map_m: MapPoints) -> Any:
    """Make a Path whose poses look to the next place, the last one as the one before it."""
    header = make_header(t_s, MAP_FRAME)
    poses = []
    yaw_rad = 0.0
    for i, (x_m, y_m) in enumerate(places_map_m):
        if i + 1 < len(places_map_m):
            next_x_m, next_y_m = places_map_m[i + 1]
            yaw_rad = math.atan2(next_y_m - y_m, next_x_m - x_m)
        pose = make_pose(x_m, y_m, yaw_rad)
        poses.append(make_message("geometry_msgs/msg/PoseStamped", header, pose))
    return make_message("nav_msgs/msg/Path", header, poses)
