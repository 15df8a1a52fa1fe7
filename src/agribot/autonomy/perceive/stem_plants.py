"""Plants on the ground, from the stems that a plant network finds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.crop_cover import Mask, StemLeaves
from agribot.autonomy.perceive.foliage import find_nearer_ratio
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.leaf_owners import OwnedLeaves, find_crop_leaves
from agribot.autonomy.perceive.plant_names import name_plants
from agribot.autonomy.perceive.stems import PlantMaps, Stems, share_kinds, sum_cells
from agribot.core.config import PerceptionConfig
from agribot.core.errors import PerceptionError
from agribot.core.messages import FloatArray, GroundPlant, PlantClass

# Two stems of one class nearer than the first, in radii of a plant with the leaves of both, are one
# plant found twice; the second is added by the share that the one is less sure than the other.
DOUBLE_RATIO, DOUBT_RATIO = 0.35, 0.7
STEM_STD_M = 0.006
# The body nods and rolls over the ground; a ray that is tilted meets the ground elsewhere.
TILT_STD_RAD = math.radians(0.5)


class _Candidates(NamedTuple):
    """Stems on the ground, the surest first.

    `places_m` (N, 2) are x and y in the body frame, `areas_m2` (N,) the ground that their leaves
    cover in the picture, `footprints_m` (N,) the longer side of their pixel on the ground.
    """

    places_m: FloatArray
    kind_scores: FloatArray
    areas_m2: FloatArray
    footprints_m: FloatArray


class SeenStems(NamedTuple):
    """The stems of a picture with their leaves; `is_plant` (h, w) are the pixels of vegetation."""

    maps: PlantMaps
    owned: OwnedLeaves
    is_plant: Mask


def see_stems(class_map: ClassMap, ground: GroundLookup) -> SeenStems:
    """Find the stems of a class map and the vegetation that points to each.

    Raises: PerceptionError: the map has no stems, or is not of the size of the ground lookup.
    """
    if class_map.plants is None:
        raise PerceptionError("the network of this class map finds no plants; give one that does")
    class_map.check_shape(ground.map_shape)
    is_plant = (class_map.class_id != PlantClass.SOIL) & (ground.area_m2 > 0.0)
    owned = class_map.owned or name_plants(class_map).owned
    assert owned is not None  # a map with stems was named
    return SeenStems(class_map.plants, owned, is_plant)


def find_leaves(seen: SeenStems, ground: GroundLookup) -> StemLeaves:
    """Find which vegetation points to which stem of crop on the ground."""
    uv_px = seen.owned.stems.uv_px
    height, width = ground.map_shape
    places_m = _interpolate(uv_px, ground)
    is_outside = (uv_px < -0.5) | (uv_px > np.array([width - 0.5, height - 0.5]))
    places_m[is_outside.any(axis=1)] = np.nan
    return find_crop_leaves(seen.maps, seen.owned, seen.is_plant, places_m)


def find_stem_plants(
    class_map: ClassMap,
    ground: GroundLookup,
    config: PerceptionConfig,
    seen: SeenStems | None = None,
) -> list[GroundPlant]:
    """Find the plants within range whose stem the image shows, the surest stem first.

    A stem stands on the ground: its pixel is its place. The class is that of the plant (see
    plant_names); one with less confidence than `config.min_confidence` is neither weed nor crop,
    and left out. Leaves of a plant whose stem is outside the image belong to no plant.

    Raises: PerceptionError: the map has no stems, or is not of the size of the ground lookup.
    """
    _, (stems, owners), is_plant = seen or see_stems(class_map, ground)
    cells_m2 = sum_cells(np.where(is_plant, ground.area_m2, np.float32(0.0)))
    is_owned = owners >= 0
    areas_m2 = np.bincount(owners[is_owned], cells_m2[is_owned], len(stems.uv_px))
    joined = _join_doubles(_place(stems, areas_m2.astype(np.float64), ground))
    gaps_m = joined.places_m - ground.camera_xyz_body_m[:2]
    ranges_m = np.hypot(gaps_m[:, 0], gaps_m[:, 1])
    is_kept = (joined.areas_m2 >= config.min_plant_area_m2) & (ranges_m <= ground.max_range_m)
    is_kept &= share_kinds(joined.kind_scores).max(axis=1) >= config.min_confidence
    return [
        _describe(joined, index, float(ranges_m[index]), float(ground.camera_xyz_body_m[2]))
        for index in np.flatnonzero(is_kept).tolist()
    ]


def _place(stems: Stems, areas_m2: FloatArray, ground: GroundLookup) -> _Candidates:
    """Place the stems on the ground: those with leaves, inside the picture, below the horizon."""
    height, width = ground.map_shape
    u_px, v_px = stems.uv_px.T
    column, row = np.rint(u_px).astype(np.int64), np.rint(v_px).astype(np.int64)
    is_inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    footprints_m = np.zeros(len(u_px))
    footprints_m[is_inside] = ground.footprint_m[row[is_inside], column[is_inside]]
    places_m = np.full((len(u_px), 2), np.nan)
    places_m[is_inside] = _interpolate(stems.uv_px[is_inside], ground)
    is_kept = np.isfinite(places_m[:, 0]) & np.isfinite(footprints_m) & (areas_m2 > 0.0)
    return _Candidates(
        places_m[is_kept], stems.kind_scores[is_kept], areas_m2[is_kept], footprints_m[is_kept]
    )


def _interpolate(uv_px: FloatArray, ground: GroundLookup) -> FloatArray:
    """Return where pixels (N, 2) meet the ground, x and y (N, 2); NaN beside the horizon."""
    height, width = ground.map_shape
    left = np.clip(np.floor(uv_px[:, 0]), 0, width - 2).astype(np.int64)
    top = np.clip(np.floor(uv_px[:, 1]), 0, height - 2).astype(np.int64)
    right, down = uv_px[:, 0] - left, uv_px[:, 1] - top
    places = []
    for axis_m in (ground.x_body_m, ground.y_body_m):
        upper = (1.0 - right) * axis_m[top, left] + right * axis_m[top, left + 1]
        lower = (1.0 - right) * axis_m[top + 1, left] + right * axis_m[top + 1, left + 1]
        places.append((1.0 - down) * upper + down * lower)
    return np.column_stack(places)


def _join_doubles(found: _Candidates) -> _Candidates:
    """Join stems of one class that stand too close for the plant that they share.

    The surer one stays, with the leaves of both.
    """
    is_crop = found.kind_scores.argmax(axis=1) == PlantClass.CROP
    radii_m = np.sqrt((found.areas_m2[:, None] + found.areas_m2[None]) / math.pi)
    gaps_m = np.hypot(*(found.places_m[:, None] - found.places_m[None]).transpose(2, 0, 1))
    score = found.kind_scores.max(axis=1)
    doubt = 1.0 - score[:, None] / score[None]  # doubt of each stem of a row against each surer one
    is_near = gaps_m < (DOUBLE_RATIO + DOUBT_RATIO * doubt) * radii_m
    is_near &= is_crop[:, None] == is_crop[None]
    areas_m2 = found.areas_m2.copy()
    is_kept = np.ones(len(areas_m2), dtype=bool)
    for index in np.flatnonzero(np.tril(is_near, -1).any(axis=1)).tolist():
        surer = np.flatnonzero(is_near[index, :index] & is_kept[:index])
        if len(surer):
            nearest = surer[gaps_m[index, surer].argmin()]
            areas_m2[nearest] += areas_m2[index]
            is_kept[index] = False
    return _Candidates(
        found.places_m[is_kept],
        found.kind_scores[is_kept],
        areas_m2[is_kept],
        found.footprints_m[is_kept],
    )


def _describe(
    found: _Candidates, index: int, range_m: float, camera_height_m: float
) -> GroundPlant:
    """Make the plant of a stem at this distance from the point below the camera."""
    x_m, y_m = found.places_m[index].tolist()
    weed, crop = share_kinds(found.kind_scores[index]).tolist()
    plant = PlantClass.CROP if crop > weed else PlantClass.WEED
    area_m2 = float(found.areas_m2[index])
    nearer = find_nearer_ratio(plant, area_m2, camera_height_m)
    tilt_std_m = (camera_height_m**2 + range_m**2) / camera_height_m * TILT_STD_RAD
    return GroundPlant(
        x_body_m=x_m,
        y_body_m=y_m,
        plant=plant,
        area_m2=area_m2 * nearer**2,
        confidence=max(weed, crop),
        std_m=math.hypot(STEM_STD_M, float(found.footprints_m[index]) / 2.0, tilt_std_m),
        seen_height_m=0.0,
    )
