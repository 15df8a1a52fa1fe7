"""The same seed is the same run, and a recording is the run again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec

from agribot.cli.main import main
from agribot.record.replay import read_ticks
from agribot.record.report import Report, TimeReport

ShortRun = Callable[..., tuple[Path, Report]]


def without_times(report: Report) -> Report:
    """The parts of a report that a busy machine cannot change."""
    time = TimeReport(sim_s=report.time.sim_s, wall_s=0.0, cpu_s=0.0, rtf_cpu=0.0)
    perception = msgspec.structs.replace(report.perception, fps_cpu=None, latency_p95_s=None)
    return msgspec.structs.replace(report, time=time, perception=perception)


def test_the_same_seed_gives_the_same_report_and_the_same_commands(short_run: ShortRun) -> None:
    first_dir, first = short_run("first", "seed=7")
    second_dir, second = short_run("second", "seed=7")
    assert without_times(first) == without_times(second)
    first_commands = [tick.command for tick in read_ticks(first_dir / "run.mcap")]
    second_commands = [tick.command for tick in read_ticks(second_dir / "run.mcap")]
    assert len(first_commands) > 500
    assert first_commands == second_commands


def test_another_seed_gives_another_run(short_run: ShortRun) -> None:
    first_dir, _ = short_run("first", "seed=7", "perception.enabled=false")
    other_dir, _ = short_run("other", "seed=8", "perception.enabled=false")
    first = [tick.batch for tick in read_ticks(first_dir / "run.mcap")]
    other = [tick.batch for tick in read_ticks(other_dir / "run.mcap")]
    assert first != other


def test_replaying_a_recording_gives_bit_identical_commands(short_run: ShortRun) -> None:
    out, _ = short_run("run", "seed=3", seconds=25.0)
    assert main(["replay", str(out / "run.mcap")]) == 0
