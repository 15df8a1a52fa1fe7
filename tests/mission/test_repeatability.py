"""The same seed is the same run, and a recording is the run again."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import msgspec
import pytest

from agribot.cli.main import main
from agribot.record.replay import read_ticks
from agribot.record.report import Report, TimeReport
from tests import nightly
from tests.mission.conftest import ALL_HZ, FEW_HZ, ShortRun, run_session, see_at

FirstRun = Callable[[float, float], tuple[Path, Report]]
SEED = 7
SHORT, LONG = (10.2, FEW_HZ / 2.0), (25.0, ALL_HZ)  # seconds, and pictures in each


@pytest.fixture(scope="module")
def first_run(tmp_path_factory: pytest.TempPathFactory) -> FirstRun:
    """The first seconds of the farm mission with camera and network, driven once."""

    @cache
    def drive(seconds: float, pictures_hz: float) -> tuple[Path, Report]:
        out = tmp_path_factory.mktemp("first") / "run"
        settings = [f"duration_s={seconds}", f"seed={SEED}", see_at(pictures_hz)]
        return out, run_session("farm", settings, str(out))

    return drive


def without_times(report: Report) -> Report:
    """The parts of a report that a busy machine cannot change."""
    time = TimeReport(sim_s=report.time.sim_s, wall_s=0.0, cpu_s=0.0, rtf_cpu=0.0)
    perception = msgspec.structs.replace(report.perception, fps_cpu=None, latency_p95_s=None)
    return msgspec.structs.replace(report, time=time, perception=perception)


def test_the_same_seed_gives_the_same_report_and_the_same_commands(
    first_run: FirstRun, short_run: ShortRun
) -> None:
    seconds, pictures_hz = SHORT
    first_dir, first = first_run(seconds, pictures_hz)
    second_dir, second = short_run("second", f"seed={SEED}", see_at(pictures_hz), seconds=seconds)
    assert without_times(first) == without_times(second)
    first_commands = [tick.command for tick in read_ticks(first_dir / "run.mcap")]
    second_commands = [tick.command for tick in read_ticks(second_dir / "run.mcap")]
    assert len(first_commands) > 500
    assert first_commands == second_commands


def test_another_seed_gives_another_run(short_run: ShortRun) -> None:
    first_dir, _ = short_run("first", "seed=7", "perception.enabled=false", seconds=4.0)
    other_dir, _ = short_run("other", "seed=8", "perception.enabled=false", seconds=4.0)
    first = [tick.batch for tick in read_ticks(first_dir / "run.mcap")]
    other = [tick.batch for tick in read_ticks(other_dir / "run.mcap")]
    assert first != other


@nightly.one_by_one("drive", (SHORT, LONG), in_suite=1)
def test_replaying_a_recording_gives_bit_identical_commands(
    first_run: FirstRun, drive: tuple[float, float]
) -> None:
    out, _ = first_run(*drive)
    assert main(["replay", str(out / "run.mcap")]) == 0
