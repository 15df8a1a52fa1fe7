"""What an operator sends a simulated robot under way: places, plans, marks; and its replay."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from pathlib import Path
from unittest.mock import ANY

import pytest

from agribot.app.field_work import plan_field_file
from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.cli.main import main
from agribot.core import config
from agribot.core.facts import AtGoal, BeyondFence, ErrandRefused, NewTask, RobotDrives, TaskRefused
from agribot.core.messages import (
    AnyRequest,
    ControlMission,
    ControlRecording,
    MarkMoment,
    TakePlan,
    TickRecord,
    Who,
)
from agribot.gis.plan_file import format_plan
from agribot.record.replay import read_ticks
from tests import nightly
from tests.asking import go_to
from tests.finding import holds, is_like

SETTINGS = ["perception.enabled=false", "seed=1", "field.row_count=1", "field.row_length_m=3"]
GOAL = (-1.0, 5.0)
FIELD = Path(__file__).parents[2] / "examples" / "field.geojson"

Script = dict[float, AnyRequest]


def drive(out: Path, script: Script, settings: list[str], until: Callable[[TickRecord], bool],
          ) -> SimulatedRun:  # fmt: skip
    """Post each event at its time; the session that came to its end."""
    with simulate(config.load("farm", [*SETTINGS, *settings]), out) as session:
        for record in session.ticks():
            asked = script.get(round(record.batch.t_s, 2))
            if asked is not None:
                session.inbox.post(asked, Who("Ada"))
            if until(record):
                break
        session.finish()
    return session


def table_rows(folder: Path) -> int:
    """Crop rows that the page of a report lists."""
    page = (folder / "report.html").read_text()
    return page.partition("<h2>Rows</h2>")[2].partition("<h2>")[0].count("<tr>") - 1


def is_done(record: TickRecord) -> bool:
    return record.status.state == "done"


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> tuple[SimulatedRun, Path]:
    """Sent to a place while it drives to its row, marked there, then back to its work."""
    out = tmp_path_factory.mktemp("runs") / "first"
    script: Script = {
        4.0: go_to((40.0, 40.0)),
        7.0: go_to((*GOAL, 0.0)),
        8.0: MarkMoment(text="a stone"),
        30.0: ControlRecording(action="stop"),
        31.0: ControlRecording(action="start"),
        32.0: ControlMission(action="resume"),
    }
    return drive(out, script, ["duration_s=110"], is_done), out


@pytest.mark.figures
def test_it_drives_to_the_place_stops_there_and_then_does_its_work(
    sent: tuple[SimulatedRun, Path],
) -> None:
    session, out = sent
    waiting = [t for t in read_ticks(out / "run.mcap") if isinstance(t.status.fact, AtGoal)]
    here = waiting[-1].estimate
    assert math.dist((here.x_map_m, here.y_map_m), GOAL) < 0.1
    assert abs(here.yaw_map_rad) < 0.1
    assert here.v_mps == pytest.approx(0.0, abs=0.01)
    assert session.last is not None and session.last.status.state == "done"
    assert session.last.status.rows_done == (0,)


@pytest.mark.figures
def test_every_request_and_refusal_is_told(sent: tuple[SimulatedRun, Path]) -> None:
    session, out = sent
    events = session.event_log.events
    refused = ErrandRefused("goal", BeyondFence(40.0, 40.0, ANY))
    assert any(is_like(event.fact, refused) for event in events)
    assert any(event.reason.startswith("goto -1.000, 5.000") for event in events)
    report = json.loads((out / "report.json").read_text())
    (mark,) = report["marks"]
    assert mark["reason"] == "a stone (Ada)"
    assert mark["t_s"] == pytest.approx(8.0, abs=0.1)
    assert "a stone" in (out / "report.html").read_text()


@pytest.mark.figures
def test_a_replay_repeats_it_bit_by_bit(sent: tuple[SimulatedRun, Path]) -> None:
    assert main(["replay", str(sent[1] / "run.mcap")]) == 0


def test_a_recording_ends_and_begins_when_asked(
    sent: tuple[SimulatedRun, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    _, out = sent
    first = [tick.batch.t_s for tick in read_ticks(out / "run.mcap")]
    later = [tick.batch.t_s for tick in read_ticks(out.with_name("first-2") / "run.mcap")]
    assert first[-1] == pytest.approx(30.0, abs=0.05)
    assert later[0] == pytest.approx(31.0, abs=0.05)
    assert main(["replay", str(out.with_name("first-2") / "run.mcap")]) == 2
    assert "can only be run again from its start on" in capsys.readouterr().err
    assert main(["report", str(out.with_name("first-2") / "run.mcap"), "-o", str(out / "r")]) == 0


@pytest.mark.figures
def test_another_plan_replaces_the_mission_and_is_judged_in_its_place(tmp_path: Path) -> None:
    settings = config.load("farm", SETTINGS)
    with simulate(settings, tmp_path / "probe") as session:
        plan, certificate = plan_field_file(FIELD, settings, session.robot, None)
    assert certificate.ok
    text = format_plan(plan, certificate)
    out = tmp_path / "run"
    script: Script = {
        5.0: TakePlan(geojson=text),
        6.0: ControlMission(action="pause"),
        8.0: TakePlan(geojson=text),
        9.0: ControlMission(action="resume"),
    }
    session = drive(out, script, ["duration_s=14"], is_done)
    told = [event.fact for event in session.event_log.events]
    assert TaskRefused("plan", RobotDrives()) in told
    assert any(holds(fact, NewTask("plan", "Ada")) for fact in told)
    assert session.last is not None
    assert session.last.status.rows_total == len(session.rows) > 1
    assert json.loads((out / "report.json").read_text())["mission"]["rows_total"] > 1
    assert config.load(str(out / "config.toml")).plan == str(out / "plan.geojson")
    assert main(["report", str(out / "run.mcap"), "-o", str(out / "again")]) == 0
    assert table_rows(out / "again") == table_rows(out) == len(session.rows)
    assert main(["replay", str(out / "run.mcap")]) == 0


@nightly.by_day(
    "tests/autonomy/plan/test_visits.py::"
    "test_a_mission_that_has_ended_begins_once_more_from_where_the_robot_stands"
)
def test_a_robot_that_has_done_its_work_does_it_once_more(tmp_path: Path) -> None:
    settings = config.load("farm", [*SETTINGS, "duration_s=110"])
    with simulate(settings, tmp_path / "run") as session:
        for _ in session.ticks():
            pass
        report = session.finish()
        session.inbox.post(ControlMission(action="start"), Who("Ada"))
        again = [next(record for record in session.idle() if record.status.state == "running")]
        again += itertools.takewhile(lambda record: not is_done(record), session.idle())
        next(iter(session.idle()))
        assert session.recording.name == "", "the recording ends with the mission"
        truth = session.simulator.truth()
    assert report.ok, report.reason
    assert again[0].status.rows_done == ()
    assert again[-1].status.rows_done == (0,)
    x_m, y_m = session.rows[0].start_map_m  # there it began the first time
    assert math.dist((truth.x_map_m, truth.y_map_m), (x_m, y_m)) < 1.5
    recorded = [tick.batch.t_s for tick in read_ticks(tmp_path / "run-2" / "run.mcap")]
    assert recorded[0] <= again[0].batch.t_s
    assert recorded[-1] >= again[-1].batch.t_s
