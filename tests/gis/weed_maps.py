"""Made-up weed maps for the tests of their files."""

from __future__ import annotations

import numpy as np

from agribot.autonomy.weeds.judge_plants import judge_plants
from agribot.autonomy.weeds.plant_table import ROW, PlantTable, round_rows
from agribot.core.geo import Datum
from agribot.core.messages import FloatArray

DATUM = Datum(lat_deg=52.1, lon_deg=11.6)
GUARD_M = 0.07


def scatter(count: int, seed: int = 0, side_m: float = 40.0) -> FloatArray:
    """Places of plants, at least 0.3 m apart, (count, 2)."""
    cells = int(side_m / 0.6)
    chosen = np.random.default_rng(seed).choice(cells * cells, count, replace=False)
    middle = np.column_stack(np.divmod(chosen, cells)) * 0.6
    return middle + np.random.default_rng(seed + 1).uniform(-0.15, 0.15, (count, 2))


def make_map(
    places_m: FloatArray, name: str = "a run", *, std_m: float = 0.0, seed: int = 0
) -> PlantTable:
    """Map plants with errors of 1 sigma `std_m`; every third is crop, every second is treated."""
    dice = np.random.default_rng(seed)
    rows = np.zeros(len(places_m), ROW)
    rows["id"] = np.arange(1, len(rows) + 1)
    rows["group"] = np.arange(len(rows))
    rows["plant"] = np.arange(len(rows)) % 3 == 0
    rows["x_map_m"], rows["y_map_m"] = (places_m + dice.normal(0, std_m, places_m.shape)).T
    own_m = max(std_m, 0.01)
    rows["xx_m2"], rows["xy_m2"], rows["yy_m2"] = own_m**2, 0.1 * own_m**2, own_m**2
    rows["area_m2"] = dice.uniform(1e-4, 1e-2, len(rows))
    rows["confidence"] = dice.uniform(0.8, 0.99, len(rows))
    rows["sightings"] = dice.integers(3, 40, len(rows))
    rows["first_seen_s"] = dice.uniform(0, 100, len(rows))
    rows["last_seen_s"] = rows["first_seen_s"] + 3.0
    rows["treated_s"] = np.where((rows["id"] % 2) & ~rows["plant"], rows["last_seen_s"], np.nan)
    return judge_plants(round_rows(PlantTable(DATUM, (name,), rows)), GUARD_M)
