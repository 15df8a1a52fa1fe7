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


def make_weed_markers(t_s: float, plants: Iterable[MappedPlant]) -> Any:
    """Make one list of spheres per kind; a list replaces its predecessor, so none is stale."""
    points: dict[str, list[Any]] = {kind: [] for kind in _COLOURS}
    for plant in plants:
        points[_choose_kind(plant)].append(rosmsg.make_point(plant.x_map_m, plant.y_map_m, 0.05))
    markers = [
        _make_sphere_list(t_s, index, kind, points[kind]) for index, kind in enumerate(_COLOURS)
    ]
    return rosmsg.make_message("visualization_msgs/msg/MarkerArray", markers)


def _choose_kind(plant: MappedPlant) -> str:
    if plant.plant == PlantClass.CROP:
        return "crop"
    return "weed" if plant.treated_s is None else "treated"


def _make_sphere_list(t_s: float, index: int, kind: str, points: list[Any]) -> Any:
    no_texture = rosmsg.make_message(
        "sensor_msgs/msg/CompressedImage", rosmsg.make_header(0.0, ""), "", np.zeros(0, np.uint8)
    )
    no_mesh = rosmsg.make_message("visualization_msgs/msg/MeshFile", "", np.zeros(0, np.uint8))
    return rosmsg.make_message(
        "visualization_msgs/msg/Marker",
        rosmsg.make_header(t_s, rosmsg.MAP_FRAME),
        kind,
        index,
        _SPHERE_LIST,
        _ADD,
        rosmsg.make_pose(0.0, 0.0, 0.0),
        rosmsg.make_vector3(_DIAMETER_M, _DIAMETER_M, _DIAMETER_M),
        rosmsg.make_message("std_msgs/msg/ColorRGBA", *_COLOURS[kind]),
        rosmsg.make_message("builtin_interfaces/msg/Duration", 0, 0),
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
