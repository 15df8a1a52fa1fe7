"""`agribot bench faults`: what it drives, how it goes on, and what its table says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from agribot.app import simulated_run
from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.lab.bench import faults
from agribot.lab.bench.fault_rows import make_rows, summarise_rows
from agribot.lab.bench.fault_tables import describe_result, format_table, rewrite_block
from agribot.record.report import (
    CrushedWhen,
    CrushReport,
    FaultReport,
    MissionReport,
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
    page = tmp_path / "page.md"
    page.write_text("# Measured\n<!-- campaign: no camera -->\n<!-- end of no camera -->\n")
    words = ["bench", "faults", "--seeds", "1", "--workers", "1", "--out", str(out), "--json",
             "--no-camera", "--markdown", str(page)]  # fmt: skip
    simulate, begun = simulated_run.simulate, []

    def interrupted(*arguments: object) -> object:
        begun.append(arguments)
        if len(begun) == 3:
            raise KeyboardInterrupt
        return simulate(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(simulated_run, "simulate", interrupted)
    assert main(words) == 130
    assert "| fault |" not in page.read_text()
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
    rows = page.with_suffix(".csv").read_text().splitlines()
    assert rows[0].startswith("campaign,fault,drive,") and len(rows) == 1 + 4
    assert "no camera,bumper.contact,farm rtk,1,100 %" in "\n".join(rows)
    assert "bumper.contact" not in page.read_text()  # noticed in every run: in the CSV file only
    assert "| `start.aside=1` | farm rtk | 1 | 0 % |" in page.read_text()
    assert "`agribot bench faults --seeds 1 --no-camera`: Of 3 faults" in page.read_text()
    assert not list(out.glob("runs/*/*"))  # not needed, since a drive can be repeated


def crush(t_s: float, when: CrushedWhen) -> CrushReport:
    return CrushReport(t_s=t_s, by="wheel", when=when)


def report(
    *found: FaultReport, crushes: tuple[CrushReport, ...] = (), outside_m: float = 0.0,
    across_m: float = 0.04, rolled_m: float = 0.1, too_long: int = 0,
) -> Report:  # fmt: skip
    return Report(
        profile="farm", seed=1, sensors="rtk", version="0", ok=False, reason="running",
        mission=MissionReport(distance_m=250.0),
        tracking=TrackingReport(
            plants_total=10, plants_crushed=len(crushes), xte_p95_m=0.8 * across_m,
            xte_max_m=across_m,
        ),
        safety=SafetyReport(
            faults=found, crushed_after_fault=len(crushes), crushes=crushes,
            outside_m_max=outside_m, stop_distance_m_max=rolled_m, stop_allowed_m=0.13,
            stops_too_long=too_long,
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
        jobs[2].name: report(missed, crushes=(crush(31.0, "before_detection"),) * 3),
    }
    (row,) = make_rows((scenario,), jobs, reports)
    assert (row.runs, row.detected_ratio, row.named_ratio) == (3, 2 / 3, 2 / 3)
    assert (row.time_to_detect_s, row.reaction, row.crushed_after) == (1.5, "stopped", 3)
    assert (row.outside_m_max, row.reason) == (0.5, "GNSS jumped by 1.0 m")
    result = summarise_rows((row,), jobs, reports)
    assert (result["detected_ratio"], result["harmless"]) == (2 / 3, 0)
    assert result["crushed_after_detectable"] == 0  # it could not have known so soon
    assert result["crushed_ratio"] == pytest.approx(0.1)
    assert (result["false_stops"], result["missions_without_fault"]) == (0, 0)


def test_what_the_same_drive_tells_without_a_fault_is_no_sign_of_one() -> None:
    bad = faults.FaultScenario("gnss.jump=2", "farm")
    good = faults.FaultScenario("", "farm")
    jobs = faults.list_jobs((good, bad), "1")
    seen = FaultReport(name="gnss.jump", t_s=32.0, detected_s=33.0, reaction="stopped",
                       reason="off path by 0.6 m", code="off_path")  # fmt: skip
    usual = msgspec.structs.replace(
        report(),
        safety=SafetyReport(
            stops=(SafetyEvent(t_s=33.0, reason="off path by 0.7 m", code="off_path"),)
        ),
    )
    rows = make_rows((good, bad), jobs, {jobs[0].name: usual, jobs[1].name: report(seen)})
    assert (rows[0].reaction, rows[1].detected_ratio) == ("1 false stops", 0.0)
    result = summarise_rows(rows, jobs, {jobs[0].name: usual})
    assert (result["false_stops"], result["missions_without_fault"]) == (1, 1)
    assert result["km_without_fault"] == 0.25


BAD, GOOD = faults.FaultScenario("gnss.jump=2", "farm"), faults.FaultScenario("", "farm")


def judge_one(bad: Report, scenario: faults.FaultScenario = BAD) -> dict[str, Any]:
    """Judge one run with a fault beside one without."""
    jobs = faults.list_jobs((GOOD, scenario), "1")
    reports = {jobs[0].name: report(), jobs[1].name: bad}
    return summarise_rows(make_rows((GOOD, scenario), jobs, reports), jobs, reports)


def test_a_small_fault_that_changes_nothing_is_harmless_and_not_missed() -> None:
    missed = FaultReport(name="gnss.jump", t_s=30.0)
    for bad, is_harmless in (
        (report(missed, across_m=0.06), True),  # twice the usual 95 % are 6.4 cm
        (report(missed, across_m=0.07), False),
        (report(missed, outside_m=0.1), False),
        (report(missed, crushes=(crush(31.0, "before_detection"),)), False),
        (report(missed, crushes=(crush(30.1, "by_fault"),)), True),
    ):
        result = judge_one(bad)
        assert result["harmless"] == is_harmless
        assert (result["detected_ratio"], result["named_ratio"]) == (0.0, 0.0)
    seen = FaultReport(name="gnss.jump", t_s=30.0, detected_s=31.0, reaction="stopped",
                       reason="GNSS jumped", is_named=True)  # fmt: skip
    assert judge_one(report(seen))["harmless"] == 0
    assert judge_one(report(seen))["harmful_detected_ratio"] == 1.0


def test_what_was_crushed_counts_by_when_the_robot_knew_or_could_have_known() -> None:
    seen = FaultReport(name="gnss.jump", t_s=30.0, detected_s=31.0, reaction="stopped",
                       reason="GNSS jumped", is_named=True)  # fmt: skip
    missed = FaultReport(name="gnss.jump", t_s=30.0)
    early, late = crush(30.5, "before_detection"), crush(31.5, "after_detection")
    set_down, last = crush(31.5, "by_fault"), crush(38.0, "before_detection")
    for bad, scenario, count in (
        (report(seen, crushes=(early, late, set_down)), BAD, 1),
        (report(missed, crushes=(early, last)), BAD, 1),
        (report(missed, crushes=(early, last)), BAD._replace(is_detectable=False), 0),
        (report(missed, crushes=(early, last)), BAD._replace(fault="gnss.drift=0.05"), 0),
    ):
        assert judge_one(bad, scenario)["crushed_after_detectable"] == count
    jobs = faults.list_jobs((BAD,), "1")
    rows = make_rows((BAD,), jobs, {jobs[0].name: report(seen, crushes=(early, late, set_down))})
    assert "3: 1 before noticed, 1 until at rest, 1 set down on" in format_table(rows)


def test_a_stop_that_takes_longer_than_the_drive_promises_is_told() -> None:
    seen = FaultReport(name="gnss.jump", t_s=30.0, detected_s=31.0, reaction="stopped")
    jobs = faults.list_jobs((BAD,), "1-2")
    reports = {jobs[0].name: report(seen), jobs[1].name: report(seen, rolled_m=0.4, too_long=1)}
    rows = make_rows((BAD,), jobs, reports)
    assert "| 0.40 m | 0.13 m, not kept 1 times |" in format_table(rows)
    assert "1 stops took more than the drive promises" in describe_result(
        summarise_rows(rows, jobs, reports)
    )


def test_drives_without_a_fault_take_turns_until_there_are_enough() -> None:
    drives, jobs = faults.list_drives(7, None)
    assert len(jobs) == 7 > len(drives) >= 3
    assert not any(drive.fault or drive.has_camera for drive in drives)
    assert not any(job.config().faults for job in jobs)
    assert {job.seed for job in jobs} == {1, 2}
    (row, *_) = make_rows(drives, jobs, {jobs[0].name: report()})
    told = describe_result(summarise_rows((row,), jobs, {jobs[0].name: report()}))
    assert told == "1 drives without a fault, 0.25 km, saw 0 false stops.\n"


def test_the_special_cases_are_all_among_the_scenarios_with_and_without_a_camera() -> None:
    for has_camera in (False, True):
        chosen = faults.choose_scenarios(
            faults.list_fault_names(), has_camera, is_special=True
        )  # fmt: skip
        assert {*faults.SPECIAL} <= {scenario.fault for scenario in chosen}
        assert any(scenario.also for scenario in chosen)


def test_a_table_takes_its_place_on_a_page_and_nothing_else_changes() -> None:
    page = "# A\n<!-- campaign: x -->\nold\n<!-- end of x -->\ntail <!-- end of y -->\n"
    once = rewrite_block(page, "x", "new | table\n")
    assert once == (
        "# A\n<!-- campaign: x -->\n\nnew | table\n\n<!-- end of x -->\ntail <!-- end of y -->\n"
    )
    assert rewrite_block(once, "x", "new | table\n") == once
    with pytest.raises(ConfigError, match="campaign: y"):
        rewrite_block(page, "y", "")


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
        (["--faults", "clock.step", "--camera"], "no scenario with a camera"),
        (["--fault-free", "0"], "--fault-free 0"),
        (["--fault-free", "9", "--special"], "leave out --faults, --special"),
        (["--markdown", "no/page.md", "--no-camera"], "--markdown no/page.md"),
        (["--markdown", "no/page.md", "--in-row"], "give --camera or --no-camera"),
        (["--shard", "1/2", "--special"], "--all and --shard are of the matrix"),
    ):
        assert main(["bench", "faults", *words]) == 2
        assert said in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["bench", "faults", "--workers", "0"])
    assert "--workers: 0: " in capsys.readouterr().err
