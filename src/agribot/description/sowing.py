"""The plants of a world where a planter, the map's errors and chance have truly put them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray, PlantClass, Row
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.core.world import Plant
from agribot.description.conditions import Conditions, Preset, make_condition_stream

DOUBLE_GAP_M = (0.02, 0.06)  # distance of the plants of a double one, along the row
WEED_GAP_M = 0.04  # distance of a weed's stem from a crop's
TRIES = 20  # tries to find a weed a place off the crops
WEED_GROWTH = (0.7, 1.3)
SEEDS = 2**31


def sow(
    plants: Sequence[Plant], rows: Sequence[Row], preset: Preset, drawn: Conditions, seed: int
) -> tuple[Plant, ...]:
    """Put the crops about their true rows, and the weeds of the world somewhere else in it."""
    crops = [p for p in plants if p.plant == PlantClass.CROP]
    others = [p for p in plants if p.plant != PlantClass.CROP]
    if crops and rows:
        crops = _sow_crops(crops, rows, preset, drawn, seed)
    if others:
        others = _scatter(others, crops, make_condition_stream(seed, "weeds"))
    return (*crops, *others)


def _sow_crops(
    crops: Sequence[Plant], rows: Sequence[Row], preset: Preset, drawn: Conditions, seed: int
) -> list[Plant]:
    rng = make_condition_stream(seed, "sowing")
    hills = [_find_hill(plant, rows) for plant in crops]
    of_row = np.array([hill.row for hill in hills])
    along_m = np.array([hill.along_m for hill in hills])
    kept = rng.uniform(size=len(crops)) >= preset.missing_ratio
    kept &= ~np.isin(of_row, drawn.rows_missing)
    kept &= ~_find_gaps(of_row, along_m, preset, rng)
    if not kept.any():
        kept[0] = True  # a field without a single plant shows nothing
    errors_m = np.clip(rng.standard_normal((len(crops), 2)), -3.0, 3.0)
    errors_m *= (preset.sowing_along_std_m, preset.sowing_across_std_m)
    doubles = rng.uniform(size=len(crops)) < preset.double_ratio
    sown = []
    for plant, hill, error_m, is_kept, is_double in zip(
        crops, hills, errors_m.tolist(), kept, doubles, strict=True
    ):
        if not is_kept:
            continue
        sown.append(_sow_one(plant, hill, error_m, drawn, rng))
        if is_double:
            error_m[0] += float(rng.uniform(*DOUBLE_GAP_M))
            sown.append(_sow_one(plant, hill, error_m, drawn, rng))
    return sown


class _Hill(NamedTuple):
    """Place of a plant in the map: its row's index, the distance along, the row's yaw there."""

    row: int
    along_m: float
    yaw_rad: float


def _find_hill(plant: Plant, rows: Sequence[Row]) -> _Hill:
    places = [project_on_row(row, plant.x_map_m, plant.y_map_m) for row in rows]
    index = min(range(len(rows)), key=lambda k: abs(places[k].left_m))
    return _Hill(index, float(places[index].along_m), float(places[index].yaw_rad))


def _sow_one(
    plant: Plant, hill: _Hill, error_m: Sequence[float], drawn: Conditions,
    rng: np.random.Generator,
) -> Plant:  # fmt: skip
    """Put a plant off its place by an error along and across its row, and the map's own."""
    yaw_rad = hill.yaw_rad + math.radians(drawn.map_turn_deg)
    x_m, y_m = drawn.move_to_truth(plant.x_map_m, plant.y_map_m)
    ahead_m, left_m = error_m[0], error_m[1] + drawn.row_offsets_m[hill.row]
    return _regrow(
        plant,
        x_m + ahead_m * math.cos(yaw_rad) - left_m * math.sin(yaw_rad),
        y_m + ahead_m * math.sin(yaw_rad) + left_m * math.cos(yaw_rad),
        drawn.growth_ratio,
        rng,
    )


def _find_gaps(
    of_row: npt.NDArray[np.int64], along_m: FloatArray, preset: Preset, rng: np.random.Generator
) -> npt.NDArray[np.bool_]:
    """Return which crops (N,) a planter that stood still or ran empty has left out."""
    is_gap = np.zeros(len(along_m), dtype=bool)
    for index in np.unique(of_row):
        mine = of_row == index
        for _ in range(int(rng.poisson(preset.gaps_per_row))):
            start_m = rng.uniform(along_m[mine].min(), along_m[mine].max())
            length_m = rng.uniform(*preset.gap_length_m)
            is_gap |= mine & (along_m >= start_m) & (along_m <= start_m + length_m)
    return is_gap


def leave_out_crop(
    plants: Sequence[Plant], rows: Sequence[Row], length_m: float, rng: np.random.Generator
) -> list[Plant]:
    """Leave out `length_m` of crop in every row, from a random place inside it.

    A row that is too short loses half of its length.
    """
    gaps = []
    for row in rows:
        whole_m = row_length_m(row)
        gap_m = min(length_m, whole_m / 2.0)
        start_m = float(rng.uniform(0.1 * whole_m, 0.9 * whole_m - gap_m))
        gaps.append((start_m, start_m + gap_m))

    def is_kept(plant: Plant) -> bool:
        if plant.plant != PlantClass.CROP or not rows:
            return True
        hill = _find_hill(plant, rows)
        first_m, last_m = gaps[hill.row]
        return not first_m <= hill.along_m <= last_m

    return [plant for plant in plants if is_kept(plant)]


def _scatter(
    weeds: Sequence[Plant], crops: Sequence[Plant], rng: np.random.Generator
) -> list[Plant]:
    """Shift the pattern of the weeds around in its box, keeping their number and their patches."""
    xy_m = np.array([(p.x_map_m, p.y_map_m) for p in weeds])
    low, high = xy_m.min(axis=0), xy_m.max(axis=0)
    moved = low + (xy_m - low + rng.uniform(low, high)) % np.maximum(high - low, 1e-9)
    if crops:
        from scipy.spatial import cKDTree

        tree = cKDTree([(p.x_map_m, p.y_map_m) for p in crops])
        for _ in range(TRIES):
            near: npt.NDArray[np.bool_] = np.asarray(tree.query(moved)[0] < WEED_GAP_M)
            moved[near] = rng.uniform(low, high, (int(near.sum()), 2))
    return [
        _regrow(weed, x_m, y_m, float(rng.uniform(*WEED_GROWTH)), rng)
        for weed, (x_m, y_m) in zip(weeds, moved.tolist(), strict=True)
    ]


def _regrow(
    plant: Plant, x_map_m: float, y_map_m: float, growth_ratio: float, rng: np.random.Generator
) -> Plant:
    """Return another plant of the kind, elsewhere and of another size and shape."""
    return msgspec.structs.replace(
        plant,
        x_map_m=x_map_m,
        y_map_m=y_map_m,
        yaw_rad=float(rng.uniform(-math.pi, math.pi)),
        size_m=plant.size_m * growth_ratio,
        seed=int(rng.integers(SEEDS)),
    )
