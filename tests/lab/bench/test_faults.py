"""`agribot bench faults`: what it drives, how it goes on, and what its table says."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from agribot.app import simulated_run
from agribot.cli.main import main
from agribot.lab.bench import faults
from agribot.record.report import (
    FaultReport,
    Report,
    SafetyEvent,
    SafetyReport,
    TrackingReport,
)
from agribot.sim.faults.table import FAULTS

# At the start of a row's approach: three seconds are enough for all that is looked at here.
BRIEF = (
    faults.FaultScenario("gnss.outage", "farm"),
    faults.FaultScenario("bumper.contact", "farm"),
    faults.FaultScenario("start.aside=1", "farm"),
)


def test_every_fault_of_the_table_is_driven_and_no_scenario_twice() -> None:
    assert len(faults.SCENARIOS) >= 40
    assert len(set(faults.SCENARIOS)) == len(faults.SCENARIOS)
    driven = faults.choose_scenarios(faults.list_fault_names(), None)
    names = {scenario.fault.partition("=")[0] for scenario in driven if scenario.fault}
    assert names == {kind.name for kind in FAULTS}
    drives = {scenario.drive for scenario in driven}
    assert {scenario.drive for scenario in driven if not scenario.fault} == drives
    jobs = faults.list_jobs(driven, "1-2")  # checks the faults of all
    assert len({job.name for job in jobs}) == 2 * len(driven)
    assert [job.seed for job in jobs] == sorted(job.seed for job in jobs)


def test_scenarios_are_chosen_by_fault_and_camera() -> None:
    blind = faults.choose_scenarios(("gnss.outage",), False)
    assert {scenario.has_camera for scenario in blind} == {False}
    seeing = faults.choose_scenarios(("camera.off",), True)
    assert [scenario.name for scenario in seeing] == ["no fault", "camera.off"]


def test_a_campaign_is_driven_and_goes_on_where_it_was_interrupted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(faults, "SCENARIOS", BRIEF)
    monkeypatch.setattr(faults, "IN_ROW_S", {"farm": 8.0})
    monkeypatch.setattr(faults, "AFTER_S", 2.0)
    monkeypatch.setattr(faults, "PRESET", "kind")
    out = tmp_path / "out"
    words = ["bench", "faults", "--seeds", "1", "--workers", "1", "--out", str(out), "--json"]
    simulate, begun = simulated_run.simulate, []

    def interrupted(*arguments: object) -> object:
        begun.append(arguments)
        if len(begun) == 3:
            raise KeyboardInterrupt
        return simulate(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(simulated_run, "simulate", interrupted)
    assert main(words) == 130
    kept = {path: path.stat().st_mtime_ns for path in out.glob("results/*.json")}
    assert len(kept) == 2
    capsys.readouterr()
    assert main(words) == 0
    assert len(begun) == 3 + 2
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result == json.loads((out / "faults.json").read_text())
    assert (result["faults"], result["seeds"], result["missions_without_fault"]) == (3, 1, 1)
    bumper = next(row for row in result["rows"] if row["fault"] == "bumper.contact")
    assert (bumper["detected_ratio"], bumper["reaction"], bumper["named_ratio"]) == (
        1.0, "stopped", 1.0,
    )  # fmt: skip
    assert bumper["time_to_detect_s"] <= 0.02
    table = (out / "faults.md").read_text()
    assert table.splitlines()[0].startswith("| fault | drive |")
    assert len(table.splitlines()) == 2 + 4
    assert not list(out.glob("runs/*/*"))  # nobody reads them, and a drive can be repeated


def report(*found: FaultReport, crushed: int = 0, outside_m: float = 0.0) -> Report:
    return Report(
        profile="farm", seed=1, sensors="rtk", version="0", ok=False, reason="running",
        tracking=TrackingReport(plants_total=10, plants_crushed=crushed),
        safety=SafetyReport(
            faults=found, crushed_after_fault=crushed, outside_m_max=outside_m,
            stop_distance_m_max=0.1,
        ),
    )  # fmt: skip


def test_a_row_counts_what_was_noticed_over_its_seeds() -> None:
    scenario = faults.FaultScenario("gnss.jump=2", "farm")
    jobs = faults.list_jobs((scenario,), "1-3")
    seen = [
        FaultReport(name="gnss.jump", t_s=30.0, detected_s=30.0 + after_s, reaction="stopped",
                    reason=f"GNSS jumped by {after_s} m", is_named=True)
        for after_s in (1.0, 2.0)
    ]  # fmt: skip
    missed = FaultReport(name="gnss.jump", t_s=30.0)
    reports = {
        jobs[0].name: report(seen[0], outside_m=0.5),
        jobs[1].name: report(seen[1]),
        jobs[2].name: report(missed, crushed=3),
    }
    (row,) = faults.make_rows((scenario,), jobs, reports)
    assert (row.runs, row.detected_ratio, row.named_ratio) == (3, 2 / 3, 2 / 3)
    assert (row.time_to_detect_s, row.reaction, row.crushed_after) == (1.5, "stopped", 3)
    assert (row.outside_m_max, row.reason) == (0.5, "GNSS jumped by 1.0 m")
    result = faults.summarise_rows((row,), jobs, reports)
    assert result["crushed_after_detectable"] == 3
    assert result["crushed_ratio"] == pytest.approx(0.1)
    assert (result["false_stops"], result["missions_without_fault"]) == (0, 0)


def test_what_the_same_drive_tells_without_a_fault_is_no_sign_of_one() -> None:
    bad = faults.FaultScenario("gnss.jump=2", "farm")
    good = faults.FaultScenario("", "farm")
    jobs = faults.list_jobs((good, bad), "1")
    seen = FaultReport(name="gnss.jump", t_s=32.0, detected_s=33.0, reaction="stopped",
                       reason="off path by 0.6 m")  # fmt: skip
    usual = msgspec.structs.replace(
        report(), safety=SafetyReport(stops=(SafetyEvent(t_s=33.0, reason="off path by 0.7 m"),))
    )
    rows = faults.make_rows((good, bad), jobs, {jobs[0].name: usual, jobs[1].name: report(seen)})
    assert (rows[0].reaction, rows[1].detected_ratio) == ("1 false stops", 0.0)
    result = faults.summarise_rows(rows, jobs, {jobs[0].name: usual})
    assert (result["false_stops"], result["missions_without_fault"]) == (1, 1)


def test_two_sensors_may_lie_at_once_and_each_is_judged() -> None:
    pairs = [scenario for scenario in faults.SCENARIOS if scenario.also]
    assert pairs
    for pair in pairs:
        (job,) = faults.list_jobs((pair,), "1")
        assert len(job.config().faults) == 2
        assert pair.name == f"{pair.fault} and {pair.also}"


def test_real_firmware_is_tried_by_what_goes_wrong_at_the_board_and_below() -> None:
    names = faults.list_fault_names("firmware")
    assert {"wheels.stuck", "motor.runaway", "board.silent", "battery.empty"} <= {*names}
    assert not any(name.startswith(("gnss", "camera", "start")) for name in names)
    chosen = faults.choose_scenarios(names, has_camera=False, platform="firmware")
    assert all(job.config().platform == "firmware" for job in faults.list_jobs(chosen, "1"))
    assert any(not scenario.fault for scenario in chosen)


def test_wrong_names_seeds_and_workers_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for words, said in (
        (["--faults", "gnss.jump,gnss.moon"], "gnss.moon"),
        (["--seeds", "none"], "--seeds none"),
        (["--workers", "0"], "--workers 0"),
        (["--faults", "clock.step", "--camera"], "no scenario with a camera"),
    ):
        assert main(["bench", "faults", *words]) == 2
        assert said in capsys.readouterr().err
