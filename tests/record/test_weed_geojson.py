from __future__ import annotations

import json
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.core.config import load
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import PlantClass
from agribot.record.series import RunData, SeriesTap
from agribot.record.weeds import weeds_geojson, write_weeds
from tests.record import record_samples as samples

DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022)


def test_the_file_is_geojson_with_longitude_first(tmp_path: Path) -> None:
    plants = (
        samples.plant(1),
        samples.plant(2, treated_s=9.5),
        samples.plant(3, PlantClass.CROP),
    )
    config = load("farm", [f"field.datum.lat_deg={DATUM.lat_deg}"])
    data = RunData(config=config, series=SeriesTap().series(), plants=plants)
    write_weeds(tmp_path / "weeds.geojson", data, "a run")
    found = json.loads((tmp_path / "weeds.geojson").read_text())
    assert found["type"] == "FeatureCollection"
    assert "crs" not in found  # RFC 7946: always WGS-84
    assert [f["properties"]["class"] for f in found["features"]] == ["weed", "weed", "crop"]
    assert [f["properties"]["treated_s"] for f in found["features"]] == [None, 9.5, None]
    for feature in found["features"]:
        lon_deg, lat_deg = feature["geometry"]["coordinates"]
        assert feature["geometry"]["type"] == "Point"
        assert lon_deg == pytest.approx(72.787, abs=0.01)
        assert lat_deg == pytest.approx(21.161, abs=0.01)


@given(east_m=st.floats(-2000, 2000), north_m=st.floats(-2000, 2000), lat_deg=st.floats(-80, 80))
def test_coordinates_return_to_the_map_within_a_millimetre(
    east_m: float, north_m: float, lat_deg: float
) -> None:
    datum = Datum(lat_deg=lat_deg, lon_deg=72.787022)
    plant = msgspec.structs.replace(samples.plant(1), x_map_m=east_m, y_map_m=north_m)
    feature = weeds_geojson((plant,), datum)["features"][0]
    lon_deg, lat_deg = feature["geometry"]["coordinates"]
    frame = MapFrame(datum)
    _, _, alt_m = frame.geodetic_from_map(east_m, north_m)
    back = frame.map_from_geodetic(lat_deg, lon_deg, alt_m)
    assert math.hypot(back[0] - east_m, back[1] - north_m) < 1e-3


def test_std_is_the_longer_axis_of_the_ellipse() -> None:
    plant = msgspec.structs.replace(samples.plant(1), cov_m2=(4e-4, 1e-4, 1e-4, 9e-4))
    largest = np.linalg.eigvalsh(np.reshape(plant.cov_m2, (2, 2))).max()
    assert plant.std_m == pytest.approx(math.sqrt(largest))


def test_a_map_without_plants_is_still_geojson() -> None:
    assert weeds_geojson((), DATUM) == {"type": "FeatureCollection", "features": []}
