"""What a builder's motors are is kept in the robot's file, and counts in its next run."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.cli.run.run_settings import add_setting_arguments, read_settings

PARTS_LIST = ["--counts-per-turn", "2048", "--full-speed-rpm", "80"]


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path))


def test_motors_are_kept_as_rad_per_second_and_ohm_and_are_those_of_the_next_run(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["calibrate", "motors", *PARTS_LIST, "--stall-current-a", "10", "--json"]
    assert main(words) == 0
    kept = json.loads(capsys.readouterr().out)
    assert (kept["counts_per_turn"], kept["winding_ohm"]) == (2048.0, 2.4)
    parser = argparse.ArgumentParser()
    add_setting_arguments(parser)
    read = read_settings(parser.parse_args(["hardware"])).calibration
    assert read.full_speed_radps == pytest.approx(8.378, abs=1e-3)
    assert (read.counts_per_turn, read.winding_ohm) == (2048.0, 2.4)


def test_a_winding_that_nobody_knows_is_not_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", "motors", *PARTS_LIST]) == 0
    assert "winding not stated" in capsys.readouterr().err
    assert "winding" not in (tmp_path / "robots" / "agribot.toml").read_text()


@pytest.mark.parametrize("words", [[], PARTS_LIST[:2], [*PARTS_LIST[:3], "0"]])
def test_motors_that_are_half_stated_or_cannot_be_are_refused(
    words: list[str], tmp_path: Path
) -> None:
    with pytest.raises(SystemExit) as refusal:
        main(["calibrate", "motors", *words])
    assert refusal.value.code == 2
    assert not (tmp_path / "robots").exists()
