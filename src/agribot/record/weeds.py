"""The weed map as GeoJSON (RFC 7946: WGS-84, longitude before latitude)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol

import msgspec

from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import MappedPlant, PlantClass
from agribot.record.report import write_file

WEED_COLUMNS = (
    "id", "class", "x_map_m", "y_map_m", "std_m", "confidence", "area_m2", "sightings",
    "first_seen_s", "last_seen_s", "treated_s",
)  # fmt: skip
_DECIMALS = 9  # 0.1 mm on the ground


class PlantOnMap(Protocol):
    """What the files need to know of a plant, whoever mapped it."""

    @property
    def id(self) -> int: ...
    @property
    def plant(self) -> PlantClass: ...
    @property
    def x_map_m(self) -> float: ...
    @property
    def y_map_m(self) -> float: ...
    @property
    def std_m(self) -> float: ...
    @property
    def confidence(self) -> float: ...
    @property
    def area_m2(self) -> float: ...
    @property
    def sightings(self) -> int: ...
    @property
    def first_seen_s(self) -> float: ...
    @property
    def last_seen_s(self) -> float: ...
    @property
    def treated_s(self) -> float | None: ...


def weeds_geojson(plants: Iterable[PlantOnMap], datum: Datum) -> dict[str, Any]:
    """Make a FeatureCollection of points, one for each mapped plant.

    `std_m` is the larger axis of the 1-sigma ellipse; `treated_s` is null for an untreated plant.
    """
    return {"type": "FeatureCollection", "features": [*weed_features(plants, datum)]}


def weed_features(plants: Iterable[PlantOnMap], datum: Datum) -> Iterator[dict[str, Any]]:
    """Make the features of that collection, one by one."""
    frame = MapFrame(datum)
    return (_make_feature(plant, frame) for plant in plants)


def write_weeds(path: Path, plants: Iterable[MappedPlant], datum: Datum) -> None:
    """Write the weed map.

    Raises: RecordingError: the file cannot be written.
    """
    text = msgspec.json.format(msgspec.json.encode(weeds_geojson(plants, datum)), indent=1)
    write_file(path, text + b"\n")


def _make_feature(plant: PlantOnMap, frame: MapFrame) -> dict[str, Any]:
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
            "std_m": plant.std_m,
            "sightings": plant.sightings,
            "first_seen_s": plant.first_seen_s,
            "last_seen_s": plant.last_seen_s,
            "treated": plant.treated_s is not None,
            "treated_s": plant.treated_s,
            "x_map_m": plant.x_map_m,
            "y_map_m": plant.y_map_m,
        },
    }
