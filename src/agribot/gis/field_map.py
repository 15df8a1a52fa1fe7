"""A field as an occupancy map: free inside of its boundary, occupied outside and in its holes."""

from __future__ import annotations

import math

import numpy as np

from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.core.errors import MissionError
from agribot.core.facts import MapLarge
from agribot.core.geo import Datum
from agribot.description.ros_map import FREE, MAX_CELLS, OCCUPIED, RosMap

AROUND_M = 2.0  # margin beyond the boundary


def make_field_map(area: FieldArea, datum: Datum, resolution_m: float) -> RosMap:
    """Make the map; a cell is free whose middle lies in the field.

    Raises: MissionError: more than MAX_CELLS along a side.
    """
    import shapely

    ground = shapely.Polygon(area.boundary, area.holes)
    west_m, south_m, east_m, north_m = ground.buffer(AROUND_M).bounds
    columns = math.ceil((east_m - west_m) / resolution_m)
    rows = math.ceil((north_m - south_m) / resolution_m)
    if max(columns, rows) > MAX_CELLS:
        raise MissionError(
            MapLarge(
                east_m - west_m, north_m - south_m, resolution_m, max(columns, rows), MAX_CELLS
            )
        )
    x_m = west_m + (np.arange(columns) + 0.5) * resolution_m
    y_m = south_m + (np.arange(rows) + 0.5) * resolution_m
    shapely.prepare(ground)
    is_free = shapely.contains_xy(ground, *np.meshgrid(x_m, y_m))
    cells = np.where(is_free, FREE, OCCUPIED).astype(np.int8)
    return RosMap(
        cells=cells, resolution_m=resolution_m, x_min_m=west_m, y_min_m=south_m, datum=datum
    )
