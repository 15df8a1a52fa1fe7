"""The weed map as RViz and Foxglove markers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from agribot.core.messages import MappedPlant, PlantClass
from agribot.ros.messages import rosmsg

Rgba = tuple[float, float, float, float]

_SPHERE_LIST = 7
_ADD = 0
_DIAMETER_M = 0.08
_COLOURS: dict[str, Rgba] = {
    "weed": (0.85, 0.15, 0.12, 1.0),
    "treated": (0.45, 0.45, 0.45, 1.0),
    "crop": (0.20, 0.60, 0.25, 0.8),
}


def weed_markers(t_s: float, plants: Iterable[MappedPlant]) -> Any:
    """One list of spheres per kind; a list replaces its predecessor, so none goes stale."""
    points: dict[str, list[Any]] = {kind: [] for kind in _COLOURS}
    for plant in plants:
        points[_kind(plant)].append(rosmsg.point(plant.x_map_m, plant.y_map_m, 0.05))
    markers = [_sphere_list(t_s, index, kind, points[kind]) for index, kind in enumerate(_COLOURS)]
    return rosmsg.make("visualization_msgs/msg/MarkerArray", markers)


def _kind(plant: MappedPlant) -> str:
    if plant.plant == PlantClass.CROP:
        return "crop"
    return "weed" if plant.treated_s is None else "treated"


def _sphere_list(t_s: float, index: int, kind: str, points: list[Any]) -> Any:
    no_texture = rosmsg.make(
        "sensor_msgs/msg/CompressedImage", rosmsg.header(0.0, ""), "", np.zeros(0, np.uint8)
    )
    no_mesh = rosmsg.make("visualization_msgs/msg/MeshFile", "", np.zeros(0, np.uint8))
    return rosmsg.make(
        "visualization_msgs/msg/Marker",
        rosmsg.header(t_s, rosmsg.MAP_FRAME),
        kind,
        index,
        _SPHERE_LIST,
        _ADD,
        rosmsg.pose2(0.0, 0.0, 0.0),
        rosmsg.vector3(_DIAMETER_M, _DIAMETER_M, _DIAMETER_M),
        rosmsg.make("std_msgs/msg/ColorRGBA", *_COLOURS[kind]),
        rosmsg.make("builtin_interfaces/msg/Duration", 0, 0),
        False,
        points,
        [],
        "",
        no_texture,
        [],
        "",
        "",
        no_mesh,
        False,
    )
