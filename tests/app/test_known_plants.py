"""The crop of an earlier run: read from its weed map, kept as places, refused if invalid."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import ANY

import numpy as np
import pytest

from agribot.app.known_plants import read_plant_file, read_plants
from agribot.autonomy.weeds.plant_table import tabulate_plants
from agribot.core.config import RunConfig, load
from agribot.core.errors import AgribotError
from agribot.core.facts import CropMapCount
from agribot.core.messages import MappedPlant, PlantClass
from agribot.gis.weeds.files import write_map
from tests.finding import refused

CROPS = [(0.25 * k, 0.01 * (k % 3)) for k in range(40)]


def write(path: Path, crops: list[tuple[float, float]]) -> RunConfig:
    """Write a weed map of these crops and one weed; the settings of a run that knows it."""
    plants = [
        MappedPlant(
            id=number, plant=kind, x_map_m=x_m, y_map_m=y_m, cov_m2=(1e-4, 0.0, 0.0, 1e-4),
            area_m2=0.01, confidence=0.9, sightings=5, first_seen_s=1.0, last_seen_s=2.0,
        )
        for number, (kind, (x_m, y_m)) in enumerate(
            [(PlantClass.WEED, (5.0, 0.5)), *((PlantClass.CROP, place) for place in crops)]
        )
    ]  # fmt: skip
    config = load("rows-10x12", [f'field.plant_map="{path}"'])
    write_map(path, tabulate_plants(plants, config.field.datum, "first"))
    return config


def test_the_crop_of_a_weed_map_is_found_where_it_stood_and_its_weeds_are_left_out(
    tmp_path: Path,
) -> None:
    known = read_plants(read_plant_file(write(tmp_path / "weeds.geojson", CROPS)))
    assert known is not None
    assert known.stems_map_m == pytest.approx(np.array(CROPS), abs=1e-3)
    found = known.find_nearest(np.array([1.03, 5.0]), np.array([0.02, 0.5]))
    assert found.tolist() == [4, -1]


def test_a_run_without_a_map_knows_no_plants() -> None:
    assert read_plants(read_plant_file(load("rows-10x12", []))) is None


def test_a_map_without_crop_is_refused_and_says_what_to_give(tmp_path: Path) -> None:
    config = write(tmp_path / "weeds.geojson", CROPS[:3])
    with refused(CropMapCount("weeds.geojson", 3, ANY, ANY)):
        read_plant_file(config)


def test_a_map_that_is_not_there_is_refused() -> None:
    with pytest.raises(AgribotError, match="does not exist"):
        read_plant_file(load("rows-10x12", ['field.plant_map="nowhere.geojson"']))
