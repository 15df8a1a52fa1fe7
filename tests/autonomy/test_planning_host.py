"""Long ways are worked out beside the loop: it goes on meanwhile, and a run repeats bit by bit."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from agribot.app.rerun import compare_passes, read_pass, rerun
from agribot.app.simulated_run import simulate
from agribot.autonomy.plan.coverage.area import FieldArea, PlanRequest
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.mission.planning import PlanningDesk
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.autonomy.planning_host import ThreadedPlanning
from agribot.core import config
from agribot.core.errors import MissionError
from agribot.core.facts import PlanningWay, Said
from agribot.core.messages import (
    AnyRequest,
    ControlMission,
    GoTo,
    TakePlan,
    TickRecord,
    Who,
)
from agribot.gis.plan_file import SavedPlan, format_plan
from tests.waiting import PATIENCE_S, wait_for

SETTINGS = [
    'world="empty"', "perception.enabled=false", "field.start_map_m=[0.0,0.0]",
    "field.start_yaw_deg=90.0", "mission.waits_for_goals=true", "duration_s=14.0",
]  # fmt: skip
AREA = FieldArea(
    boundary=((-6.0, -6.0), (30.0, -6.0), (30.0, 30.0), (-6.0, 30.0)),
    holes=(((10.0, 10.0), (14.0, 10.0), (14.0, 14.0), (10.0, 14.0)),),
)


def test_the_loop_goes_on_while_a_way_is_worked_out_and_has_it_at_its_time() -> None:
    host, may_end = ThreadedPlanning(), threading.Event()
    desk, found = PlanningDesk(host), list[str]()

    def work() -> str:
        assert may_end.wait(PATIENCE_S)
        return "the way"

    desk.ask(1.0, work, 0.5, found.append, lambda _: None)
    for tick in range(24):
        desk.look(1.0 + 0.02 * tick)  # comes back while the work goes on
    assert desk.is_busy and found == []
    may_end.set()
    desk.look(1.48)
    assert found == [], "never before its time, however fast it was"
    desk.look(1.5)
    assert found == ["the way"] and not desk.is_busy
    host.close()


def test_what_is_dropped_is_not_heard_of_and_a_refusal_is_told() -> None:
    host, said = ThreadedPlanning(), list[str]()

    def refuse() -> str:
        raise MissionError(Said("no way"))

    desk = PlanningDesk(host)
    desk.ask(0.0, lambda: "old", 0.1, said.append, lambda error: said.append(str(error)))
    desk.drop()
    assert not desk.is_busy
    desk.look(1.0)
    assert said == []
    desk.ask(1.0, refuse, 0.1, said.append, lambda error: said.append(str(error)))
    desk.look(1.1)
    assert said == [str(MissionError(Said("no way")))]
    desk.ask(2.0, lambda: "at once", 0.0, said.append, lambda _: None)
    assert said[-1] == "at once"
    host.close()


def test_where_time_goes_on_an_answer_that_is_late_is_waited_for_by_nobody() -> None:
    host, may_end = ThreadedPlanning(waits=False), threading.Event()
    host.ask(1.0, lambda: may_end.wait(PATIENCE_S), 0.1)
    assert (host.take(1.05), host.pop_late()) == (None, False)
    for t_s in (1.10, 1.12):
        assert (host.take(t_s), host.pop_late()) == (None, True)
    may_end.set()
    answer = wait_for(lambda: host.take(1.14), "the way")
    assert answer()
    host.close()


def test_a_replay_goes_without_an_answer_where_the_robot_did() -> None:
    host = ThreadedPlanning(late_s={1.10, 1.12})
    host.ask(1.0, lambda: "the way", 0.1)
    assert host.take(1.10) is None and host.take(1.12) is None
    answer = host.take(1.14)
    assert answer is not None and answer() == "the way"
    host.close()


def run(out: Path) -> list[TickRecord]:
    """A plan taken, begun, left for a place, and resumed, in a field with a hole."""
    settings = config.load("farm", SETTINGS)
    script = {2.0: "plan", 4.0: "resume", 7.5: "goto", 12.5: "resume"}
    with simulate(settings, out) as session:
        request = PlanRequest(implement_width_m=2.0, tool_x_m=session.robot.tool_x_m)
        shape = measure_footprint(session.robot, 2.0)
        plan = plan_field(AREA, shape, request)
        certificate = certify_plan(plan, AREA, shape, request)
        text = format_plan(SavedPlan(plan, AREA, request, settings.field.datum), certificate)
        what: dict[str, AnyRequest] = {
            "plan": TakePlan(geojson=text),
            "goto": GoTo(x_map_m=2.0, y_map_m=3.0),
            "resume": ControlMission(action="resume"),
        }
        ticks = []
        for record in session.ticks():
            ticks.append(record)
            action = script.get(round(record.batch.t_s, 2))
            if action is not None:
                session.inbox.post(what[action], Who("Ada"))
        session.finish()
    return ticks


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[TickRecord], Path]:
    out = tmp_path_factory.mktemp("runs")
    ticks, again = run(out / "one"), run(out / "two")
    assert [tick.command for tick in ticks] == [tick.command for tick in again]
    assert [tick.status for tick in ticks] == [tick.status for tick in again]
    return ticks, out / "one"


def test_the_robot_stands_while_it_plans_and_says_so(
    runs: tuple[list[TickRecord], Path],
) -> None:
    ticks, _ = runs
    told = list(dict.fromkeys((t.status.state, t.status.leg, t.status.fact) for t in ticks))
    legs = [leg for _, leg, _ in told]
    assert legs.index("checks the plan") < legs.index("stops first") < legs.index("to the goal")
    assert any(fact == PlanningWay() for _, _, fact in told)
    planning = [t for t in ticks if t.status.fact == PlanningWay()]
    assert len(planning) > 25  # half a second and more, in which the loop ticked
    assert all(t.command.drive.v_mps == 0.0 for t in planning)
    assert any(t.command.drive.v_mps > 0.2 for t in ticks)


def test_a_replay_has_the_same_commands_bit_by_bit(
    runs: tuple[list[TickRecord], Path],
) -> None:
    path = runs[1] / "run.mcap"
    before = read_pass(path)
    again, _ = rerun(path, config.load("farm", SETTINGS))
    assert compare_passes(before, again).first is None
    assert [t.status for t in before] == [t.status for t in again]
