"""Places to visit replace the mission at any point of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.curves import Segment, sample
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import GoalAwaited, NotResumed, Said
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import (
    AnyRequest,
    Estimate,
    GnssQuality,
    Goal,
    Path,
    RequestEvent,
    RequestWord,
    TakePlan,
    Visit,
)
from agribot.core.pose import Pose2
from tests.asking import ask
from tests.autonomy.plan.paper_task import PaperTask, PaperTasks


def at(t_s: float, x_m: float, y_m: float = 0.0) -> Estimate:
    return Estimate(
        t_s=t_s, x_map_m=x_m, y_map_m=y_m, yaw_map_rad=0.0, v_mps=0.0, yaw_rate_radps=0.0,
        slip_rad=0.0, pose_cov=(0.0,) * 9, pos_std_m=0.01, yaw_std_rad=0.01,
        quality=GnssQuality.RTK_FIXED, ok=True,
    )  # fmt: skip


def ahead(estimate: Estimate, length_m: float) -> Path:
    pose = Pose2(estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
    return sample(pose, [Segment(length_m, 0.0)])


def visiting(points: Sequence[tuple[float, float]], name: str, bounds: FieldBounds | None) -> Task:
    def plan(estimate: Estimate) -> Path:
        if points[-1][0] < estimate.x_map_m:
            raise MissionError(Said("behind the robot"))
        return ahead(estimate, points[-1][0] - estimate.x_map_m)

    return PaperTask(plan, waypoints=points, name=name, bounds=bounds)


def no_plan(text: str) -> Task:
    raise MissionError(Said("no plan"))


class Drive:
    """A mission of 10 m straight ahead, that takes places to visit instead."""

    def __init__(
        self,
        *,
        waits: bool = False,
        only_from_m: float = 0.0,
        bounds: FieldBounds | None = None,
        saved: SavedMission | None = None,
    ) -> None:
        def plan(estimate: Estimate) -> Path:
            if estimate.x_map_m < self.only_from_m:
                raise MissionError(Said("put the robot elsewhere"))
            return ahead(estimate, 10.0)

        self.only_from_m = only_from_m
        config = MissionConfig(waits_for_goals=waits)
        task = PaperTask(plan, bounds=bounds)
        self.mission = Mission(task, config, saved, PaperTasks(no_plan, visiting))
        self.t_s = self.x_m = 0.0

    def step(self, *events: RequestEvent, seconds: float = 0.1) -> Goal:
        self.t_s += seconds
        return self.mission.step(at(self.t_s, self.x_m), events)

    def ask(self, action: RequestWord, *numbers: float) -> Goal:
        places = tuple(zip(numbers[::2], numbers[1::2], strict=True))
        visit = Visit(title="abc", places_map_m=places)
        requests: dict[RequestWord, AnyRequest] = {"visit": visit, "plan": TakePlan(geojson="abc")}
        return self.step(ask(requests.get(action, action), t_s=self.t_s))

    def settle(self) -> Goal:
        return [self.step() for _ in range(15)][-1]

    def drive_to(self, x_m: float) -> Goal:
        for place_m in np.arange(self.x_m, x_m + 0.011, 0.02).tolist():
            self.x_m = place_m
            goal = self.step(seconds=0.05)
        return goal


def test_without_a_visit_the_mission_is_what_it_is() -> None:
    drive = Drive()
    drive.settle()
    status = drive.drive_to(10.0).status
    assert (status.state, status.task) == ("done", "")


def test_a_visit_in_the_middle_goes_from_where_the_robot_is_and_counts_its_places() -> None:
    drive = Drive()
    drive.settle()
    drive.drive_to(3.0)
    drive.ask("visit", 4.0, 0.0, 5.0, 0.0)
    status = drive.settle().status
    assert (status.state, status.task, status.waypoints_total) == ("running", "abc", 2)
    assert tuple(drive.mission.task.waypoints) == ((4.0, 0.0), (5.0, 0.0))
    assert drive.drive_to(4.2).status.waypoints_reached == 1
    status = drive.drive_to(5.0).status
    assert (status.state, status.waypoints_reached) == ("done", 2)


def test_a_robot_that_has_ended_can_be_sent_on() -> None:
    drive = Drive()
    drive.mission.stay_open()
    drive.settle()
    assert drive.ask("cancel").status.state == "cancelled"
    drive.ask("visit", 1.0, 0.0)
    assert drive.settle().status.state == "running"


def test_a_mission_that_has_ended_begins_once_more_from_where_the_robot_stands() -> None:
    drive = Drive()
    drive.mission.stay_open()
    drive.settle()
    assert drive.drive_to(10.0).status.state == "done"
    drive.ask("resume")  # of what has ended, nothing is left to resume
    assert drive.settle().status.state == "done"
    drive.ask("start")
    status = drive.settle().status
    assert (status.state, status.s_m) == ("running", 0.0)
    assert status.length_m == pytest.approx(10.0)
    assert drive.drive_to(20.0).status.state == "done"


def test_a_start_without_a_way_waits_for_a_better_place_and_one_under_a_stop_for_its_end() -> None:
    drive = Drive()
    drive.mission.stay_open()
    drive.settle()
    drive.ask("cancel")
    drive.ask("stop")
    drive.ask("start")
    assert drive.settle().status.state == "cancelled"
    drive.ask("clear_stop")
    drive.only_from_m = 1.0
    drive.ask("start")
    status = drive.settle().status
    assert (status.state, status.fact) == ("paused", NotResumed(Said("put the robot elsewhere")))
    drive.x_m = 1.0
    drive.ask("start")
    assert drive.settle().status.state == "running"


def test_a_visit_in_a_planned_field_is_fenced_in_by_it_after_a_cut_off_too() -> None:
    field = FieldBounds(
        rings_map_m=(np.array([(-5.0, -5.0), (20.0, -5.0), (20.0, 5.0), (-5.0, 5.0)]),),
        front_m=0.5, rear_m=0.4, half_width_m=0.45,
    )  # fmt: skip
    drive = Drive(bounds=field)
    assert drive.settle().bounds is field
    drive.ask("visit", 4.0, 0.0, 5.0, 0.0)
    drive.ask("visit", 6.0, 0.0)
    goal = drive.settle()
    assert (goal.status.task, goal.bounds) == ("abc", field)
    again = Drive(bounds=field, saved=drive.mission.snapshot())
    again.settle()
    again.ask("resume")
    goal = again.settle()
    assert (goal.status.task, goal.bounds) == ("abc", field)


def test_a_visit_that_cannot_be_planned_fails_in_the_planners_words() -> None:
    drive = Drive()
    drive.settle()
    drive.ask("visit", -5.0, 0.0)
    status = drive.settle().status
    assert (status.state, status.fact) == ("failed", Said("behind the robot"))


def test_a_latched_stop_holds_the_visit_until_it_is_cleared_and_resumed() -> None:
    drive = Drive()
    drive.settle()
    drive.ask("stop")
    drive.ask("visit", 1.0, 0.0)
    assert drive.settle().status.state == "paused"
    drive.ask("resume")
    assert drive.settle().status.state == "paused"
    drive.ask("clear_stop")
    drive.ask("resume")
    status = drive.settle().status
    assert (status.state, status.task) == ("running", "abc")


def test_a_robot_that_waits_for_goals_begins_with_one_or_when_it_is_resumed() -> None:
    waiting, resumed = Drive(waits=True), Drive(waits=True)
    assert waiting.settle().status.state == "paused"
    assert waiting.settle().status.fact == GoalAwaited()
    waiting.ask("visit", 1.0, 0.0)
    assert waiting.settle().status.state == "running"
    resumed.settle()
    resumed.ask("resume")
    assert resumed.settle().status.state == "running"


def test_a_visit_to_nowhere_changes_nothing() -> None:
    drive = Drive()
    drive.settle()
    drive.ask("visit")
    status = drive.settle().status
    assert (status.state, status.task) == ("running", "")


def test_a_mission_resumed_where_no_way_begins_waits_to_be_resumed_elsewhere() -> None:
    drive = Drive(waits=True, only_from_m=2.0)
    drive.settle()
    drive.ask("resume")
    status = drive.settle().status
    assert status.state == "paused"
    refused = NotResumed(Said("put the robot elsewhere"))
    assert status.fact == status.refusal_fact == refused
    drive.drive_to(2.5)  # by hand
    drive.ask("resume")
    status = drive.settle().status
    assert (status.state, status.refusal_fact) == ("running", None)


def test_a_mission_that_begins_by_itself_where_no_way_begins_fails() -> None:
    status = Drive(only_from_m=2.0).settle().status
    assert (status.state, status.fact) == ("failed", Said("put the robot elsewhere"))


def test_a_visit_that_was_held_and_cannot_be_planned_fails_for_its_sender_waits() -> None:
    drive = Drive(waits=True)
    drive.ask("stop")
    drive.ask("visit", -5.0, 0.0)
    drive.ask("clear_stop")
    drive.ask("resume")
    assert drive.settle().status.state == "failed"
