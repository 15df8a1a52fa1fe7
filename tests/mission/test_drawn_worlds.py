"""Missions in worlds that are not as their map says."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from agribot.app.simulated_run import simulate
from agribot.cli.main import main
from agribot.core.config import load
from agribot.core.facts import MayBeOffRow
from agribot.core.row_shape import project_on_row
from agribot.record import run_files
from agribot.record.report import Report
from tests import nightly
from tests.finding import holds

UNSEEN = ("perception.enabled=false", "record.enabled=false")
BLIND = (*UNSEEN, "sim.sensors='ideal'")


def _drive(folder: Path, preset: str, seconds: float, seed: int = 1) -> Report:
    config = load(
        "farm",
        [*BLIND, f"sim.preset={preset}", f"duration_s={seconds}", f"seed={seed}"],
    )
    with simulate(config, folder) as run:
        for _ in run.ticks():
            pass
        return run.finish()


def test_the_cross_track_error_is_that_against_the_plants_and_not_against_the_map(
    tmp_path: Path,
) -> None:
    preset = tmp_path / "off.toml"
    preset.write_text('about = "the map is off"\nmap_offset_std_m = 0.1\n')
    report = _drive(tmp_path / "run", str(preset), 40.0, seed=2)
    with simulate(load("farm", [*BLIND, f"sim.preset={preset}", "seed=2"]), tmp_path / "b") as run:
        first = run.rows[0]
        crop = run.world.plants[0]
    off_m = abs(float(project_on_row(first, crop.x_map_m, crop.y_map_m).left_m))
    assert off_m > 0.03
    assert report.tracking.xte_rms_m == pytest.approx(off_m, abs=0.01)


@nightly.by_day(
    "tests/autonomy/estimate/test_soft_turns.py::"
    "test_wheels_that_lose_half_their_way_in_turns_do_not_speak_against_the_fixes"
)
@pytest.mark.parametrize("seed", [5, 19])
def test_way_lost_in_turns_on_soil_is_no_reason_to_doubt_a_good_receiver(
    tmp_path: Path, seed: int
) -> None:
    config = load(
        "farm",
        [*UNSEEN, "sim.preset=field", "duration_s=35", f"seed={seed}"],
    )
    with simulate(config, tmp_path) as run:
        records = list(run.ticks())
    assert records[-1].status.row == 0
    assert not [r for r in records if holds(r.status.fact, MayBeOffRow)]


@nightly.by_day(
    "tests/autonomy/estimate/test_soft_turns.py::"
    "test_a_receiver_that_falls_silent_in_a_soft_turn_vouches_for_nothing",
    "tests/autonomy/estimate/test_soft_turns.py::"
    "test_a_robot_that_turns_about_a_wheel_that_a_clod_holds_keeps_its_heading",
)
def test_a_turn_on_soil_without_a_fix_leaves_the_filter_where_the_robot_is(
    tmp_path: Path,
) -> None:
    """The receiver of this seed is silent for eight seconds of its first turn."""
    config = load("farm", [*UNSEEN, "sim.preset=field", "duration_s=72", "seed=8"])
    with simulate(config, tmp_path) as run:
        apart_m = []
        for record in run.ticks():
            if record.batch.t_s > 58.0:
                truth, pose = run.simulator.truth(), record.estimate
                apart_m.append(
                    math.dist((truth.x_map_m, truth.y_map_m), (pose.x_map_m, pose.y_map_m))
                )
    assert max(apart_m) < 0.22  # 0.26 where the filter believes the wheels


@pytest.mark.figures
def test_a_run_on_the_field_preset_reports_what_was_drawn_and_repeats_bit_by_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = _drive(tmp_path / "a", "field", 3.0)
    for name in ("write_page", "write_map"):
        monkeypatch.setattr(run_files, name, lambda *_: None)  # one report is enough
    again = _drive(tmp_path / "b", "field", 3.0)
    other = _drive(tmp_path / "c", "field", 3.0, seed=2)
    assert first.preset == "field" and first.conditions
    assert first.conditions == again.conditions != other.conditions
    assert first.tracking == again.tracking and first.estimate == again.estimate
    page = (tmp_path / "a" / "report.html").read_text()
    assert "preset field" in page and "soil class" in page


def test_the_kind_preset_is_told_and_draws_nothing(tmp_path: Path) -> None:
    report = _drive(tmp_path / "a", "kind", 1.0)
    assert (report.preset, report.conditions) == ("kind", None)


def test_the_command_line_takes_a_preset_and_refuses_an_unknown_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "farm", "--set", "perception.enabled=false", "--out", str(tmp_path / "a")]
    assert main([*words, "--preset", "feild"]) == 2
    assert "unknown preset 'feild'; did you mean 'field'?" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()
    assert main([*words, "--preset", "field", "--for", "1", "--json"]) == 1
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["preset"] == "field"
    assert report["conditions"]["soil_class"] in ("firm", "tilled")
