"""The lidar of a robot: from its sensor tag, or one of usual numbers that a setting adds."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import msgspec

from agribot.core.robot import Joint, LidarSpec, Link, Origin, RobotSpec
from agribot.description.elements import SourceFile
from agribot.description.tags import find_sensor, read_tag_value

LIDAR_TYPES = ("ray", "gpu_ray", "lidar", "gpu_lidar")
LINK = "laser_link"
HEIGHT_M = 0.3  # height over the ground, of a lidar that a setting adds
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
        raise source.fail(where, f"it sits on link '{link}', which does not exist")
    rays = next((e for e in (sensor.find("ray"), sensor.find("lidar")) if e is not None), sensor)

    def read(path: str, default: float, least: float, most: float) -> float:
        element = rays.find(path) if path != "update_rate" else sensor.find(path)
        if element is None:
            return default
        value = source.parse_number(read_tag_value(element), f"{where} <{path}>")
        if not least <= value <= most:
            raise source.fail(f"{where} <{path}>", f"{value:g} must be from {least:g} to {most:g}")
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
            f"{spec.range_min_m:g} to {spec.range_max_m:g} m: the first must be the smaller",
        )
    return spec


def fit_lidar(robot: RobotSpec) -> RobotSpec:
    """Return the robot with a lidar at its front, where its description has none.

    It turns all around, half a degree from ray to ray, ten times a second.
    """
    if robot.lidar is not None:
        return robot
    front_m = float(robot.wheel_xy_body_m()[:, 0].max()) + robot.drive.wheel_radius_m
    origin = Origin(xyz_m=(front_m, 0.0, HEIGHT_M - robot.base_height_m))
    name = LINK
    while any(link.name == name for link in robot.links):
        name += "_"
    joint = Joint(name=f"{name}_joint", kind="fixed", parent="base_link", child=name, origin=origin)
    return msgspec.structs.replace(
        robot,
        links=(*robot.links, Link(name=name)),
        joints=(*robot.joints, joint),
        lidar=LidarSpec(link=name, noise_std_m=0.01, max_angle_rad=math.pi - math.tau / 720),
    )
