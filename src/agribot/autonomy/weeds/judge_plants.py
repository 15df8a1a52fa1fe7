"""What was decided about each plant of a weed map, and what came of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.autonomy.weeds.near_pairs import find_near_pairs
from agribot.autonomy.weeds.plant_table import (
    DECISIONS,
    OUTCOMES,
    PlantTable,
    is_crop,
)
from agribot.core.implement.plants import REASONS

LATER_LOOK_S = 30.0  # a weed seen later than this after its treatment was seen on another pass
_TREAT, _SPARE = DECISIONS.index("treat"), DECISIONS.index("spare")
_TREATED, _MISSED, _SEEN_AGAIN = (OUTCOMES.index(o) for o in ("treated", "missed", "seen again"))


def judge_plants(
    table: PlantTable,
    guard_m: float,
    *,
    is_treating: bool = True,
    is_off: npt.NDArray[np.bool_] | None = None,
) -> PlantTable:
    """Fill decision and outcome of one run's map in.

    Crop is spared, and so is a weed whose middle is within `guard_m` of a crop's, which the
    implement leaves alone, and one that `is_off` (N,), where a prescription allows no treatment;
    all other weeds are to be treated. Weeds that were left keep their reasons. Where the implement
    was off (`is_treating`), nothing was decided about weeds that were not treated all the same.
    """
    rows = table.rows.copy()
    crop = is_crop(rows)
    was_treated = ~crop & np.isfinite(rows["treated_s"])
    is_spared = crop | _find_beside_crop(table, guard_m)
    if is_off is not None:
        is_spared |= is_off
    rows["decision"] = np.where(is_spared, _SPARE, _TREAT if is_treating else 0)
    rows["decision"][was_treated] = _TREAT
    if is_off is not None:
        rows["reason"][is_off] = REASONS.index("outside the prescription")
    rows["reason"][crop | was_treated] = 0
    rows["outcome"] = np.where(rows["decision"] == _TREAT, _MISSED, 0)
    rows["outcome"][was_treated] = _TREATED
    with np.errstate(invalid="ignore"):
        is_back = was_treated & (rows["last_seen_s"] > rows["treated_s"] + LATER_LOOK_S)
    rows["outcome"][is_back] = _SEEN_AGAIN
    return table._replace(rows=rows)


def _find_beside_crop(table: PlantTable, guard_m: float) -> npt.NDArray[np.bool_]:
    """Find the plants (N,) within the guard of some crop of the map."""
    crop = is_crop(table.rows)
    beside = np.zeros(len(crop), dtype=bool)
    for one, other in (pair := find_near_pairs(table.xy_m, guard_m), pair[::-1]):
        beside[one[crop[other]]] = True
    return beside
