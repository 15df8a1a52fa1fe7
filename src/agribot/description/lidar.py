"""The lidar of a robot: from its sensor tag, or one of usual numbers that a setting adds."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.robot import Joint, LidarSpec, Link, Origin, RobotSpec, Shape
from agribot.description.elements import SourceFile
from agribot.description.tags import find_sensor, read_tag_value

LIDAR_TYPES = ("ray", "gpu_ray", "lidar", "gpu_lidar")
LINK = "laser_link"
# Height over the ground of a lidar that a setting adds, m: over crop of 25 cm, and through the
# bodies of a dog of 0.55 m at its back and of a person who kneels.
HEIGHT_M = 0.45
STEP_RAD = math.radians(0.5)  # angle from ray to ray of a lidar that a setting adds
MOST_SAMPLES = 4000
MOST_RATE_HZ = 100.0


def read_lidar(root: ET.Element, links: Sequence[Link], source: SourceFile) -> LidarSpec | None:
    """Read the first lidar of a description as a planar one, or None.

    Raises: DescriptionError: a number that no scan can have, or a link that does not exist.
    """
    found = find_sensor(root, LIDAR_TYPES)
    if found is None:
        return None
    link, sensor = found
    where = f"sensor '{sensor.get('name', '')}'"
    if link not in {known.name for known in links}:
        raise source.fail(where, f"it sits on link '{link}', which is missing; add the link")
    rays = next((e for e in (sensor.find("ray"), sensor.find("lidar")) if e is not None), sensor)

    def read(path: str, default: float, least: float, most: float) -> float:
        element = rays.find(path) if path != "update_rate" else sensor.find(path)
        if element is None:
            return default
        value = source.parse_number(read_tag_value(element), f"{where} <{path}>")
        source.check_within(f"{where} <{path}>", value, least, most)
        return value

    if read("scan/vertical/samples", 1.0, 0.0, 1e6) > 1.0:
        source.warn(f"{where}: of its layers one is simulated, that of its own plane", sensor)
    default = LidarSpec(link=link)
    spec = LidarSpec(
        link=link,
        rate_hz=read("update_rate", default.rate_hz, 0.1, MOST_RATE_HZ),
        samples=round(read("scan/horizontal/samples", default.samples, 1.0, MOST_SAMPLES)),
        min_angle_rad=read("scan/horizontal/min_angle", default.min_angle_rad, -7.0, 7.0),
        max_angle_rad=read("scan/horizontal/max_angle", default.max_angle_rad, -7.0, 7.0),
        range_min_m=read("range/min", default.range_min_m, 0.0, 1e3),
        range_max_m=read("range/max", default.range_max_m, 0.0, 1e3),
        noise_std_m=read("noise/stddev", 0.0, 0.0, 10.0),
    )
    if spec.min_angle_rad > spec.max_angle_rad or spec.range_min_m >= spec.range_max_m:
        raise source.fail(
            where,
            f"angles from {spec.min_angle_rad:g} to {spec.max_angle_rad:g} rad and ranges from "
            f"{spec.range_min_m:g} to {spec.range_max_m:g} m; write the smaller first",
        )
    return spec


def fit_lidar(robot: RobotSpec) -> RobotSpec:
    """Return the robot with a lidar at its front, where its description has none.

    It looks all around, but for where the robot itself is in its way, half a degree from ray to
    ray, ten times a second.
    """
    if robot.lidar is not None:
        return robot
    front_m = float(robot.wheel_xy_body_m()[:, 0].max()) + robot.drive.wheel_radius_m
    origin = Origin(xyz_m=(front_m, 0.0, HEIGHT_M - robot.base_height_m))
    half_view_rad = _find_half_view_rad(robot, front_m)
    name = LINK
    while any(link.name == name for link in robot.links):
        name += "_"
    joint = Joint(name=f"{name}_joint", kind="fixed", parent="base_link", child=name, origin=origin)
    return msgspec.structs.replace(
        robot,
        links=(*robot.links, Link(name=name)),
        joints=(*robot.joints, joint),
        lidar=LidarSpec(
            link=name,
            samples=round(2.0 * half_view_rad / STEP_RAD) + 1,
            min_angle_rad=-half_view_rad,
            max_angle_rad=half_view_rad,
            noise_std_m=0.01,
        ),
    )


def _find_half_view_rad(robot: RobotSpec, x_m: float) -> float:
    """Find the angle to either side that is free of the robot's own parts in the lidar's plane."""
    free_rad = math.pi - STEP_RAD / 2.0
    for link in robot.links:
        for shape in link.collisions:
            low_m, high_m = _find_bounds_m(robot.body_from_link(link.name), shape)
            if low_m[2] < HEIGHT_M < high_m[2]:
                corners = [(x, y) for x in (low_m[0], high_m[0]) for y in (low_m[1], high_m[1])]
                free_rad = min(free_rad, *(abs(math.atan2(y, x - x_m)) for x, y in corners))
    return math.floor(free_rad / STEP_RAD) * STEP_RAD


def _find_bounds_m(body_from_link: FloatArray, shape: Shape) -> tuple[list[float], list[float]]:
    """Find the box around a shape, in the body frame; a mesh is taken as a point."""
    pose = body_from_link @ shape.origin.matrix()
    a_m, b_m, c_m = shape.size_m
    half_m = {
        "box": (a_m / 2.0, b_m / 2.0, c_m / 2.0),
        "cylinder": (a_m, a_m, b_m / 2.0),
        "sphere": (a_m, a_m, a_m),
    }.get(shape.kind, (0.0, 0.0, 0.0))  # fmt: skip
    reach_m = np.abs(pose[:3, :3]) @ np.array(half_m)
    return (pose[:3, 3] - reach_m).tolist(), (pose[:3, 3] + reach_m).tolist()
