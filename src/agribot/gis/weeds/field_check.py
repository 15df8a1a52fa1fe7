"""Whether places lie in a field, and what is wrong with a file whose places do not."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agribot.autonomy.weeds.plant_table import PlantTable
from agribot.core.errors import RecordingError
from agribot.core.geo import MapFrame
from agribot.core.messages import FloatArray
from agribot.gis.field_file import read_field

if TYPE_CHECKING:
    import shapely

EDGE_M = 1.0  # tolerance at the boundary: plants beside it are seen from inside
LEAST_RATIO = 0.99  # least share of plants in the field: a few false ones may lie outside


def check_in_field(table: PlantTable, field: Path, shown: str) -> None:
    """Check that the plants of a map stand in the field of a file.

    Raises: RecordingError: they do not; a likely reason is named. MissionError: no such field.
    """
    import shapely

    area, datum = read_field(field)
    frame = MapFrame(datum)
    outline = shapely.Polygon(area.boundary).buffer(EDGE_M)
    lonlat_deg = table.frame.lonlat_from_map(table.xy_m)
    inside = _compute_ratio(outline, frame.map_from_lonlat(lonlat_deg))
    if inside >= LEAST_RATIO:
        return
    hint = find_exchange(outline, frame, lonlat_deg)
    raise RecordingError(
        f"{shown}: {100 * (1 - inside):.0f} % of its plants stand outside the field of "
        f"{field.name}; {hint or 'it is the map of another field'}"
    )


def find_exchange(outline: shapely.Polygon, frame: MapFrame, lonlat_deg: FloatArray) -> str:
    """Find which exchange or mirroring of axes would bring the places into the field."""
    lon_deg, lat_deg = lonlat_deg.T
    origin = frame.datum
    variants = {
        "longitude and latitude are exchanged": (lat_deg, lon_deg),
        "the sign of the longitude is wrong": (-lon_deg, lat_deg),
        "the sign of the latitude is wrong": (lon_deg, -lat_deg),
        "North and South are mirrored": (lon_deg, 2.0 * origin.lat_deg - lat_deg),
        "East and West are mirrored": (2.0 * origin.lon_deg - lon_deg, lat_deg),
    }
    for what, sides in variants.items():
        places = np.column_stack(sides)
        if (np.abs(places) > (180.0, 90.0)).any():
            continue
        if _compute_ratio(outline, frame.map_from_lonlat(places)) >= LEAST_RATIO:
            return f"{what}; export the file again"
    return ""


def _compute_ratio(outline: shapely.Polygon, xy_m: FloatArray) -> float:
    import shapely

    inside = shapely.contains_xy(outline, xy_m[:, 0], xy_m[:, 1])
    return float(inside.mean()) if len(xy_m) else 1.0
