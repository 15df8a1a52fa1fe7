"""How little a network knows of the plants that it sees: none of them may be like its own."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.leaf_owners import OwnedLeaves
from agribot.autonomy.perceive.stems import PlantMaps, find_centres, share_kinds, sum_cells

LEAST_FOLIAGE_RATIO = 0.005  # least share of foliage in a picture that says enough


def find_doubt(
    maps: PlantMaps, owned: OwnedLeaves, is_plant: npt.NDArray[np.bool_]
) -> float | None:
    """Return 1 less the mean probability of foliage (h, w) to be of a plant with its name.

    A stem has the higher of its scores as the probability that it stands there, its plant the
    larger of its shares as that of its name. Foliage that points to no stem inside the picture has
    none; what points out of it does not count. None where there is too little of it.
    """
    height, width = is_plant.shape
    foliage_px = sum_cells(is_plant.astype(np.uint8))
    cells = np.argwhere(foliage_px)
    u_px, v_px = (find_centres(cells) + maps.way_px[:, cells[:, 0], cells[:, 1]].T).T
    is_out = (u_px < 0.0) | (u_px > width - 1.0) | (v_px < 0.0) | (v_px > height - 1.0)
    foliage_px[cells[is_out, 0], cells[is_out, 1]] = 0
    if foliage_px.sum() < LEAST_FOLIAGE_RATIO * is_plant.size:
        return None
    scores = owned.stems.kind_scores
    known = np.append(scores.max(axis=1) * share_kinds(scores).max(axis=1), 0.0)[owned.owners]
    return 1.0 - float((foliage_px * known).sum() / foliage_px.sum())
