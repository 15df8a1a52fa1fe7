"""A row of carrots, which look like weeds pixel by pixel: their stems keep the spray off."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.description.field_generator import generate_field
from agribot.description.field_settings import read_field_settings
from agribot.description.sdf_export import write_world
from tests import nightly
from tests.mission.conftest import ALL_HZ, FEW_HZ, run_session, see_at

FIELD = """
name = "carrots"

[rows]
count = 1
length_m = 3.0
first_row_start_map_m = [-2.0, 1.2]
yaw_deg = 90.0

[crop]
species = "carrot"
spacing_m = 0.05
height_m = 0.12

[weeds]
density_per_m2 = 6.0
"""


@pytest.mark.slow
@nightly.by_day(
    "tests/lab/train/test_plants_model.py::test_it_tells_seedlings_of_carrots_and_parsley_from_weeds",
    "tests/autonomy/implements/test_spray_and_leaves.py::"
    "test_a_row_that_looks_like_weeds_stays_dry_where_no_stem_explains_its_leaves",
    "tests/autonomy/implements/test_spray_and_leaves.py::"
    "test_leaves_that_point_to_stems_of_the_map_are_sprayed_and_the_stems_are_not",
)
@pytest.mark.parametrize("pictures_hz", [FEW_HZ, ALL_HZ])
def test_no_carrot_of_a_row_is_sprayed(tmp_path: Path, pictures_hz: float) -> None:
    field, world = tmp_path / "carrots.toml", tmp_path / "carrots.world"
    field.write_text(FIELD)
    write_world(generate_field(read_field_settings(field), 1), world)
    settings = [
        f'world="{world}"', "seed=1", 'sim.sensors="rtk"', "duration_s=20",
        "field.row_count=1", "field.row_length_m=3.0", "field.plant_spacing_m=0.05",
        "field.first_row_start_map_m=[-2.0, 1.2]", see_at(pictures_hz), "record.enabled=false",
    ]  # fmt: skip
    report = run_session("beet", settings, str(tmp_path / "run"))
    assert report.mission.rows_done == 1
    assert report.weeds.crops_truth is not None and report.weeds.crops_truth > 45
    assert report.weeds.treated_true is not None and report.weeds.treated_true >= 1
    assert report.weeds.crops_hit == 0
