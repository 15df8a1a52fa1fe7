"""What a camera shows of crop on the way over a strip of field, and the map made of it."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np

from agribot.autonomy.weeds.map import WeedMap
from agribot.autonomy.weeds.poses import PoseAt
from agribot.core.config import WeedConfig
from agribot.core.messages import CropCover, PlantClass, WeedScores
from tests.autonomy.weeds.weed_field import make_estimate, make_plant, make_scene

CELL_M, ROWS, COLUMNS = 0.025, 48, 64
CORNER_M = (0.3, -0.8)
IsCrop = Callable[[float, float], bool]
POSE = PoseAt(t_s=0.0, x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0, cov=(0.0,) * 9)


def closed_row(x_m: float, y_m: float) -> bool:
    """Leaves that touch, all along the row."""
    return abs(y_m) <= 0.12


def cover(
    pose: PoseAt, is_crop: IsCrop, stems: list[tuple[float, float]] | None = None
) -> CropCover:
    """What a camera over the pose sees of crop; each leaf points to the nearest of `stems`."""
    cos, sin = math.cos(pose.yaw_map_rad), math.sin(pose.yaw_map_rad)
    crop = np.zeros((ROWS, COLUMNS), dtype=bool)
    owners: list[int] = []
    for row, column in np.ndindex(ROWS, COLUMNS):
        x_m, y_m = CORNER_M[0] + (row + 0.5) * CELL_M, CORNER_M[1] + (column + 0.5) * CELL_M
        place_m = pose.x_map_m + cos * x_m - sin * y_m, pose.y_map_m + sin * x_m + cos * y_m
        crop[row, column] = is_crop(*place_m)
        if crop[row, column] and stems:
            gaps_m = [math.dist(place_m, stem_m) for stem_m in stems]
            owners += [1 + gaps_m.index(min(gaps_m))] * 2
    return CropCover(
        stems_body_m=tuple(pose.map_from_body.locate(*stem_m) for stem_m in stems or ()),
        owners=bytes(owners),
        x_body_m=CORNER_M[0], y_body_m=CORNER_M[1], cell_m=CELL_M, rows=ROWS, columns=COLUMNS,
        crop=np.packbits(crop).tobytes(), seen=np.packbits(np.ones_like(crop)).tobytes(),
    )  # fmt: skip


def score_weeds(pose: PoseAt, scores: dict[tuple[float, float], float]) -> WeedScores:
    """What a network over the pose suspects: how sure it is of a stem at each of some places."""
    cells = np.ones((ROWS, COLUMNS), dtype=np.uint8)
    for place_m, score in scores.items():
        x_m, y_m = pose.map_from_body.locate(*place_m)
        row, column = int((x_m - CORNER_M[0]) / CELL_M), int((y_m - CORNER_M[1]) / CELL_M)
        if 0 <= row < ROWS and 0 <= column < COLUMNS:
            cells[row, column] = max(1, round(255 * score))
    return WeedScores(
        x_body_m=CORNER_M[0], y_body_m=CORNER_M[1], cell_m=CELL_M, rows=ROWS, columns=COLUMNS,
        scores=cells.tobytes(),
    )  # fmt: skip


def seen_on_the_way(
    weeds: list[tuple[float, float]],
    is_crop: IsCrop,
    crops: list[tuple[float, float]] | None = None,
    *,
    unknown: bool = False,
    points: bool = False,
    stems: list[tuple[float, float]] | None = None,
    suspected: dict[tuple[float, float], float] | None = None,
) -> WeedMap:
    """The map after a drive of 2.5 m along x that saw weeds, leaves, and these crop plants.

    The leaves are `unknown` ones that no stem explains, or each `points` to the nearest crop, or to
    the nearest of `stems`. Weeds are `suspected` with these scores.
    """
    weed_map = WeedMap(WeedConfig())
    for step in range(25):
        t_s, x_m = 0.25 * step, 0.1 * step
        weed_map.track_pose(make_estimate(t_s, x_m, 0.0, 0.0))
        plants = tuple(
            make_plant(x - x_m, y, PlantClass.WEED, std_m=0.01)
            for x, y in weeds
            if 0.3 < x - x_m < 1.5
        ) + tuple(
            msgspec.structs.replace(make_plant(x - x_m, y, PlantClass.CROP), area_m2=0.03)
            for x, y in crops or ()
            if 0.3 < x - x_m < 1.5
        )
        pose = msgspec.structs.replace(POSE, x_map_m=x_m)
        scene = make_scene(t_s, plants, view=())
        seen = cover(pose, is_crop, crops if points else stems)
        if unknown:
            seen = msgspec.structs.replace(seen, crop=bytes(len(seen.crop)), unknown=seen.crop)
        weed_scores = score_weeds(pose, suspected or {})
        weed_map.add(msgspec.structs.replace(scene, crop_cover=seen, weed_scores=weed_scores))
    return weed_map
