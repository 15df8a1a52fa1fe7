"""What of the robot passes how low over the ground: its belly, seen from below."""

from __future__ import annotations

import logging
import re
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray
from agribot.core.robot import Link, RobotSpec, Shape
from agribot.sim.rigid_body import BASE, find_carrier
from agribot.sim.stl import find_mesh_file, read_stl

CELL_M = 0.02
SPACING_M = 0.01  # distance of the points on a shape's surface
MOST_POINTS = 400  # points along an edge: a shape larger than 4 m is sampled more coarsely
ROLLING_M = 0.01  # lower than this, a part rolls or slides on the ground: a caster, a sixth wheel
IMPLEMENT = re.compile("implement|boom|nozzle|spray|hoe|blade|tool|cultivator", re.IGNORECASE)
_LOG = logging.getLogger(__name__)


class Part(IntEnum):
    """Part of the robot that touches a plant; in reports by its name in lower case."""

    WHEEL = 1
    BELLY = 2
    IMPLEMENT = 3


PART_WORDS: dict[int, str] = {
    Part.WHEEL: "a wheel",
    Part.BELLY: "the belly",
    Part.IMPLEMENT: "the implement",
}


class Underside(NamedTuple):
    """Cells of the body frame, x then y: height of the lowest part over the ground, and which.

    `clearance_m` is infinite where nothing is. The first cell begins at `x_min_m`, `y_min_m`.
    """

    clearance_m: FloatArray
    part: npt.NDArray[np.uint8]
    x_min_m: float
    y_min_m: float
    cell_m: float


def build_underside(robot: RobotSpec) -> Underside:
    """Build the underside of a robot from the collision shapes of all links but its wheels."""
    found = [(link, _list_points_m(robot, link)) for link in robot.links if link.collisions]
    found = [(link, points) for link, points in found if len(points)]
    if not found:
        none = np.full((1, 1), np.inf)
        return Underside(none, np.zeros((1, 1), np.uint8), 0.0, 0.0, CELL_M)
    everything = np.concatenate([points for _link, points in found])
    low = everything[:, :2].min(axis=0)
    size = ((everything[:, :2].max(axis=0) - low) / CELL_M).astype(int) + 1
    clearance_m, part = np.full(tuple(size), np.inf), np.zeros(tuple(size), np.uint8)
    for link, points in found:
        own_m = np.full(tuple(size), np.inf)
        i, j = ((points[:, :2] - low) / CELL_M).astype(int).T
        np.minimum.at(own_m, (i, j), points[:, 2])
        is_lower = own_m < clearance_m
        clearance_m[is_lower] = own_m[is_lower]
        part[is_lower] = _name_part(link, float(points[:, 2].min()))
    return Underside(clearance_m, part, float(low[0]), float(low[1]), CELL_M)


def _name_part(link: Link, lowest_m: float) -> Part:
    if lowest_m < ROLLING_M:
        return Part.WHEEL
    return Part.IMPLEMENT if IMPLEMENT.search(link.name) else Part.BELLY


def _list_points_m(robot: RobotSpec, link: Link) -> FloatArray:
    """List points on the collision shapes of a link, (n, 3) in the body frame."""
    if find_carrier(robot, link.name) != BASE:
        return np.empty((0, 3))
    body_from_link = robot.body_from_link(link.name)
    parts = [np.empty((0, 3))]
    for shape in link.collisions:
        pose = body_from_link @ shape.origin.matrix()
        parts.append(_sample_surface_m(shape, link.name) @ pose[:3, :3].T + pose[:3, 3])
    return np.concatenate(parts)


def _sample_surface_m(shape: Shape, owner: str) -> FloatArray:
    """Sample the surface of a shape in its own axes, (n, 3); a mesh as the box around it."""
    x, y, _ = shape.size_m
    if shape.kind == "box":
        half_m = np.array(shape.size_m) / 2.0
        return _sample_box_m(-half_m, half_m)
    if shape.kind == "cylinder":
        around = np.linspace(0.0, 2.0 * np.pi, _count_points(2.0 * np.pi * x))
        ring = np.column_stack([np.cos(around), np.sin(around)]) * x
        along = np.linspace(-y / 2.0, y / 2.0, _count_points(y))
        wall = [np.column_stack([ring, np.full(len(ring), z)]) for z in along.tolist()]
        inner = np.linspace(0.0, 1.0, _count_points(x))[:, None, None]
        lid = (ring * inner).reshape(-1, 2)
        lids = [np.column_stack([lid, np.full(len(lid), z)]) for z in (-y / 2.0, y / 2.0)]
        return np.concatenate([*wall, *lids])
    if shape.kind == "sphere":
        around = np.linspace(0.0, 2.0 * np.pi, _count_points(2.0 * np.pi * x))
        turn, rise = np.meshgrid(around, np.linspace(0.0, np.pi, len(around)))
        ball = [np.cos(turn) * np.sin(rise), np.sin(turn) * np.sin(rise), np.cos(rise)]
        return np.stack(ball, axis=-1).reshape(-1, 3) * x
    return _sample_mesh_m(shape, owner)


def _sample_mesh_m(shape: Shape, owner: str) -> FloatArray:
    try:
        corners = read_stl(find_mesh_file(shape.mesh)).reshape(-1, 3) * np.array(shape.size_m)
    except DescriptionError as error:
        _LOG.warning("plants are not touched by this part of '%s': %s", owner, error)
        return np.empty((0, 3))
    return _sample_box_m(corners.min(axis=0), corners.max(axis=0))


def _sample_box_m(low: FloatArray, high: FloatArray) -> FloatArray:
    """Sample the six faces of a box, (n, 3)."""
    lines = [np.linspace(a, b, _count_points(b - a)) for a, b in zip(low, high, strict=True)]
    faces = []
    for axis in range(3):
        for end in (low[axis], high[axis]):
            sides = [np.array([end]) if k == axis else line for k, line in enumerate(lines)]
            faces.append(np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 3))
    return np.concatenate(faces)


def _count_points(length_m: float) -> int:
    return min(MOST_POINTS, int(np.ceil(length_m / SPACING_M)) + 2)
