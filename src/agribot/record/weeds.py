"""The weed map as GeoJSON (RFC 7946: WGS-84, longitude before latitude)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec

from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import MappedPlant
from agribot.record.report import write_file

_DECIMALS = 9  # 0.1 mm on the ground


def weeds_geojson(plants: Iterable[MappedPlant], datum: Datum) -> dict[str, Any]:
    """Make a FeatureCollection of points, one for each mapped plant.

    `std_m` is the larger axis of the 1-sigma ellipse; `treated_s` is null for an untreated plant.
    """
    frame = MapFrame(datum)
    return {"type": "FeatureCollection", "features": [_make_feature(p, frame) for p in plants]}


def write_weeds(path: Path, plants: Iterable[MappedPlant], datum: Datum) -> None:
    """Write the weed map.

    Raises: RecordingError: the file cannot be written.
    """
    text = msgspec.json.format(msgspec.json.encode(weeds_geojson(plants, datum)), indent=1)
    write_file(path, text + b"\n")


def position_std_m(plant: MappedPlant) -> float:
    """Compute the square root of the larger eigenvalue of the 2x2 covariance."""
    a, b, c, d = plant.cov_m2
    half_trace = (a + d) / 2.0
    root = math.sqrt(max(((a - d) / 2.0) ** 2 + b * c, 0.0))
    return math.sqrt(max(half_trace + root, 0.0))


def _make_feature(plant: MappedPlant, frame: MapFrame) -> dict[str, Any]:
    lat_deg, lon_deg, _ = frame.geodetic_from_map(plant.x_map_m, plant.y_map_m)
    return {
        "type": "Feature",
        "id": plant.id,
        "geometry": {
            "type": "Point",
            "coordinates": [round(lon_deg, _DECIMALS), round(lat_deg, _DECIMALS)],
        },
        "properties": {
            "id": plant.id,
            "class": plant.plant.name.lower(),
            "area_m2": plant.area_m2,
            "confidence": plant.confidence,
            "std_m": position_std_m(plant),
            "sightings": plant.sightings,
            "first_seen_s": plant.first_seen_s,
            "last_seen_s": plant.last_seen_s,
            "treated": plant.treated_s is not None,
            "treated_s": plant.treated_s,
            "x_map_m": plant.x_map_m,
            "y_map_m": plant.y_map_m,
        },
    }
