"""Which stem the leaves of a picture point to, by a plant network."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from agribot.autonomy.perceive.crop_cover import NO_LEAF, NO_STEM, OUTSIDE, Mask, StemLeaves
from agribot.autonomy.perceive.stems import (
    CELL_PX,
    Owners,
    PlantMaps,
    Stems,
    find_centres,
    sum_cells,
)
from agribot.core.messages import FloatArray, PlantClass


class OwnedLeaves(NamedTuple):
    """Stems of a picture, and the index of the stem of each cell (h/4, w/4), -1 without one."""

    stems: Stems
    owners: Owners


def find_crop_leaves(
    maps: PlantMaps, owned: OwnedLeaves, is_plant: Mask, places_m: FloatArray
) -> StemLeaves:
    """Find for each pixel of vegetation (h, w) the stem of crop that it points to.

    `places_m` (N, 2) are the stems' places in the body frame, NaN where unknown. What points out of
    the picture belongs to a plant that another picture shows; what points to no stem inside it may
    be undetected crop.
    """
    is_crop = owned.stems.kind_scores.argmax(axis=1) == PlantClass.CROP
    by_stem = np.where(is_crop, np.arange(len(is_crop)), NO_LEAF)
    cells = np.append(by_stem, NO_STEM)[owned.owners].astype(np.int32)
    rows, columns = owned.owners.shape
    stray = np.argwhere((owned.owners < 0) & sum_cells(is_plant))
    u_px, v_px = (find_centres(stray) + maps.way_px[:, stray[:, 0], stray[:, 1]].T).T
    is_inside = (u_px >= 0.0) & (u_px <= columns * CELL_PX - 1.0)
    is_inside &= (v_px >= 0.0) & (v_px <= rows * CELL_PX - 1.0)
    cells[stray[:, 0], stray[:, 1]] = np.where(is_inside, NO_STEM, OUTSIDE)
    owner = cells.repeat(CELL_PX, axis=0).repeat(CELL_PX, axis=1)
    owner[~is_plant] = NO_LEAF
    return StemLeaves(owner, places_m)
