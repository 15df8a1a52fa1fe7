"""A network that knows no carrot takes a row of them for weeds: the tool stays off."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agribot.description.field_generator import generate_field
from agribot.description.field_settings import read_field_settings
from agribot.description.sdf_export import write_world
from tests import nightly
from tests.mission.conftest import run_session
from tests.mission.test_carrots import FIELD


@pytest.mark.slow
@nightly.by_day(
    "tests/autonomy/estimate/test_crop_watch.py::"
    "test_a_row_of_plants_that_are_called_weed_is_a_crop_that_the_network_does_not_know",
    "tests/autonomy/control/test_hazards.py::"
    "test_the_tool_is_off_while_the_plants_that_the_camera_names_are_in_doubt",
)
def test_no_carrot_is_sprayed_by_a_network_that_knows_none_and_the_reason_is_given(
    tmp_path: Path,
) -> None:
    field, world = tmp_path / "carrots.toml", tmp_path / "carrots.world"
    field.write_text(FIELD)
    write_world(generate_field(read_field_settings(field), 1), world)
    settings = [
        f'world="{world}"', "seed=1", 'sim.sensors="rtk"', "duration_s=20",
        "field.row_count=1", "field.row_length_m=3.0", "field.plant_spacing_m=0.05",
        "field.first_row_start_map_m=[-2.0, 1.2]", 'perception.model="agribot-sim"',
        'treatment.leaves="none"', "record.enabled=false",
    ]  # fmt: skip
    report = run_session("beet", settings, str(tmp_path / "run"))
    assert report.weeds.crops_hit == 0
    lines = (tmp_path / "run" / "events.jsonl").read_text(encoding="utf-8").splitlines()
    reasons = [json.loads(line)["reason"] for line in lines]
    assert any(reason.startswith("camera: sees no crop where the rows are") for reason in reasons)
