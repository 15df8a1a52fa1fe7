"""Sweeps: the same runs as one by one, resumable, with honest tables."""

from __future__ import annotations

import csv
import json
import socket
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from agribot.app.simulated_run import simulate
from agribot.cli.main import main
from agribot.core import config
from agribot.core.errors import ConfigError
from agribot.core.implement.row_shares import TreatedShare
from agribot.lab.sweep.execution import Assignment, RayExecutor, RunOutcome
from agribot.lab.sweep.plan import SweepJob, plan, read_seeds
from agribot.lab.sweep.tables import (
    SweepFolder,
    flatten,
    format_markdown,
    pooled_rms_m,
    summarise,
)
from agribot.record.report import Report, TimeReport, TrackingReport, WeedReport, read_report
from tests import nightly

SHORT = ("duration_s=2", "record.enabled=false", "perception.enabled=false")
FIXED = [word for setting in SHORT for word in ("--set", setting)]
PATIENCE_S = 300.0
VARIED = ["--vary", "sim.sensors=rtk,ideal", "--seeds", "1-2"]


def without_times(report: Report) -> Report:
    time = TimeReport(sim_s=report.time.sim_s)
    perception = msgspec.structs.replace(report.perception, fps_cpu=None, latency_p95_s=None)
    return msgspec.structs.replace(report, time=time, perception=perception)


def reports(folder: Path) -> dict[str, Report]:
    return {path.stem: read_report(path) for path in sorted(folder.glob("results/*.json"))}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four runs of two seconds, one after the other; too short to be good."""
    folder = tmp_path_factory.mktemp("sweep") / "out"
    assert main(["sweep", "farm", *FIXED, *VARIED, "--workers", "1", "--out", str(folder)]) == 1
    return folder


@nightly.by_day("test_every_run_of_a_sweep_is_the_run_it_would_be_alone")
def test_two_worker_processes_give_the_results_of_one(swept: Path, tmp_path: Path) -> None:
    words = [*FIXED, *VARIED, "--workers", "2", "--out", str(tmp_path / "out")]
    assert main(["sweep", "farm", *words]) == 1
    one, two = reports(swept), reports(tmp_path / "out")
    assert {name: without_times(report) for name, report in two.items()} == {
        name: without_times(report) for name, report in one.items()
    }
    assert all((tmp_path / "out" / "runs" / name / "report.html").is_file() for name in two)


def test_every_run_of_a_sweep_is_the_run_it_would_be_alone(swept: Path, tmp_path: Path) -> None:
    found = reports(swept)
    assert len(found) == 4
    for name, report in found.items():
        sensors = "rtk" if "rtk" in name else "ideal"
        settings = [*SHORT, f"sim.sensors={sensors}", f"seed={report.seed}"]
        with simulate(config.load("farm", settings), tmp_path / name) as session:
            for _ in session.ticks():
                pass
            alone = session.finish()
        assert without_times(report) == without_times(alone)
    # Without noise, seeds hardly matter this early; with it they do.
    assert len({report.estimate.pos_rms_m for report in found.values()}) >= 3


def test_the_tables_hold_what_the_reports_say(swept: Path) -> None:
    found = reports(swept)
    with (swept / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["run"] for row in rows] == list(found)
    for row in rows:
        report = found[row["run"]]
        assert float(row["mission.distance_m"]) == report.mission.distance_m
        assert row["weeds.f1"] == ""  # there was no camera: nothing, not 0
        assert row["sim.sensors"] == report.sensors
    summary = json.loads((swept / "sweep-report.json").read_text())["summary"]
    assert [entry["settings"] for entry in summary] == [
        {"sim.sensors": "rtk"},
        {"sim.sensors": "ideal"},
    ]
    driven_m = [float(r["mission.distance_m"]) for r in rows if r["sim.sensors"] == "ideal"]
    assert summary[1]["mean"]["mission.distance_m"] == pytest.approx(statistics.mean(driven_m))
    assert summary[1]["std"]["mission.distance_m"] == pytest.approx(statistics.stdev(driven_m))
    assert "weeds.f1" not in summary[1]["mean"]


def test_the_table_for_people_pools_the_missions_of_each_combination(swept: Path) -> None:
    table = (swept / "summary.md").read_text().splitlines()
    assert [line.split("|")[2].strip() for line in table[2:]] == [
        "sim.sensors=rtk",
        "sim.sensors=ideal",
    ]
    assert all("| 0 of 2 | 0 of 12 |" in line for line in table[2:])


def test_the_error_of_a_combination_is_that_of_all_its_missions_together() -> None:
    jobs = [SweepJob(name=n, profile="farm", seed=0, fixed=(), settings=()) for n in "abc"]
    empty = Report(profile="farm", seed=0, sensors="rtk", version="0", ok=True, reason="")
    found = {
        name: msgspec.structs.replace(
            empty,
            tracking=TrackingReport(xte_rms_m=rms_m, xte_max_m=max_m, plants_crushed=1),
            weeds=WeedReport(in_row=TreatedShare(of=4, treated=1, share=0.25)),
        )
        for name, rms_m, max_m in (("a", 0.01, 0.03), ("b", 0.07, 0.2))
    }
    (entry,) = summarise(jobs, found)
    assert pooled_rms_m(entry) == pytest.approx(0.05)
    (line,) = format_markdown([entry]).splitlines()[2:]
    assert "| 2 of 3 |" in line  # the third gave no report
    assert "| 5.0 cm | - | 20.0 cm | 2 | 2 of 8 | - |" in line


@pytest.mark.figures
def test_a_second_call_runs_only_what_is_missing(
    swept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = reports(swept)
    lost = swept / "results" / f"{list(before)[2]}.json"
    lost.unlink()
    kept = {path: path.stat().st_mtime_ns for path in swept.glob("results/*.json")}
    words = ["sweep", "farm", *FIXED, *VARIED, "--workers", "1", "--out", str(swept), "--json"]
    assert main(words) == 1
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (result["runs_done"], result["runs_total"]) == (4, 4)
    assert (swept / "runs" / lost.stem / "report.html").is_file()
    assert all(path.stat().st_mtime_ns == time_ns for path, time_ns in kept.items())
    after = reports(swept)
    assert {name: without_times(r) for name, r in after.items()} == {
        name: without_times(r) for name, r in before.items()
    }


def test_another_sweep_does_not_mix_into_the_folder(
    swept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", "farm", *FIXED, "--seeds", "1", "--out", str(swept)]) == 2
    assert "--out" in capsys.readouterr().err


def test_a_folder_takes_more_seeds_and_keeps_what_is_finished(tmp_path: Path) -> None:
    few = plan("farm", [1, 2], [], ["sim.sensors=rtk,ideal"])
    many = plan("farm", range(1, 12), [], ["sim.sensors=rtk,ideal"])
    first = SweepFolder(tmp_path, few)
    report = Report(profile="farm", seed=2, sensors="ideal", version="0", ok=True, reason="")
    first.keep(few[3], report)
    grown = SweepFolder(tmp_path, many)
    (name,) = grown.read_finished()
    (kept,) = (job for job in grown.jobs if job.name == name)
    assert (kept.seed, kept.settings) == (2, ("sim.sensors=ideal",))
    assert len({job.name for job in grown.jobs}) == len(many)
    assert SweepFolder(tmp_path, many).jobs == grown.jobs  # also when it is opened again
    assert set(SweepFolder(tmp_path, few).read_finished()) == {name}
    with pytest.raises(ConfigError, match="another sweep"):
        SweepFolder(tmp_path, plan("farm", [1, 99], [], ["sim.sensors=rtk,ideal"]))


def test_a_wrong_setting_is_refused_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["sweep", "farm", "--vary", "mission.speed_mps=0.4,9", "--out", str(out)]) == 2
    assert "mission.speed_mps" in capsys.readouterr().err
    assert not out.exists()


def test_a_run_that_cannot_start_is_told_apart_from_a_bad_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--set", "world=Nowhere", "--seeds", "1", "--workers", "1", "--json"]
    assert main(["sweep", "farm", *words, "--out", str(tmp_path / "out")]) == 1
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["runs_done"] == 0
    assert "Nowhere" in result["errors"]["1-seed=1"]


def test_every_seed_meets_every_combination() -> None:
    jobs = plan("farm", (4, 5), (), ("mission.speed_mps=0.3,0.4", "sim.sensors=rtk,ideal"))
    settings = {
        (j.config().mission.speed_mps, j.config().sim.sensors, j.config().seed) for j in jobs
    }
    assert len(jobs) == len(settings) == len({job.name for job in jobs}) == 8


@pytest.mark.parametrize(
    ("text", "seeds"), [("1-4", (1, 2, 3, 4)), ("7", (7,)), ("3,1-2,2", (3, 1, 2))]
)
def test_seeds_are_lists_and_ranges(text: str, seeds: tuple[int, ...]) -> None:
    assert read_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "4-1", "-1", "1-2-3", "1.5"])
def test_what_is_no_list_of_seeds_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="--seeds"):
        read_seeds(text)


def test_null_values_are_left_out_of_means() -> None:
    jobs = [SweepJob(name=n, profile="farm", seed=0, fixed=(), settings=()) for n in "ab"]
    first = Report(profile="farm", seed=0, sensors="rtk", version="0", ok=True, reason="")
    weeds = msgspec.structs.replace(first.weeds, f1=0.5)
    (entry,) = summarise(jobs, {"a": first, "b": msgspec.structs.replace(first, weeds=weeds)})
    assert (entry["mean"]["weeds.f1"], entry["count"]["weeds.f1"]) == (0.5, 1)
    assert entry["std"]["weeds.f1"] is None
    assert entry["mean"]["ok"] == 1.0
    assert flatten(first)["safety.stops"] == 0


def test_without_ray_the_option_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    assert main(["sweep", "farm", "--ray", "auto", "--out", str(tmp_path / "out")]) == 2
    assert "[sweep]" in capsys.readouterr().err


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Address of two nodes with one CPU each."""
    pytest.importorskip("ray")
    with subprocess.Popen(
        [sys.executable, "-m", "tests.lab.sweep.ray_cluster"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        yield process.stdout.readline().strip()
        process.stdin.close()


def sweep_on(cluster: str, out: Path, *words: str) -> dict[str, Any]:
    """The command in a process of its own, as Ray wants it: what it printed."""
    command = [sys.executable, "-m", "agribot.cli", "sweep", "farm", *FIXED, *words]
    done = subprocess.run(
        [*command, "--ray", cluster, "--out", str(out), "--json"],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 1, done.stderr  # too short to be good
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


@nightly.by_day(
    "test_every_run_of_a_sweep_is_the_run_it_would_be_alone",
    "test_a_node_that_fails_costs_its_run_alone",
    "test_a_cluster_that_does_not_answer_is_named",
)
def test_two_nodes_of_a_cluster_give_the_results_of_this_machine(
    swept: Path, cluster: str, tmp_path: Path
) -> None:
    result = sweep_on(cluster, tmp_path / "out", *VARIED)
    assert result["runs_done"] == 4
    here, there = reports(swept), reports(tmp_path / "out")
    assert {name: without_times(report) for name, report in there.items()} == {
        name: without_times(report) for name, report in here.items()
    }


class RayThatLosesANode(SimpleNamespace):
    """One task after another in this process; that of seed 2 runs out of memory."""

    def __init__(self) -> None:
        exceptions = SimpleNamespace(RayError=MemoryError)
        super().__init__(exceptions=exceptions, init=lambda address: None)

    def remote(self, function: Callable[..., RunOutcome]) -> SimpleNamespace:
        return SimpleNamespace(remote=lambda assignment: (function, assignment))

    def wait(self, tasks: list[Any], num_returns: int, timeout: float) -> tuple[Any, Any]:
        assert timeout > 0
        return tasks[:num_returns], tasks[num_returns:]

    def get(self, task: tuple[Callable[..., RunOutcome], Assignment]) -> RunOutcome:
        if task[1].job.seed == 2:
            raise MemoryError("Task was killed\nthe node was low on memory")
        return RunOutcome(job=task[1].job)


def test_a_node_that_fails_costs_its_run_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "ray", RayThatLosesANode())
    jobs = plan("farm", (1, 2, 3), (), ())
    assignments = [Assignment(job=job, out_dir=tmp_path) for job in jobs]
    outcomes = list(RayExecutor("auto").run(assignments, lambda: False))
    assert [outcome.job for outcome in outcomes] == list(jobs)
    assert [outcome.error for outcome in outcomes] == [
        "",
        "its node failed: the node was low on memory",
        "",
    ]


def test_a_cluster_that_does_not_answer_is_named() -> None:
    pytest.importorskip("ray")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
        with pytest.raises(ConfigError, match=f"{address}.*ray start --head"):
            RayExecutor(address)
