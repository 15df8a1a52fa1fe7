"""Prescriptions of other programs: their zones lie where they were drawn, and faults are named."""

from __future__ import annotations

import io
import json
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import numpy as np
import pytest

from agribot.app.rerun import rerun
from agribot.app.simulated_run import simulate
from agribot.autonomy.implements.zones import ZoneMap
from agribot.autonomy.weeds.plant_table import OUTCOMES
from agribot.core import config
from agribot.core.errors import MissionError
from agribot.core.facts import FileBroken, FileUnreadable, ZonesElsewhere, ZonesFar, ZoneShort
from agribot.core.geo import Datum, MapFrame
from agribot.gis.prescription import check_covers, read_prescription
from agribot.gis.weeds.isoxml_tasks import TaskOptions, write_tasks
from agribot.record.replay import read_config
from tests.finding import refused
from tests.gis.test_weed_tasks import BEGAN, MAP
from tests.gis.weed_maps import DATUM
from tests.machine import needs

FRAME = MapFrame(DATUM)
ZONES_M = {
    120.0: [(0, 0), (20, 0), (20, 40), (0, 40), (0, 0)],
    0.0: [(20, 0), (30, 0), (30, 40), (20, 40), (20, 0)],
}


def ring(points_m: Any, frame: MapFrame = FRAME) -> list[list[float]]:
    degrees: list[list[float]] = frame.lonlat_from_map(np.array(points_m, dtype=float)).tolist()
    return degrees


def geojson(column: str = "rate", frame: MapFrame = FRAME) -> dict[str, Any]:
    features = [
        {
            "type": "Feature",
            "properties": {column: rate},
            "geometry": {"type": "Polygon", "coordinates": [ring(points, frame)]},
        }
        for rate, points in ZONES_M.items()
    ]
    return {"type": "FeatureCollection", "features": features}


def read(root: Any, name: str = "rx.geojson", **words: str) -> ZoneMap:
    return read_prescription(name, json.dumps(root).encode(), DATUM, **words)


def rates_at(zones: ZoneMap, *places_m: tuple[float, float]) -> list[float]:
    rates: list[float] = zones.find_rates(*np.array(places_m, dtype=float).T).tolist()
    return rates


def test_zones_lie_where_they_were_drawn() -> None:
    zones = read(geojson())
    assert rates_at(zones, (19.9, 1.0), (20.1, 39.0)) == [120.0, 0.0]
    assert np.isnan(rates_at(zones, (30.2, 5.0), (-0.2, 5.0), (5.0, 40.2))).all()


def test_zones_and_grids_over_the_antimeridian_lie_where_they_were_drawn(tmp_path: Path) -> None:
    edge = Datum(lat_deg=-16.8, lon_deg=179.9999)  # 10.7 m of the field lie in the West
    there = MapFrame(edge)
    root = geojson(frame=there)
    corners = np.array(root["features"][0]["geometry"]["coordinates"][0])
    assert corners[:, 0].min() < 0.0 < corners[:, 0].max()
    zones = read_prescription("rx.geojson", json.dumps(root).encode(), edge)
    assert rates_at(zones, (5.0, 1.0), (19.9, 1.0), (20.1, 39.0)) == [120.0, 120.0, 0.0]
    assert np.isnan(rates_at(zones, (30.2, 5.0), (-0.2, 5.0))).all()
    path = tmp_path / "left.isoxml.zip"
    left = MAP._replace(datum=edge)
    write_tasks(path, left, TaskOptions(BEGAN, rate_lpha=180.0))
    sprayed = read_prescription(path.name, path.read_bytes(), edge)
    is_open = left.rows["outcome"] == OUTCOMES.index("missed")
    assert (sprayed.find_rates(*left.xy_m[is_open].T) == 180.0).all()
    assert np.nanmean(sprayed.rates_lpha > 0.0) < 0.2


@needs("ogr2ogr")
@pytest.mark.parametrize("suffix", [".gpkg", ".zip"])
def test_zones_of_other_programs_keep_places_and_rates(tmp_path: Path, suffix: str) -> None:
    (tmp_path / "rx.geojson").write_text(json.dumps(geojson("Rx")))
    out = tmp_path / ("rx.gpkg" if suffix == ".gpkg" else "rx.shp")
    subprocess.run(["ogr2ogr", str(out), str(tmp_path / "rx.geojson")], check=True)
    if suffix == ".zip":
        with zipfile.ZipFile(tmp_path / "rx.zip", "w") as archive:
            for part in sorted(tmp_path.glob("rx.[sdpc]*")):
                archive.write(part, part.name)
    data = (tmp_path / f"rx{suffix}").read_bytes()
    zones = read_prescription(f"rx{suffix}", data, DATUM)
    assert rates_at(zones, (10.0, 10.0), (25.0, 10.0)) == [120.0, 0.0]


def test_of_zones_that_overlap_the_lowest_rate_counts() -> None:
    root = geojson()
    root["features"].append(json.loads(json.dumps(root["features"][0])))
    root["features"][-1]["properties"]["rate"] = 60
    assert rates_at(read(root), (10.0, 10.0)) == [60.0]


def test_a_column_of_an_odd_name_is_read_when_it_is_named() -> None:
    with pytest.raises(MissionError, match=r"no rate; its columns: menge_l.*prescription_column"):
        read(geojson("menge_l"))
    assert rates_at(read(geojson("menge_l"), column="menge_l"), (10.0, 10.0)) == [120.0]


@pytest.fixture(scope="module")
def tasks(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("tasks") / "tasks.isoxml.zip"
    write_tasks(path, MAP, TaskOptions(BEGAN, rate_lpha=180.0))
    return path.read_bytes()


def test_what_one_robot_left_is_what_another_is_to_spray(tasks: bytes) -> None:
    zones = read_prescription("tasks.zip", tasks, DATUM)
    is_open = MAP.rows["outcome"] == OUTCOMES.index("missed")
    left, done = (rates_at(zones, *map(tuple, MAP.xy_m[mask])) for mask in (is_open, ~is_open))
    assert set(left) == {180.0}
    assert np.mean(np.array(done) == 0.0) > 0.5


def edit(data: bytes, change: Callable[[str, bytes], bytes]) -> bytes:
    """Change the files of an archive one by one; an empty one is left out."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(buffer, "w") as new:
        for name in old.namelist():
            if changed := change(name, old.read(name)):
                new.writestr(name, changed)
    return buffer.getvalue()


def in_xml(old: bytes, new: bytes) -> Callable[[str, bytes], bytes]:
    def change(name: str, data: bytes) -> bytes:
        if not name.endswith("TASKDATA.XML"):
            return data
        assert old in data
        return data.replace(old, new)

    return change


BROKEN: dict[str, tuple[Callable[[str, bytes], bytes], str]] = {
    "swapped ids": (in_xml(b'TZN A="1"', b'TZN A="5"'), r"zones 1.*ids are swapped"),
    "one id twice": (in_xml(b'TZN A="1"', b'TZN A="0"'), r"two treatment zones have the code 0"),
    "mirrored cells": (in_xml(b'" C="0.0', b'" C="-0.0'), r"grid is mirrored"),
    "a cut grid": (lambda n, d: d[:-9] if "GRD" in n else d, r"bytes where \d+ are wanted: cut"),
    "no grid": (lambda n, d: b"" if "GRD" in n else d, r"GRD00001.BIN.*not in the archive"),
    "a rate in another unit": (in_xml(b'A="0001"', b'A="0006"'), r"sets 0006.*volume per area"),
    "a rate beyond all": (in_xml(b'B="18000"', b'B="18000000"'), r"180000"),
    "a huge grid": (in_xml(b'E="', b'E="999999'), r"cells, where 25000000 are the most"),
    "cut XML": (lambda n, d: d[: len(d) // 2] if n.endswith("A.XML") else d, r"not XML"),
    "no task": (in_xml(b"TSK", b"ABC"), r"one task with treatment zones is wanted"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_task_data_with_a_fault_is_refused_with_its_name(tasks: bytes, what: str) -> None:
    change, words = BROKEN[what]
    with pytest.raises(MissionError, match=words):
        read_prescription("tasks.zip", edit(tasks, change), DATUM)


def test_an_archive_that_is_cut_off_or_a_bomb_is_refused(tasks: bytes) -> None:
    with refused(FileBroken("'tasks.zip'", ANY, is_advised=ANY)):
        read_prescription("tasks.zip", tasks[: len(tasks) // 2], DATUM)
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("TASKDATA/TASKDATA.XML", b"<a/>")
        archive.writestr("TASKDATA/GRD00001.BIN", bytes(120_000_000))
    with pytest.raises(MissionError, match=r"unpacks to 12\d+ bytes, more than"):
        read_prescription("tasks.zip", bomb.getvalue(), DATUM)


def test_other_coordinates_and_exchanged_ones_are_refused() -> None:
    root = geojson()
    root["crs"] = {"properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    with pytest.raises(MissionError, match="convert it to WGS-84"):
        read(root)
    root = geojson()
    for feature in root["features"]:
        feature["geometry"]["coordinates"] = [
            [[lat, lon] for lon, lat in feature["geometry"]["coordinates"][0]]
        ]
    with refused(ZonesFar(ANY, ANY, "exchanged")):
        read(root)


def test_a_zone_of_two_corners_is_refused() -> None:
    root = geojson()
    del root["features"][0]["geometry"]["coordinates"][0][2:]
    with refused(ZoneShort(2)):
        read(root)


@pytest.mark.parametrize("rate", [-1.0, 1e6, "much"])
def test_rates_that_are_none_are_refused(rate: float | str) -> None:
    root = geojson()
    root["features"][0]["properties"]["rate"] = rate
    with pytest.raises(MissionError, match=r"rate|much"):
        read(root)


def test_a_prescription_that_is_mirrored_or_of_another_field_is_refused() -> None:
    row = np.array([[2.0, 1.0], [18.0, 39.0]])
    assert check_covers(read(geojson()), [row], DATUM, "'rx'") == pytest.approx(1.0)
    with refused(ZonesElsewhere("'rx'", "east_west")):
        check_covers(read(geojson()), [row * (-1.0, 1.0)], DATUM, "'rx'")
    with refused(ZonesElsewhere("'rx'", "other")):
        check_covers(read(geojson()), [row + 200.0], DATUM, "'rx'")


def test_a_run_keeps_its_prescription_for_the_replay(tmp_path: Path) -> None:
    farm = config.load("farm", [])
    frame = MapFrame(Datum(lat_deg=farm.field.datum.lat_deg, lon_deg=farm.field.datum.lon_deg))
    path = tmp_path / "rx.geojson"
    path.write_text(json.dumps(geojson(frame=frame)))
    settings = ["duration_s=0.4", "perception.enabled=false", f'treatment.prescription="{path}"']
    with simulate(config.load("farm", settings), tmp_path / "run") as session:
        for _ in session.ticks():
            pass
        session.finish()
    path.unlink()
    recording = tmp_path / "run" / "run.mcap"
    ticks, _ = rerun(recording, read_config(recording))
    assert len(ticks) > 10
    with refused(FileUnreadable(str(path), ANY)):
        simulate(config.load("farm", settings), tmp_path / "other")
