"""ISOXML tasks of a weed map, as another program reads them."""

from __future__ import annotations

import struct
import zipfile
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from isoxml.converter.np_grid import to_numpy_array
from isoxml.util.isoxml_io import isoxml_from_path

from agribot.autonomy.weeds.plant_table import OUTCOMES, PlantTable, is_crop
from agribot.cli.main import main
from agribot.gis.weeds.files import write_map
from tests.gis.weed_maps import make_map, scatter

MAP = make_map(scatter(300), std_m=0.02)
BEGAN = datetime(2026, 5, 4, 7, 30, tzinfo=UTC)
CELL_M = 0.5


def export(folder: Path, *words: str, status: int = 0, table: PlantTable = MAP) -> Path:
    source, out = folder / "run.geojson", folder / "tasks.isoxml.zip"
    write_map(source, table)
    began = ["--began", "2026-05-04T07:30"]
    assert main(["weeds", "export", str(source), "-o", str(out), *began, *words]) == status
    return out


def read(path: Path) -> tuple[Any, dict[str, Any]]:
    with zipfile.ZipFile(path) as archive:
        archive.extractall(path.parent)
    data, files = isoxml_from_path(path.parent / "TASKDATA")
    return data, files


@pytest.mark.parametrize("version", ["3", "4"])
def test_the_grid_sprays_every_weed_that_is_left_and_little_else(
    tmp_path: Path, version: str
) -> None:
    data, files = read(export(tmp_path, "--rate", "180", "--version", version))
    assert type(data).__module__.endswith(f"v{version}.iso11783_task_data")
    task = data.tasks[0]
    rates = {
        zone.code: zone.process_data_variables[0].process_data_value
        for zone in task.treatment_zones
    }
    assert rates == {0: 0, 1: 18_000}  # 180 l/ha in mm3/m2
    (grid,) = task.grids
    codes = to_numpy_array(files["GRD00001"], grid)
    lonlat = MAP.frame.lonlat_from_map(MAP.xy_m)
    row = (lonlat[:, 1] - float(grid.minimum_north_position)) / float(grid.cell_north_size)
    column = (lonlat[:, 0] - float(grid.minimum_east_position)) / float(grid.cell_east_size)
    is_open = MAP.rows["outcome"] == OUTCOMES.index("missed")
    at = codes[row.astype(int), column.astype(int)]
    assert (at[is_open] == 1).all()
    reach_cells = is_open.sum() * (2 * 0.13 / CELL_M + 1) ** 2  # a disc in the grid, at most
    assert is_open.sum() / 2 < codes.sum() < reach_cells
    gap_m = np.linalg.norm(MAP.xy_m[~is_open][:, None] - MAP.xy_m[is_open][None], axis=2)
    far = gap_m.min(axis=1) > 0.9
    assert far.any() and not at[~is_open][far].any()


def test_the_log_has_time_and_place_of_every_weed_that_was_treated(tmp_path: Path) -> None:
    data, files = read(export(tmp_path))
    task = data.tasks[1]
    assert task.time_logs[0].filename == "TLG00001"
    records = list(struct.iter_unpack("<IHiiBBBiBi", files["TLG00001"]))
    treated = MAP.rows[(MAP.rows["outcome"] == OUTCOMES.index("treated")) & ~is_crop(MAP.rows)]
    treated = treated[np.argsort(treated["treated_s"])]
    assert len(records) == 2 * len(treated)
    lonlat = MAP.frame.lonlat_from_map(np.column_stack([treated["x_map_m"], treated["y_map_m"]]))
    for (milliseconds, days, north, east, *_, state, _, rate), (lon, lat), seconds in zip(
        records[::2], lonlat, treated["treated_s"], strict=True
    ):
        when = datetime(1980, 1, 1, tzinfo=UTC) + timedelta(days=days, milliseconds=milliseconds)
        assert abs((when - BEGAN).total_seconds() - seconds) < 2e-3
        assert (north * 1e-7, east * 1e-7) == pytest.approx((lat, lon), abs=1e-7)
        assert (state, rate) == (1, 20_000)
    assert {record[-3] for record in records[1::2]} == {0}  # and off again


def test_a_grid_of_too_many_cells_is_refused(tmp_path: Path, capsys: Any) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("agribot.gis.weeds.isoxml_tasks.MAX_CELLS", 1000)
        export(tmp_path, status=2)
    assert "give a larger --cell than 0.5 m" in capsys.readouterr().err


def test_a_time_that_is_none_is_refused(tmp_path: Path, capsys: Any) -> None:
    export(tmp_path, "--began", "in May", status=2)
    assert "--began in May: not a time" in capsys.readouterr().err


@pytest.mark.parametrize("began", ["2026-05-04T09:30+02:00", "2026-05-04T07:30Z"])
def test_a_time_of_another_zone_is_turned_into_utc(tmp_path: Path, began: str) -> None:
    with zipfile.ZipFile(export(tmp_path)) as in_utc:
        wanted = in_utc.read("TASKDATA/TLG00001.BIN")
    with zipfile.ZipFile(export(tmp_path, "--began", began)) as archive:
        assert archive.read("TASKDATA/TLG00001.BIN") == wanted


@pytest.mark.parametrize(
    ("began", "late_s"), [("1970-01-01", 0.0), ("2026-05-04", 1e15), ("2026-05-04", 5e9)]
)
def test_a_day_that_no_time_log_has_is_refused(
    tmp_path: Path, capsys: Any, began: str, late_s: float
) -> None:
    rows = MAP.rows.copy()
    rows["treated_s"] += late_s
    export(tmp_path, "--began", began, status=2, table=MAP._replace(rows=rows))
    assert "a time log has days from 1980 to 2159 only" in capsys.readouterr().err


def test_the_last_millisecond_of_a_day_belongs_to_it_or_to_the_next(tmp_path: Path) -> None:
    rows = MAP.rows.copy()
    rows["treated_s"][np.isfinite(rows["treated_s"])] = 86_399.9997
    out = export(tmp_path, "--began", "2026-05-04", table=MAP._replace(rows=rows))
    with zipfile.ZipFile(out) as archive:
        log = archive.read("TASKDATA/TLG00001.BIN")
    times = {record[:2] for record in struct.iter_unpack("<IHiiBBBiBi", log)}
    days = (datetime(2026, 5, 5, tzinfo=UTC) - datetime(1980, 1, 1, tzinfo=UTC)).days
    assert times == {(0, days), (100, days)}
