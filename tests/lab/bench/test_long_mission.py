"""`agribot bench long`: a plan as long as asked for, driven to its end and summed up."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import msgspec
import pytest

from agribot.app.field_work import read_work
from agribot.app.mission_file import read_mission
from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.autonomy.plan.mission.saved_mission import SavedErrand, SavedMission
from agribot.cli.main import main
from agribot.core.config import load
from agribot.core.fact_text import render
from agribot.core.facts import CameToBeCharged
from agribot.description.loader import load_robot
from agribot.lab.bench import long_mission
from agribot.lab.bench.long_mission import (
    ProgressLine,
    go_on,
    list_jobs,
    list_parts,
    make_plan,
)
from agribot.lab.sweep.execution import Assignment, RunOutcome
from agribot.record.report import Report
from tests import nightly

SHORT_KM = 0.02


@pytest.fixture
def small_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a field be smaller than the command takes one."""
    monkeypatch.setattr(long_mission, "LEAST_KM", SHORT_KM)
    monkeypatch.setattr(long_mission, "INSIDE_M", 2.0)


def assign(tmp_path: Path, *settings: str) -> Assignment:
    """A short mission, twice as fast as usual."""
    plan = tmp_path / "plan.geojson"
    plan.write_text(make_plan(SHORT_KM), encoding="utf-8")
    (job,) = list_jobs(SHORT_KM, plan, [1], speed_mps=0.8)
    brisk = "mission.turn_speed_mps=0.5", "sim.preset=kind"  # ground that is soon computed
    job = msgspec.structs.replace(job, fixed=(*job.fixed, *brisk, *settings))
    return Assignment(job=job, out_dir=tmp_path / "mission")


@pytest.mark.parametrize("km", [0.2, 30.0])
def test_a_plan_is_about_as_long_as_asked_for_and_a_mission_takes_it(km: float) -> None:
    work = read_work(make_plan(km), "the plan", load("farm"), load_robot())
    assert work.length_m / 1000.0 == pytest.approx(km, rel=0.25)
    path = work.plan_from((0.0, 0.0, 0.0))
    assert path.s_m[-1] >= work.length_m


@nightly.by_day(
    "test_a_mission_that_is_cut_off_twice_goes_on_and_is_one_job",
)
@pytest.mark.usefixtures("small_field")
def test_a_short_one_is_driven_to_its_end_and_is_not_driven_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["bench", "long", "--km", f"{SHORT_KM}", "--mps", "0.8", "--json"]
    words += ["--out", str(tmp_path / "out")]
    assert main(words) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["km"] == pytest.approx(SHORT_KM, rel=0.5)
    assert (result["missions"], result["interventions"]) == (1, 0)
    assert result["km_per_intervention"] is None
    assert result["outside_m_max"] == 0.0
    assert result["memory_mb"] > 0.0
    assert main(words) == 0
    again = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (again["km"], again["cpu_s"]) == (result["km"], result["cpu_s"])


@pytest.mark.usefixtures("small_field")
def test_a_mission_that_is_cut_off_twice_goes_on_and_is_one_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assignment = assign(tmp_path)
    now_s = itertools.count(100.0, 2.0)  # two seconds pass between looks
    monkeypatch.setattr(long_mission, "read_clock", lambda: next(now_s))
    describe_progress, said, come = (
        ProgressLine([assignment.out_dir, tmp_path / "not begun"]),
        [],
        [],
    )
    for _ in range(2):
        ticks = itertools.count()
        assert go_on(assignment, lambda ticks=ticks: next(ticks) == 900) is None  # type: ignore[misc]
        said += [describe_progress(), describe_progress(), describe_progress()]
        come.append(read_mission(list_parts(assignment.out_dir)[-1]))
    assert said[:2] == said[3:5] == ["", ""], "news come every five seconds"
    assert [path.name for path in list_parts(assignment.out_dir)] == ["mission", "mission.2"]
    outcome = go_on(assignment, lambda: False)
    assert outcome is not None and outcome.report is not None, outcome
    report = outcome.report
    assert report.ok, report.reason
    planned_m = read_work(make_plan(SHORT_KM), "the plan", load("farm"), load_robot()).length_m
    assert 0.0 < come[0].s_m < come[1].s_m
    length_km = planned_m / 1000.0
    told = [f"{saved.s_m / 1000.0:.2f} of {length_km:.2f} km" for saved in come]
    assert [text for text in said if text] == told
    way_m = report.mission.distance_m  # that to the first swath counts, too
    assert way_m == pytest.approx(planned_m, abs=8.0)


@nightly.by_day(
    "test_a_robot_that_a_whole_charge_brings_nowhere_ends_its_mission",
    "test_a_mission_that_is_cut_off_twice_goes_on_and_is_one_job",
)
@pytest.mark.usefixtures("small_field")
def test_a_robot_that_comes_home_for_its_battery_is_charged_and_finishes(tmp_path: Path) -> None:
    """The work takes more than 17 ten-thousandths of a charge, and this robot goes home earlier."""
    assignment = assign(tmp_path, "safety.low_charge_ratio=0.9983")
    outcome = go_on(assignment, lambda: False)
    assert outcome is not None and outcome.report is not None, outcome
    report, parts = outcome.report, list_parts(assignment.out_dir)
    assert report.ok, report.reason
    assert len(parts) > 1
    asked = [needed.reason for needed in report.safety.interventions]
    assert asked == [f"cancelled: {render(CameToBeCharged())}"] * (len(parts) - 1)


@pytest.mark.usefixtures("small_field")
def test_a_robot_that_a_whole_charge_brings_nowhere_ends_its_mission(tmp_path: Path) -> None:
    assignment = assign(tmp_path, "safety.low_charge_ratio=0.9999")
    outcome = go_on(assignment, lambda: False)
    assert outcome is not None and outcome.report is not None, outcome
    assert not outcome.report.ok
    assert render(CameToBeCharged()) in outcome.report.reason
    assert len(list_parts(assignment.out_dir)) > 1


@pytest.mark.usefixtures("small_field")
def test_a_robot_that_every_charge_brings_a_little_farther_is_charged_so_often_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would have been charged for ever."""
    assignment, driven = assign(tmp_path), 0
    report = Report(profile="farm", seed=1, sensors="rtk", version="", ok=False, reason="charge")

    def drive(*_: object) -> RunOutcome:
        nonlocal driven
        driven += 1
        return RunOutcome(job=assignment.job, report=report)

    def read(_: Path) -> SavedMission:
        return SavedMission(
            task="", state="cancelled", t_s=0.0, planned_from=None, pose=(0.0, 0.0, 0.0),
            length_m=100.0, s_m=0.001 * driven, row=-1, rows=(),
            errand=SavedErrand(to=ErrandKind.CHARGE, source="the battery"),
        )  # fmt: skip

    monkeypatch.setattr(long_mission, "drive_run", drive)
    monkeypatch.setattr(long_mission, "_read_last", read)
    assert go_on(assignment, lambda: False) is not None
    assert driven == 1 + long_mission.MOST_CHARGES


def test_a_way_that_no_mission_holds_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for km in ("0", "1000"):
        assert main(["bench", "long", "--km", km, "--out", str(tmp_path)]) == 2
        assert f"--km {km}: out of range; give" in capsys.readouterr().err
