"""The weed map in reports: where weeds are dense, what is left, and how the crop stands."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from agribot.autonomy.weeds.plant_table import PlantTable
from agribot.cli.main import main
from agribot.core.messages import PlantClass, Row
from agribot.gis.weeds.files import write_map
from agribot.gis.weeds.records import COLUMNS, iterate_records
from agribot.gis.weeds.styles import STYLES, find_style
from agribot.record.crop_stand import find_stand
from agribot.record.weed_figures import count_density, find_styles
from tests.gis.weed_maps import make_map, scatter

ROW = Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(6.0, 8.0))  # 10 m long
SPACING_M = 0.25


def crop_at(along_m: np.ndarray, left_m: float = 0.0) -> PlantTable:
    """Crop plants of the row, a hand's breadth apart from its line at most."""
    along, left = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    table = make_map(along_m[:, None] * along + left_m * left)
    table.rows["plant"] = PlantClass.CROP
    return table


def test_a_full_row_has_no_gap() -> None:
    stand = find_stand(crop_at(np.arange(0.0, 10.01, SPACING_M), 0.05), ROW)
    assert stand.spacing_m == pytest.approx(SPACING_M, abs=1e-3)
    assert (len(stand.along_m), len(stand.gaps_m), stand.missing) == (41, 0, 0)
    assert stand.per_metre == pytest.approx(4.1)


def test_plants_that_are_missing_are_a_gap_also_at_the_ends() -> None:
    kept = np.arange(0.0, 10.01, SPACING_M)
    kept = kept[(kept > 0.9) & ((kept < 4.9) | (kept > 6.1)) & (kept < 9.6)]
    stand = find_stand(crop_at(kept), ROW, SPACING_M)
    assert stand.missing == 4 + 5 + 2
    assert np.abs(stand.gaps_m - [[-0.25, 1.0], [4.75, 6.25], [9.5, 10.25]]).max() < 1e-3
    assert stand.bare_m == pytest.approx(SPACING_M * stand.missing, abs=1e-3)


def test_weeds_and_crop_beside_the_row_are_no_plants_of_it() -> None:
    table = crop_at(np.array([0.0, 5.0, 10.0]), left_m=0.4)
    assert not len(find_stand(table, ROW).along_m)
    table = crop_at(np.array([0.0, 5.0, 10.0]))
    table.rows["plant"] = PlantClass.WEED
    assert not len(find_stand(table, ROW).along_m)


def test_a_row_that_the_camera_saw_and_the_map_cannot_tell_apart_is_not_counted() -> None:
    few = crop_at(np.array([1.0, 7.0]))
    assert not find_stand(few, ROW, SPACING_M, seen_m=9.5).is_countable
    assert find_stand(few, ROW, SPACING_M, seen_m=0.6).is_countable  # bare: those are gaps
    assert find_stand(few, ROW, SPACING_M).is_countable


def test_density_is_weeds_over_the_ground_that_was_seen() -> None:
    places_m = np.random.default_rng(0).uniform(0.0, 10.0, (5000, 2))
    table = make_map(places_m)
    table.rows["plant"] = PlantClass.WEED
    density, _ = count_density(table, (-4.0, 14.0, -1.0, 11.0), 0.1)
    assert np.nanmean(density[30:90, 60:120]) == pytest.approx(50.0, rel=0.1)
    assert np.isnan(density[:, :20]).all()  # no picture of it
    way_m = np.column_stack([np.full(50, -3.5), np.linspace(0.0, 10.0, 50)])
    density, _ = count_density(table, (-4.0, 14.0, -1.0, 11.0), 0.1, way_m)
    assert np.nanmax(density[30:90, :8]) == 0.0  # looked at, and bare


def test_the_figure_colours_plants_as_the_files_do() -> None:
    table = make_map(scatter(200))
    styles = [[*STYLES][code] for code in find_styles(table.rows)]
    records = [record for records in iterate_records(table) for record in records]
    assert styles == [find_style(dict(zip(COLUMNS, r.values, strict=True))) for r in records]


def test_the_page_of_a_map_has_its_figures_and_its_counts(tmp_path: Path, capsys: Any) -> None:
    table = make_map(scatter(300))
    write_map(tmp_path / "map.geojson", table)
    corners = np.array([[-2, -2], [42, -2], [42, 42], [-2, 42], [-2, -2.0]])
    rows = [np.array([[1.0, y], [39.0, y]]) for y in (1.2, 2.4)]
    field = [
        {"type": "Polygon", "coordinates": [table.frame.lonlat_from_map(corners).tolist()]},
        *(
            {"type": "LineString", "coordinates": table.frame.lonlat_from_map(row).tolist()}
            for row in rows
        ),
    ]
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in field]
    (tmp_path / "field.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    words = ["--field", str(tmp_path / "field.geojson"), "-o", str(tmp_path / "weeds.html")]
    assert main(["weeds", "report", str(tmp_path / "map.geojson"), *words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    page = (tmp_path / "weeds.html").read_text()
    assert f"<dt>Weeds</dt><dd>{told['weeds']}</dd>" in page
    assert page.count("<svg") == 3
    for picture in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        ElementTree.fromstring(picture)
    assert not re.search(r'(src|href)="(?!#|data:)', page)  # nothing is loaded from anywhere
