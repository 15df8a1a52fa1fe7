"""The hoe in a whole run: weeds uprooted and crops spared, judged by the referee's truth."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.app.simulated_run import simulate
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core import config
from agribot.core.messages import PlantClass
from agribot.record.replay import read_ticks
from tests import nightly
from tests.mission.conftest import ALL_HZ, FEW_HZ, run_session, see_at, start_before_a_row
from tests.mission.paper_camera import CameraOnPaper


def test_the_hoe_works_the_ground_beside_a_row_and_its_draught_is_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = [
        "robot=agribot-hoe", "seed=2", 'sim.sensors="rtk"', "field.row_count=1",
        "perception.enabled=false", "record.enabled=false", "duration_s=16",
        *start_before_a_row(monkeypatch),
    ]  # fmt: skip
    with simulate(config.load("farm", settings), tmp_path) as session:
        rows = lay_rows(session.config.field)
        session.stack.perception = CameraOnPaper(session, rows, has_cover=True)
        down = [tick for tick in session.ticks() if tick.command.implement.is_on]
        report = session.finish()
        worked = [session.world.plants[index].plant for index in session.simulator.treated]
    assert report.mission.coverage_ratio is not None and report.mission.coverage_ratio > 0.3
    assert PlantClass.CROP not in worked and report.tracking.plants_crushed == 0
    assert worked.count(PlantClass.WEED) >= 3
    assert report.implement is not None and report.implement.kind == "hoe"
    assert report.implement.worked_m2 is not None and report.implement.worked_m2 > 1.5
    lines = {line.name: line.value for line in report.implement.lines}
    assert lines["hoed"] == pytest.approx(report.implement.worked_m2, rel=0.05)
    assert not report.safety.stops and not report.safety.noticed
    assert all(tick.command.drive.v_mps > 0.0 for tick in down)
    assert {tick.command.implement.setpoints["depth_m"] for tick in down} == {0.02}


@pytest.mark.slow
@nightly.by_day(
    "test_the_hoe_works_the_ground_beside_a_row_and_its_draught_is_no_fault",
    "tests/autonomy/implements/test_hoe.py::"
    "test_weeds_beside_and_between_the_crop_are_uprooted_and_no_crop_is_cut",
    "tests/autonomy/implements/test_hoe.py::test_what_the_hoe_reports_agrees_with_the_ground",
    "tests/sim/test_hoe.py::test_a_crop_is_cut_at_any_depth_and_a_weed_only_near_the_whole_of_it",
    "tests/sim/test_hoe.py::test_blades_in_the_soil_cost_the_motors_what_the_draught_is",
)
@pytest.mark.parametrize("pictures_hz", [FEW_HZ, ALL_HZ])
def test_the_hoe_works_a_row_of_the_farm_and_cuts_no_crop(
    tmp_path: Path, pictures_hz: float
) -> None:
    out = tmp_path / "run"
    settings = ["robot=agribot-hoe", "seed=2", "duration_s=62", see_at(pictures_hz)]
    report = run_session("farm", settings, str(out))
    assert report.weeds.crops_hit == 0 and report.tracking.plants_crushed == 0
    assert report.weeds.treated_true is not None and report.weeds.treated_true >= 12
    assert report.weeds.spray_area_ratio is None  # nothing was sprayed
    assert report.implement is not None and report.implement.kind == "hoe"
    assert report.implement.worked_m2 is not None and report.implement.worked_m2 > 5.0
    lines = {line.name: line.value for line in report.implement.lines}
    assert lines["hoed"] == pytest.approx(report.implement.worked_m2, rel=0.05)
    assert lines["blade lifts"] >= 9  # for three crops and more, and at the end
    assert not report.safety.stops and not report.safety.noticed  # the draught is no fault
    assert report.tracking.xte_p95_m is not None and report.tracking.xte_p95_m < 0.04
    down = [tick for tick in read_ticks(out / "run.mcap") if tick.command.implement.is_on]
    assert all(tick.command.drive.v_mps > 0.0 for tick in down)
    assert {tick.command.implement.setpoints["depth_m"] for tick in down} == {0.02}
