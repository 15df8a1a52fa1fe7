"""A drive that an operator asked for is kept through a crash, and asked about before it goes on."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.facts import AtGoal, AwayFromWork, CutOff, OnErrandOf, OnVisit
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import Estimate, GoTo, MapPoint, Path, Visit
from tests.asking import ask
from tests.autonomy.plan.paper_task import PaperTask, PaperTasks
from tests.autonomy.plan.planting import MISSION, at
from tests.autonomy.plan.test_mission_errands import HEADLAND, NORTH, Drive, no_places, task
from tests.autonomy.plan.test_mission_states import Ride
from tests.robot_parts import plain_rover


def places(where: Sequence[MapPoint], name: str, bounds: FieldBounds | None) -> Task:
    def plan(here: Estimate) -> Path:
        return plan_waypoints(where, (here.x_map_m, here.y_map_m, NORTH), plain_rover(), MISSION)

    return PaperTask(plan, waypoints=where, name=name, bounds=bounds)


def no_plan(text: str) -> Task:
    raise AssertionError(f"{text} is no plan")


class Again(Drive):
    """The mission of a new run that goes on with a saved one, where the robot was left."""

    def __init__(self, mission: Mission) -> None:
        saved = mission.snapshot()
        assert saved is not None
        kept = msgspec.json.decode(msgspec.json.encode(saved), type=SavedMission)
        Ride.__init__(self, Mission(task(), MISSION, kept, PaperTasks(no_plan, places)))
        self.start = kept.pose[:2]
        self.first = self.settle()


def on_the_way_to_the_headland() -> tuple[Drive, tuple[float, float]]:
    drive = Drive()
    goal = drive.goto(drive.into_row(1), *HEADLAND)
    assert goal.path is not None
    drive.along(0.0, 0.5 * float(goal.path.s_m[-1]))
    return drive, drive.place(0.5 * float(goal.path.s_m[-1]))


def test_a_goto_waits_for_an_answer_drives_on_and_then_back_to_the_work() -> None:
    drive, where = on_the_way_to_the_headland()
    again = Again(drive.mission)
    assert again.first.status.state == "paused"
    assert again.first.max_speed_mps == 0.0
    assert again.first.status.fact == CutOff(OnErrandOf("goal", "Ada"))
    assert again.first.status.rows_done == (0,)
    assert Again(again.mission).first.status.fact == again.first.status.fact, "cut off again"
    goal = again.be_at(*where, "resume")
    assert (goal.status.state, goal.status.leg) == ("running", "to the goal")
    assert goal.path is not None
    assert goal.path.xy_map_m[-1] == pytest.approx(HEADLAND, abs=1e-6)
    assert again.to_the_end().status.fact == AtGoal("Ada")
    back = again.be_at(*HEADLAND, "resume")
    assert back.status.leg == "back to the work"
    again.to_the_end()
    work = again.mission.path
    assert work is not None and back.path is not None
    entered = again.be_at(*back.path.xy_map_m[-1])
    last = again.along(entered.s_m, float(work.s_m[-1]) + 0.02)[-1].status
    assert (last.state, last.rows_done) == ("done", (0, 1, 2))


def test_one_that_waited_at_its_goal_still_finds_back_to_the_work() -> None:
    drive, _ = on_the_way_to_the_headland()
    drive.to_the_end()
    again = Again(drive.mission)
    assert again.first.status.fact == CutOff(AwayFromWork())
    assert again.be_at(*HEADLAND, "resume").status.leg == "back to the work"


def test_the_way_home_is_asked_about_too_and_another_goal_takes_its_place() -> None:
    drive = Drive()
    where = drive.into_row(0)
    drive.be_at(*where, "return_home")
    drive.along(0.0, 0.4)
    here = drive.place(0.4)
    again = Again(drive.mission)
    assert again.first.status.fact == CutOff(OnErrandOf("home", "operator"))
    other = again.goto(here, *HEADLAND)
    assert other.status.leg == "to the goal"
    assert again.to_the_end().status.fact == AtGoal("Ada")


def test_a_visit_goes_on_with_the_places_that_are_left() -> None:
    drive = Ride(Mission(task(), MISSION, new_tasks=PaperTasks(no_plan, places)))
    drive.settle()
    event = ask(Visit(title="the traps", places_map_m=((-2.0, 3.0), (-2.0, 6.0))), "Bea")
    drive.mission.step(at(-2.0, 0.0, drive.t_s), [event])
    drive.settle()
    assert drive.mission.path is not None
    drive.along(0.0, 4.0)
    assert drive.mission.waypoints_reached == (True, False)
    again = Again(drive.mission)
    assert again.first.status.fact == CutOff(OnVisit("the traps"))
    assert again.first.status.state == "paused"
    goal = again.be_at(*again.start, "resume")
    assert (goal.status.state, goal.status.task) == ("running", "the traps")
    assert goal.status.waypoints_reached == 1
    path = again.mission.path
    assert path is not None
    last = again.along(goal.s_m, float(path.s_m[-1]) + 0.02)[-1].status
    assert (last.state, last.waypoints_reached) == ("done", 2)


def test_a_goto_before_any_work_is_kept_as_well() -> None:
    waits = msgspec.structs.replace(MISSION, waits_for_goals=True)
    drive = Ride(Mission(task(), waits, new_tasks=PaperTasks(no_plan, no_places)))
    drive.be_at(-2.0, 0.0)
    goto = ask(GoTo(x_map_m=-2.0, y_map_m=8.0), "Ada")
    drive.mission.step(at(-2.0, 0.0, drive.t_s), [goto])
    drive.be_at(-2.0, 0.0)
    drive.along(0.0, 2.0)
    saved = drive.mission.snapshot()
    assert saved is not None and saved.planned_from is None
    kept = msgspec.json.decode(msgspec.json.encode(saved), type=SavedMission)
    again = Ride(Mission(task(), waits, kept, PaperTasks(no_plan, no_places)))
    first = again.be_at(*kept.pose[:2])
    assert first.status.fact == CutOff(OnErrandOf("goal", "Ada"))
    goal = again.be_at(*kept.pose[:2], "resume")
    assert (goal.status.state, goal.status.leg) == ("running", "to the goal")
