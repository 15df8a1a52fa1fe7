"""The hoe in a whole run: weeds uprooted and crops spared, judged by the referee's truth."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.record.replay import read_ticks
from tests import nightly
from tests.mission.conftest import ALL_HZ, FEW_HZ, run_session, see_at


@pytest.mark.slow
@nightly.one_by_one("pictures_hz", (FEW_HZ, ALL_HZ), in_suite=1)
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
