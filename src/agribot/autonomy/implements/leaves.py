"""Sections over leaves of crop: off, but for those of plants whose stems are spared anyway."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.implements.beside_rows import NO_ROWS, REACH_M, RowsAround
from agribot.autonomy.implements.tool_frame import ToolPose, find_crops
from agribot.core.config import LeafRule
from agribot.core.implement.plants import Disc, GroundBox, KnownPlant, PlantMap
from agribot.core.pose import Pose2

# Reach of a plant's leaf tips over the radius of a disc of its area, and its maximum, m.
LEAVES_RATIO, MAX_LEAVES_M = 2.0, 0.45
# A leaf that points so near to a stem of the map is one of that plant.
STEM_VOTE_M = 0.07


def spare_leaves(
    is_on: tuple[bool, ...],
    section_y_m: tuple[float, ...],
    tool: ToolPose,
    half_x_m: float,
    half_y_m: float,
    plants: PlantMap,
    leaves: LeafRule = "alone",
    rows: RowsAround = NO_ROWS,
) -> tuple[bool, ...]:
    """Switch off every section whose box on the ground has leaves of crop in it.

    Boxes reach `half_x_m` along and `half_y_m` across around the middle of a section, `section_y_m`
    to the left of the tool point. By the rule `alone`, leaves of a plant that stands alone in the
    map do not count: its stem is spared by its place. By `mapped` and `rows`, those of every plant
    to whose stem in the map they point do not count either; by `any` no leaves count, by `none` all
    do. Those beside one of `rows`, where no heart of a crop can stand, never count; by most rules
    none are given.
    """
    if leaves == "any" or not any(is_on):
        return is_on
    map_from_tool = Pose2(*tool)
    reach_m = max(half_x_m + section_y_m[0] + half_y_m + MAX_LEAVES_M, REACH_M)
    ground = plants.crop_ground
    around = find_crops(plants, tool, reach_m)
    crops = [
        Disc(plant.x_map_m, plant.y_map_m, _leaf_reach_m(plant))
        for plant in around
        if plant.is_confirmed
    ]
    known = []
    if leaves != "none":
        known = [crop for crop in crops if _is_alone(crop, around) and ground.is_alone(crop)]
    by_stem = leaves in ("mapped", "rows")
    stems = [crop._replace(radius_m=STEM_VOTE_M) for crop in crops] if by_stem else []

    def is_dry(left_m: float) -> bool:
        place_m = map_from_tool.transform(0.0, left_m)
        is_beside = rows.is_beside(left_m, half_x_m, half_y_m)
        dry = [Disc(*place_m, 2.0 * (half_x_m + half_y_m))] if is_beside else known
        box = GroundBox(Pose2(*place_m, tool.yaw_map_rad), half_x_m, half_y_m)
        return ground.covers(box, dry, stems)

    return tuple(
        works and not is_dry(left_m) for works, left_m in zip(is_on, section_y_m, strict=True)
    )


def _is_alone(crop: Disc, around: Sequence[KnownPlant]) -> bool:
    """Whether no other crop of the map stands where the leaves of this one may reach."""
    near = (
        math.hypot(plant.x_map_m - crop.x_map_m, plant.y_map_m - crop.y_map_m) <= crop.radius_m
        for plant in around
    )
    return sum(near) <= 1


def _leaf_reach_m(plant: KnownPlant) -> float:
    """Return the reach of a mapped crop's leaves from its stem."""
    return min(LEAVES_RATIO * math.sqrt(plant.area_m2 / math.pi), MAX_LEAVES_M)
