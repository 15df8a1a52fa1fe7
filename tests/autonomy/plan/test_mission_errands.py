"""Places on demand: stop, plan from there, drive there, and find back to the work."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.boustrophedon import plan_home, plan_rows
from agribot.autonomy.plan.ways.certify import certify
from agribot.autonomy.plan.ways.curves import Place
from agribot.autonomy.plan.ways.goal_way import make_fence, plan_to_place
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.errors import MissionError
from agribot.core.facts import (
    AtGoal,
    BeyondFence,
    CancelledBy,
    ErrandRefused,
    Fact,
    GoalNotFinite,
    NewTask,
    NoWayOffCrop,
    OnCropThere,
    ReturnedHome,
    RobotDrives,
    Said,
    StopHolds,
    StopsForGoal,
    StopsToReturn,
    TaskRefused,
)
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import (
    ChangeSetting,
    ControlMission,
    Estimate,
    Goal,
    MapPoint,
    Path,
    RequestEvent,
    TakePlan,
)
from tests.asking import ask, go_to
from tests.autonomy.plan.paper_task import PaperTask, PaperTasks
from tests.autonomy.plan.planting import MISSION, at, point_at
from tests.autonomy.plan.test_mission_states import Ride
from tests.robot_parts import plain_rover

ROWS = lay_rows(FieldConfig(row_count=3, row_length_m=4.0))
ENDS = [end for row in ROWS for end in (row.start_map_m, row.end_map_m)]
HEADLAND = (2.0, 8.0)
NORTH = math.pi / 2


def task(rows_taken: int = 3) -> Task:
    rows = ROWS[:rows_taken]

    def go_to(here: Estimate, goal: Place) -> Path:
        start = (here.x_map_m, here.y_map_m, NORTH)
        fence = make_fence([*ENDS, start[:2]], 5.0)
        return plan_to_place(goal, start, rows, fence, plain_rover(), MISSION)

    return PaperTask(
        lambda here: plan_rows(rows, (here.x_map_m, here.y_map_m, NORTH), plain_rover(), MISSION),
        rows,
        home=lambda here, pose, _: plan_home(
            rows, (here.x_map_m, here.y_map_m, NORTH), (*pose[:2], NORTH), plain_rover(), MISSION
        ),
        go_to=go_to,
    )


def no_places(places: Sequence[MapPoint], name: str, bounds: FieldBounds | None) -> Task:
    raise AssertionError(f"{name} is no visit")


class Drive(Ride):
    """Rides along whatever path the mission wants, and may be asked for places."""

    def __init__(self) -> None:
        super().__init__(
            Mission(task(), MISSION, new_tasks=PaperTasks(lambda text: task(int(text)), no_places))
        )
        self.settle()

    def ask(self, x_m: float, y_m: float, event: RequestEvent, v_mps: float = 0.0) -> Goal:
        self.t_s += 0.02
        here = msgspec.structs.replace(at(x_m, y_m, self.t_s), v_mps=v_mps)
        return self.mission.step(here, [event] if event else [])

    def goto(self, where: tuple[float, float], *numbers: float, v_mps: float = 0.0) -> Goal:
        event = ask(go_to(numbers), "Ada")
        return self.ask(*where, event, v_mps)

    def to_the_end(self) -> Goal:
        path = self.mission.path
        assert path is not None
        for s_m in np.arange(0.0, float(path.s_m[-1]) + 0.04, 0.02):
            goal = self.be_at(*point_at(path, float(s_m)))
            if self.mission.path is not path:
                return goal
        raise AssertionError("the robot never arrived")

    def into_row(self, row: int) -> tuple[float, float]:
        assert self.mission.path is not None
        inside = self.mission.path.s_m[self.mission.path.row == row]
        self.along(0.0, float(inside.mean()))
        return self.place(float(inside.mean()))


def test_it_drives_to_a_place_around_the_crop_and_waits_there() -> None:
    drive = Drive()
    where = drive.into_row(1)
    goal = drive.goto(where, *HEADLAND, NORTH)
    assert (goal.status.state, goal.status.leg) == ("running", "to the goal")
    assert goal.path is not None
    certify(goal.path, ROWS, plain_rover(), MISSION.plant_clearance_m)
    assert goal.path.xy_map_m[-1] == pytest.approx(HEADLAND, abs=1e-6)
    assert math.cos(goal.path.yaw_map_rad[-1] - NORTH) == pytest.approx(1.0, abs=1e-6)
    last = drive.to_the_end()
    assert last.status.state == "paused"
    assert last.status.fact == AtGoal("Ada")
    assert last.max_speed_mps == 0.0


def test_resumed_it_enters_the_row_again_from_its_end_and_finishes_everything() -> None:
    drive = Drive()
    drive.goto(drive.into_row(1), *HEADLAND)
    drive.to_the_end()
    back = drive.be_at(*HEADLAND, "resume")
    assert back.status.leg == "back to the work"
    assert back.path is not None
    certify(back.path, ROWS, plain_rover(), MISSION.plant_clearance_m)
    drive.to_the_end()
    work = drive.mission.path
    assert work is not None and work is not back.path
    first = int(np.argmax(work.row == 1))
    goal = drive.be_at(*back.path.xy_map_m[-1])
    assert goal.status.rows_done == (0,)
    assert goal.s_m < work.s_m[first], "the row is entered at its end"
    last = drive.along(goal.s_m, float(work.s_m[-1]) + 0.02)[-1].status
    assert (last.state, last.rows_done) == ("done", (0, 1, 2))


def test_it_plans_only_once_it_stands() -> None:
    drive = Drive()
    where = drive.into_row(0)
    rolling = drive.goto(where, *HEADLAND, v_mps=0.4)
    assert (rolling.status.state, rolling.max_speed_mps) == ("paused", 0.0)
    assert rolling.status.fact == StopsForGoal("Ada")
    assert drive.be_at(*where).status.leg == "to the goal"


@pytest.mark.parametrize(
    ("numbers", "why"),
    [
        ((40.0, 0.0), BeyondFence),
        ((1.75, 4.0, 0.0), OnCropThere),
        ((2.0, 4.0, 0.0), NoWayOffCrop),
        ((math.nan, 4.0), GoalNotFinite),
    ],
)
def test_a_place_that_cannot_be_driven_to_is_refused_with_the_reason(
    numbers: tuple[float, ...], why: type[Fact]
) -> None:
    drive = Drive()
    where = drive.into_row(0)
    before = drive.mission.path
    status = drive.goto(where, *numbers).status
    refusal = status.refusal_fact
    assert isinstance(refusal, ErrandRefused) and refusal.errand == "goal"
    assert isinstance(refusal.cause, why)
    assert drive.mission.path is before
    drive.be_at(*where, "pause")
    assert drive.be_at(*where, "resume").status.state == "running", "the mission goes on"


def test_a_place_astride_a_row_is_reached_along_the_row() -> None:
    here = at(*HEADLAND, 0.0)
    start = (here.x_map_m, here.y_map_m, NORTH)
    path = plan_to_place(
        (2.0, 4.0, None), start, ROWS, make_fence(ENDS, 5.0), plain_rover(), MISSION
    )
    certify(path, ROWS, plain_rover(), MISSION.plant_clearance_m)
    assert path.xy_map_m[-1] == pytest.approx((2.0, 4.0), abs=1e-6)


def test_a_stop_wins_over_a_goal_and_a_hand_pauses_the_way_there() -> None:
    drive = Drive()
    where = drive.into_row(0)
    drive.be_at(*where, "stop")
    refused = drive.goto(where, *HEADLAND).status
    assert refused.state == "paused"
    assert refused.refusal_fact == ErrandRefused("goal", StopHolds())
    drive.be_at(*where, "clear_stop")
    assert drive.goto(where, *HEADLAND).status.refusal_fact is None
    drive.be_at(*drive.place(0.0), "pause")
    assert drive.be_at(*drive.place(0.0)).max_speed_mps == 0.0
    assert drive.be_at(*drive.place(0.0), "resume").status.leg == "to the goal"
    drive.be_at(*drive.place(0.1), "stop")
    assert drive.be_at(*drive.place(0.1), "resume").max_speed_mps == 0.0


def test_a_second_goal_replaces_the_first_and_home_replaces_both() -> None:
    drive = Drive()
    where = drive.into_row(0)
    drive.goto(where, *HEADLAND)
    second = drive.goto(drive.place(0.0), -2.0, 8.0)
    assert second.path is not None and second.path.xy_map_m[-1] == pytest.approx((-2.0, 8.0))
    assert drive.be_at(*drive.place(0.0), "return_home").status.leg == "way home"


def test_the_way_home_is_planned_from_where_the_robot_comes_to_rest() -> None:
    drive = Drive()
    where = drive.into_row(0)
    home = ask(ControlMission(action="return_home"), "Ada")
    stopping = drive.ask(*where, home, v_mps=0.4)
    assert (stopping.max_speed_mps, stopping.status.leg) == (0.0, "stops first")
    assert stopping.status.fact == StopsToReturn("Ada")
    again = drive.be_at(*where, "return_home")
    assert (again.status.state, again.status.leg) == ("running", "way home")
    assert again.path is not None
    end = drive.along(0.0, float(again.path.s_m[-1]) + 0.02)[-1].status
    assert (end.state, end.fact) == ("cancelled", ReturnedHome("Ada"))


def test_a_mission_that_has_ended_and_stays_open_comes_home_as_it_ended() -> None:
    drive = Drive()
    where = drive.into_row(0)
    drive.be_at(*where, "cancel")
    assert drive.be_at(*where, "return_home").max_speed_mps == 0.0
    drive.mission.stay_open()
    home = drive.be_at(*where, "return_home")
    assert home.status.leg == "way home"
    assert home.path is not None
    ended = drive.along(0.0, float(home.path.s_m[-1]) + 0.02)[-1].status
    assert (ended.state, ended.fact) == ("cancelled", CancelledBy("operator"))


def test_a_mission_that_has_ended_drives_to_places_only_where_it_stays_open() -> None:
    drive = Drive()
    place = drive.place(0.0)
    drive.be_at(*place, "cancel")
    assert drive.goto(place, *HEADLAND).status.state == "cancelled"
    drive.mission.stay_open()
    assert drive.goto(place, *HEADLAND).status.leg == "to the goal"
    assert drive.to_the_end().status.state == "cancelled"
    assert drive.goto(HEADLAND, 40.0, 0.0).status.refusal


def test_a_speed_set_after_the_end_is_that_of_the_next_way() -> None:
    drive = Drive()
    place = drive.place(0.0)
    drive.be_at(*place, "cancel")
    drive.mission.stay_open()
    slow = ask(ChangeSetting(setting="mission.speed_mps", value=MISSION.speed_mps / 2))
    drive.ask(*place, slow)
    assert drive.mission.speed_mps == MISSION.speed_mps / 2
    assert drive.goto(place, *HEADLAND).max_speed_mps <= MISSION.speed_mps / 2


def test_another_plan_is_taken_by_a_standing_robot_and_begins_when_resumed() -> None:
    drive = Drive()
    where = drive.into_row(0)
    plan = ask(TakePlan(geojson="1"), "Ada")
    refusal = drive.ask(*where, plan, v_mps=0.4).status.refusal_fact
    assert refusal == TaskRefused("plan", RobotDrives())
    taken = drive.ask(*where, plan).status
    assert (taken.state, taken.rows_total, taken.rows_done) == ("paused", 1, ())
    assert taken.fact == NewTask("plan", "Ada")
    drive.start = (-2.0, 0.0)
    drive.be_at(*drive.start, "resume")
    assert drive.settle().status.state == "running"
    path = drive.mission.path
    assert path is not None and set(path.row) == {-1, 0}


def test_a_plan_that_cannot_be_read_leaves_the_mission_as_it_is() -> None:
    def refuse(_: str) -> Task:
        raise MissionError(Said("not a plan"))

    ride = Ride(Mission(task(), MISSION, new_tasks=PaperTasks(refuse, no_places)))
    goal = ride.settle()
    event = ask(TakePlan(geojson="x"))
    after = ride.mission.step(at(-2.0, 0.0, ride.t_s + 0.02), [event])
    assert after.status.refusal_fact == TaskRefused("plan", Said("not a plan"))
    assert after.path is goal.path
