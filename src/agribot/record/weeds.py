"""The weed map of a run: its file, and what the page shows of it while it grows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol

from agribot.autonomy.implements.crop_guard import CROP_STEM_M
from agribot.autonomy.implements.zones import ZoneMap
from agribot.autonomy.weeds.judge_plants import judge_plants
from agribot.autonomy.weeds.plant_table import PlantTable, round_rows, tabulate_plants
from agribot.core.config import RunConfig
from agribot.core.geo import Datum, MapFrame
from agribot.core.implement.plants import PlacedPlant
from agribot.core.messages import MappedPlant
from agribot.gis.weeds.files import write_map
from agribot.record.series import RunData

WEED_FILE = "weeds.geojson"
WEED_COLUMNS = (
    "id", "class", "x_map_m", "y_map_m", "std_m", "confidence", "area_m2", "sightings",
    "first_seen_s", "last_seen_s", "treated_s",
)  # fmt: skip
_DECIMALS = 9  # 0.1 mm on the ground


class PlantOnMap(PlacedPlant, Protocol):
    """The facts of a plant that the files need, whatever mapped it."""

    @property
    def confidence(self) -> float: ...
    @property
    def sightings(self) -> int: ...
    @property
    def first_seen_s(self) -> float: ...
    @property
    def last_seen_s(self) -> float: ...


def weeds_geojson(plants: Iterable[PlantOnMap], datum: Datum) -> dict[str, Any]:
    """Make a FeatureCollection of points, one for each mapped plant.

    `std_m` is the larger axis of the 1-sigma ellipse; `treated_s` is null for an untreated plant.
    """
    return {"type": "FeatureCollection", "features": [*weed_features(plants, datum)]}


def weed_features(plants: Iterable[PlantOnMap], datum: Datum) -> Iterator[dict[str, Any]]:
    """Make the features of that collection, one by one."""
    frame = MapFrame(datum)
    return (_make_feature(plant, frame) for plant in plants)


def tabulate_run(
    plants: Iterable[MappedPlant], config: RunConfig, name: str, zones: ZoneMap | None = None
) -> PlantTable:
    """Make the table of a run's weed map, with what was decided and what came of it."""
    treatment = config.treatment
    table = round_rows(tabulate_plants(plants, config.field.datum, name))
    is_off = None if zones is None else ~(zones.find_rates(*table.xy_m.T) > 0.0)
    return judge_plants(
        table,
        CROP_STEM_M + treatment.crop_guard_m,
        is_treating=treatment.enabled,
        is_off=is_off,
    )


def write_weeds(path: Path, data: RunData, name: str) -> None:
    """Write the weed map of a run as GeoJSON; `name` is the run's, or that of its job's first.

    Raises: RecordingError: the file cannot be written.
    """
    write_map(path, tabulate_run(data.plants, data.config, name, data.zones))


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
