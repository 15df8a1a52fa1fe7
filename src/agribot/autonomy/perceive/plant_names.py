"""One name for each plant, by what its stem says and by what its leaves look like.

A network names every pixel for itself, so that leaves of one plant may get two names, and a stem
another one than its leaves. A plant has one name: the odds of both witnesses are multiplied, those
of the stem to the power of how surely it stands there. On pictures unlike those that taught stems
the leaves decide.
"""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.doubt import find_doubt
from agribot.autonomy.perceive.leaf_owners import OwnedLeaves
from agribot.autonomy.perceive.stems import (
    CELL_PX,
    Owners,
    Stems,
    find_cell_owners,
    find_stems,
    share_kinds,
    sum_cells,
)
from agribot.core.messages import FloatArray, PlantClass

LEAST_SCORE = 0.25  # least score of a stem that counts, 0 to 1
LEAST_SHARE, MOST_SHARE = 0.02, 0.98  # no witness is surer


def name_plants(class_map: ClassMap) -> ClassMap:
    """Give stem and leaves of each plant the name of the plant.

    Leaves that point to no stem keep the name of their pixels. The confidence of a named pixel is
    the geometric mean of its own and of the plant's. A map without stems is returned as it is.
    """
    if class_map.plants is None:
        return class_map
    is_plant = class_map.class_id != PlantClass.SOIL
    stems = find_stems(class_map.plants, LEAST_SCORE)
    cells = find_cell_owners(class_map.plants, stems, sum_cells(is_plant))
    leaves = _find_leaves(cells, is_plant)
    shares = _share_names(class_map, stems, leaves)
    owned = OwnedLeaves(rename(stems, shares), cells)
    doubt = find_doubt(class_map.plants, owned, is_plant)
    named = msgspec.structs.replace(class_map, owned=owned, doubt=doubt)
    return _paint(named, leaves, shares)


class _Leaves(NamedTuple):
    """Pixels of vegetation that point to a stem: their index in the picture, and the stem's."""

    pixel: npt.NDArray[np.intp]
    stem: Owners


def _find_leaves(cells: Owners, is_plant: npt.NDArray[np.bool_]) -> _Leaves:
    owner = cells.repeat(CELL_PX, axis=0).repeat(CELL_PX, axis=1)
    pixel = np.flatnonzero(is_plant & (owner >= 0))
    return _Leaves(pixel, owner.ravel()[pixel])


def _share_names(class_map: ClassMap, stems: Stems, leaves: _Leaves) -> FloatArray:
    """Return how likely the plants (N, 2) of stems are weeds and crops; sums of 1."""
    of_stem = share_kinds(stems.kind_scores)
    sure = class_map.confidence.ravel()[leaves.pixel]
    is_crop = class_map.class_id.ravel()[leaves.pixel] == PlantClass.CROP
    crop = np.bincount(leaves.stem, np.where(is_crop, sure, 255 - sure), len(of_stem)) / 255.0
    count = np.bincount(leaves.stem, minlength=len(of_stem))
    crop = np.where(count > 0, crop / np.maximum(count, 1), of_stem[:, PlantClass.CROP])
    of_leaves = np.column_stack([1.0 - crop, crop])
    weight = stems.kind_scores.max(axis=1, keepdims=True)
    likely: FloatArray = of_stem.clip(LEAST_SHARE, MOST_SHARE) ** weight
    return share_kinds(likely * of_leaves.clip(LEAST_SHARE, MOST_SHARE))


def rename(stems: Stems, shares: FloatArray) -> Stems:
    """Let the scores of stems stand as the shares of their plants do; the higher one stays."""
    highest = stems.kind_scores.max(axis=1, keepdims=True)
    return stems._replace(kind_scores=highest * shares / shares.max(axis=1, keepdims=True))


def _paint(class_map: ClassMap, leaves: _Leaves, shares: FloatArray) -> ClassMap:
    """Write the names of plants into their leaves."""
    class_id, confidence = class_map.class_id.copy(), class_map.confidence.copy()
    class_id.ravel()[leaves.pixel] = shares.argmax(axis=1).astype(np.uint8)[leaves.stem]
    surest = shares.max(axis=1, initial=0.0)[:, None]
    means = np.round(np.sqrt(255.0 * surest * np.arange(256))).astype(np.uint8)
    confidence.ravel()[leaves.pixel] = means[leaves.stem, confidence.ravel()[leaves.pixel]]
    return msgspec.structs.replace(class_map, class_id=class_id, confidence=confidence)
