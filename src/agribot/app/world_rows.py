"""Rows and world of a simulated run as one: the settings take those of the world, or fit them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from agribot.app.run_world import RunWorld
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig, RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import CropOffRows, NoCropInRows
from agribot.core.messages import FloatArray, Row
from agribot.core.platforms import find_platform
from agribot.core.robot import Shape
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.core.world import Obstacle, WorldSpec, is_person
from agribot.description.row_table import find_row_table, list_crop_m
from agribot.description.worlds_sdf import load_run_world

POST_RADIUS_M = 0.3  # largest radius of a post, which the map of a field holds
POST_HEIGHT_M = 1.5  # height from which a thing is passed under
AROUND_M = 4.0  # margin beyond the rows: as far as a robot turns
# Distance from every row, as a share of that of two rows, beyond which crop is not of them.
OFF_ROW_RATIO = 0.25
# Share of the crop that the robot passes; volunteer plants may stand anywhere.
MOST_OFF_RATIO = 0.05


def take_world_rows(config: RunConfig) -> RunConfig:
    """Return the settings with what `field.from_world` names taken from the world.

    A world without rows leaves those of the settings.
    Raises: DescriptionError: the world cannot be read.
    """
    names = config.field.from_world
    if not names:
        return config
    values: dict[str, Any] = {"from_world": ()}
    if find_platform(config.platform).is_simulated:
        found = _describe_field(load_run_world(config), config.field)
        values |= {name: found[name] for name in names if name in found}
    field = msgspec.structs.replace(config.field, **values)
    return msgspec.structs.replace(config, field=field)


def _describe_field(world: WorldSpec, field: FieldConfig) -> dict[str, Any]:
    """Return the settings of `field` that a world has."""
    table = find_row_table(world)
    rows = {} if table is None else msgspec.structs.asdict(table)
    laid = lay_rows(msgspec.structs.replace(field, **rows)) if rows else ()
    start_yaw_deg = math.degrees(world.spawn_yaw_map_rad)
    return {
        **rows,
        "obstacles_map_m": _find_posts(world.obstacles, laid),
        "start_map_m": tuple(round(value_m, 6) for value_m in world.spawn_xy_map_m),
        "start_yaw_deg": round(start_yaw_deg, 6),
        "datum": world.datum,
    }


def _find_posts(
    obstacles: Sequence[Obstacle], rows: Sequence[Row]
) -> tuple[tuple[float, float, float], ...]:
    """Find the posts and poles about the rows: East, North and radius of each."""
    ends = np.array([end for row in rows for end in (row.start_map_m, row.end_map_m)])
    if not len(ends):
        return ()
    low, high = ends.min(axis=0) - AROUND_M, ends.max(axis=0) + AROUND_M
    circles = (
        _circle(thing, shape)
        for thing in obstacles
        if thing.collides and not is_person(thing.kind)
        for shape in thing.shapes
    )
    near = [c for c in circles if c is not None and (low <= c[:2]).all() and (c[:2] <= high).all()]
    return tuple(dict.fromkeys(near))


def _circle(thing: Obstacle, shape: Shape) -> tuple[float, float, float] | None:
    """Return the circle of an upright slender shape near the ground, None of any other."""
    kind, size_m = shape.kind, shape.size_m
    radius_m = math.hypot(*size_m[:2]) / 2.0 if kind == "box" else size_m[0]
    height_m = {"box": size_m[2], "cylinder": size_m[1]}.get(kind, 2.0 * size_m[0])
    x_m, y_m, z_m = shape.origin.xyz_m
    is_upright = max(map(abs, shape.origin.rpy_rad[:2])) < 1e-3
    if kind == "mesh" or not is_upright or radius_m > POST_RADIUS_M:
        return None
    if thing.z_map_m + z_m - height_m / 2.0 > POST_HEIGHT_M:
        return None
    cos, sin = math.cos(thing.yaw_rad), math.sin(thing.yaw_rad)
    east_m, north_m = thing.x_map_m + cos * x_m - sin * y_m, thing.y_map_m + sin * x_m + cos * y_m
    return round(east_m, 3), round(north_m, 3), round(radius_m, 3)


def check_rows(made: RunWorld, config: RunConfig) -> None:
    """Check that crop stands in the rows of the settings, where these are what is driven.

    Raises: MissionError: it stands elsewhere, and what to give.
    """
    crop_xy_m = list_crop_m(made.world.plants)
    if config.plan or config.waypoints or config.task != "rows" or not len(crop_xy_m):
        return
    rows = [made.find_true_row(row) for row in lay_rows(config.field)]
    off_m = _measure_off_m(rows, crop_xy_m, config)
    limit_m = OFF_ROW_RATIO * config.field.row_pitch_m
    off, count = int(np.count_nonzero(off_m > limit_m)), len(off_m)
    if count and off <= MOST_OFF_RATIO * count:
        return
    has_rows = find_row_table(made.world) is not None
    if count:
        raise MissionError(CropOffRows(config.world, off, count, limit_m, has_rows))
    raise MissionError(NoCropInRows(config.world, len(crop_xy_m), has_rows))


def _measure_off_m(rows: Sequence[Row], crop_xy_m: FloatArray, config: RunConfig) -> FloatArray:
    """Measure how far the crop, (n, 2), that a robot on the rows passes is off the nearest row."""
    nearest_m = np.full(len(crop_xy_m), np.inf)
    for row in rows:
        along_m, left_m, _ = project_on_row(row, crop_xy_m[:, 0], crop_xy_m[:, 1])
        beyond_m = np.maximum(-along_m, along_m - row_length_m(row))
        is_beside = beyond_m < config.mission.headland_m
        nearest_m = np.where(is_beside, np.minimum(nearest_m, np.abs(left_m)), nearest_m)
    passed: FloatArray = nearest_m[nearest_m <= config.field.row_pitch_m / 2.0]
    return passed
