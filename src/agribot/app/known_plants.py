"""The crop plants of an earlier run, by which a run finds its place: their file, and what is kept.

A recording keeps the places themselves, so that it can be run again without the file.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from agribot.autonomy.estimate.filter.stem_map import StemMap
from agribot.autonomy.weeds.plant_table import is_crop, move_to_datum
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import CropMapCount, CropMapWide
from agribot.core.messages import MapPoint
from agribot.gis.weeds.files import read_map

# Fewer plants are no field; of more the map would fill the robot's memory.
FEWEST, MOST, MOST_M2 = 20, 1_000_000, 400_000.0
DECIMALS = 4


def read_plant_file(config: RunConfig) -> bytes:
    """Read the crop of the file of the settings; empty where a run has none.

    Raises: AgribotError: no weed map, or one without crop, or of a field that is too large.
    """
    if not config.field.plant_map:
        return b""
    path = Path(config.field.plant_map)
    table = move_to_datum(read_map(path, path.stem), config.field.datum)
    stems = np.round(table.xy_m[is_crop(table.rows)], DECIMALS)
    if not FEWEST <= len(stems) <= MOST:
        raise MissionError(CropMapCount(path.name, len(stems), FEWEST, MOST))
    area_m2 = float(np.prod(np.ptp(stems, axis=0)))
    if not area_m2 <= MOST_M2:
        raise MissionError(CropMapWide(path.name, area_m2 / 1e4, MOST_M2 / 1e4))
    return msgspec.json.encode(stems.tolist())


def read_plants(data: bytes) -> StemMap | None:
    """Make the map of what `read_plant_file` read; None without plants."""
    return StemMap(np.array(msgspec.json.decode(data, type=list[MapPoint]))) if data else None
