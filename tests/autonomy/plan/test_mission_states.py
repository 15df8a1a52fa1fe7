from __future__ import annotations

import math
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.mission import SETTLE_S, Mission
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.autonomy.plan.ways.speed import warn_of_speeds
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.config import FieldConfig
from agribot.core.errors import MissionError
from agribot.core.facts import (
    NoFixesYet,
    NoPositionFor,
    OffPath,
    PausedBy,
    PositionAwaited,
    PositionLost,
    ResumeAwaited,
    RowsUnknown,
    Said,
    SpeedRefused,
    StartUnsure,
    WaypointPassed,
    WaypointsMissed,
)
from agribot.core.messages import ChangeSetting, Estimate, Goal, Path
from tests.asking import ask
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import FARM, FARM_START, MISSION, at, event, point_at
from tests.finding import is_like
from tests.robot_parts import plain_rover

TWO_ROWS = FieldConfig(row_count=2, row_length_m=4.0)
ROWS = lay_rows(TWO_ROWS)


class Ride:
    """A robot that is where the test puts it, 50 times a second."""

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.start = (-2.0, 0.0)
        self.t_s = 0.0

    def be_at(self, x_m: float, y_m: float, *actions: str, ok: bool = True) -> Goal:
        self.t_s += 0.02
        events = [event(action) for action in actions]  # type: ignore[arg-type]
        return self.mission.step(at(x_m, y_m, self.t_s, ok), events)

    def settle(self) -> Goal:
        while (goal := self.be_at(*self.start)).status.state == "waiting":
            assert self.t_s < 10.0
        return goal

    def place(self, s_m: float) -> tuple[float, float]:
        assert self.mission.path is not None
        return point_at(self.mission.path, s_m)

    def along(self, first_m: float, last_m: float, beside_m: float = 0.0) -> list[Goal]:
        goals = []
        for s_m in np.arange(first_m, last_m, 0.02):
            x_m, y_m = self.place(float(s_m))
            goals.append(self.be_at(x_m + beside_m, y_m))
        return goals


def test_a_mission_plans_and_takes_no_speed_that_the_robot_may_not_drive() -> None:
    eager = msgspec.structs.replace(MISSION, speed_mps=1.5, turn_speed_mps=0.9)
    path = plan_rows(ROWS, FARM_START, plain_rover(), MISSION)
    ride = Ride(Mission(PaperTask(lambda _: path, ROWS), eager, most_mps=0.8))
    ride.settle()
    speeds = [goal.max_speed_mps for goal in ride.along(0.0, 3.0)]
    assert max(speeds) == 0.8
    faster = ask(ChangeSetting(setting="mission.speed_mps", value=0.81, id="a"))
    goal = ride.mission.step(at(*ride.place(3.0), ride.t_s + 0.02), [faster])
    (answer,) = goal.status.answers
    assert answer.fact == SpeedRefused(0.81, 0.8)
    assert ride.mission.speed_mps == 0.8


def test_a_speed_that_the_robot_may_not_drive_is_a_warning() -> None:
    eager = msgspec.structs.replace(MISSION, speed_mps=1.5, turn_speed_mps=0.3)
    (warning,) = warn_of_speeds(eager, 0.8)
    assert warning.startswith("mission.speed_mps: 1.5 m/s is more than this robot may drive")
    assert "drives 0.8 m/s" in warning
    assert warn_of_speeds(eager, 1.5) == ()


@pytest.fixture(scope="module")
def path() -> Path:
    return plan_rows(ROWS, FARM_START, plain_rover(), MISSION)


@pytest.fixture
def ride(path: Path) -> Ride:
    return Ride(Mission(PaperTask(lambda _: path, ROWS), MISSION))


def test_waits_until_the_estimate_has_held_for_a_second(ride: Ride) -> None:
    for _ in range(20):
        goal = ride.be_at(-2.0, 0.0)
    goal = ride.be_at(-2.0, 0.0, ok=False)
    assert goal.status.fact == PositionAwaited(NoFixesYet())
    lost_s = ride.t_s
    while (goal := ride.be_at(-2.0, 0.0)).status.state == "waiting":
        assert goal.max_speed_mps == 0.0
    assert goal.status.state == "running"
    assert ride.t_s - lost_s == pytest.approx(SETTLE_S, abs=0.05)


def test_whole_drive_is_done_with_every_row_accounted_for(ride: Ride, path: Path) -> None:
    ride.settle()
    goals = ride.along(0.0, float(path.s_m[-1]) + 0.02)
    last = goals[-1].status
    assert (last.state, last.fact) == ("done", None)
    assert last.rows_done == (0, 1)
    assert last.rows_total == 2
    progress = [goal.s_m for goal in goals]
    assert progress == sorted(progress)
    for result in ride.mission.row_results:
        assert result.done
        assert result.started_s is not None
        assert result.finished_s is not None
        assert result.finished_s - result.started_s == pytest.approx(4.0, abs=0.1)
        assert result.max_cross_track_m < 0.011


def test_believed_cross_track_of_a_row_is_reported(ride: Ride, path: Path) -> None:
    ride.settle()
    ride.along(0.0, float(path.s_m[-1]), beside_m=0.07)
    assert ride.mission.row_results[0].max_cross_track_m == pytest.approx(0.07, abs=1e-6)


def test_speed_drops_in_turns_and_ramps_to_the_end(ride: Ride, path: Path) -> None:
    ride.settle()
    goals = ride.along(0.0, float(path.s_m[-1]))
    speed = np.array([goal.max_speed_mps for goal in goals])
    s_m = np.array([goal.s_m for goal in goals])
    bend = np.interp(s_m, path.s_m, np.abs(path.curvature_radpm)) > 1.0
    assert speed[bend].max() <= MISSION.turn_speed_mps
    assert speed.max() == pytest.approx(MISSION.speed_mps)
    assert speed[-1] < 0.15
    accel = np.diff(speed**2)[np.diff(s_m) > 0] / (2.0 * np.diff(s_m)[np.diff(s_m) > 0])
    assert np.abs(accel).max() < 1.0


def test_tool_works_in_the_rows_and_never_in_the_turn(ride: Ride, path: Path) -> None:
    ride.settle()
    for goal in ride.along(0.0, float(path.s_m[-1])):
        index = int(np.searchsorted(path.s_m, goal.s_m))
        if goal.status.row >= 0:
            assert goal.tool_on
        if abs(path.curvature_radpm[index]) > 0.0:
            assert not goal.tool_on


def test_pause_and_resume_go_on_at_the_same_place(ride: Ride) -> None:
    ride.settle()
    before = ride.along(0.0, 6.0)[-1]
    x_m, y_m = ride.place(6.0)
    paused = ride.be_at(x_m, y_m, "pause")
    assert paused.status.state == "paused"
    assert paused.status.fact == PausedBy("operator")
    assert paused.max_speed_mps == 0.0
    assert not paused.tool_on
    for _ in range(100):
        paused = ride.be_at(x_m + 0.3, y_m - 0.3)
    assert paused.s_m == before.s_m
    resumed = ride.be_at(*ride.place(5.98), "resume")
    assert resumed.status.state == "running"
    assert resumed.s_m == before.s_m
    assert resumed.max_speed_mps > 0.0


def test_stop_latches_until_cleared_and_still_needs_a_resume(ride: Ride) -> None:
    ride.settle()
    place = ride.place(0.0)
    assert ride.be_at(*place, "stop").status.state == "paused"
    assert ride.be_at(*place, "resume").max_speed_mps == 0.0
    cleared = ride.be_at(*place, "clear_stop")
    assert cleared.status.state == "paused"
    assert cleared.status.fact == ResumeAwaited()
    assert ride.be_at(*place, "resume").status.state == "running"


def test_pause_before_the_start_waits_again_after_resume(ride: Ride) -> None:
    assert ride.be_at(-2.0, 0.0, "pause").status.state == "paused"
    for _ in range(100):
        assert ride.be_at(-2.0, 0.0).status.state == "paused"
    assert ride.be_at(-2.0, 0.0, "resume").status.state == "waiting"


def test_cancel_is_final(ride: Ride) -> None:
    ride.settle()
    place = ride.place(0.0)
    assert ride.be_at(*place, "cancel").status.state == "cancelled"
    goal = ride.be_at(*place, "resume", "clear_stop", "pause")
    assert goal.status.state == "cancelled"
    assert goal.max_speed_mps == 0.0


def test_leaving_the_path_fails_with_distance_limit_and_place(ride: Ride) -> None:
    ride.settle()
    ride.along(0.0, 6.0)
    x_m, y_m = ride.place(6.0)
    goal = ride.be_at(x_m - 0.6, y_m)
    assert goal.status.state == "failed"
    assert is_like(goal.status.fact, OffPath(0.6, 0.5, x_m - 0.6, y_m))
    assert goal.max_speed_mps == 0.0


def test_a_robot_pushed_back_along_its_path_has_not_left_it(ride: Ride) -> None:
    ride.settle()
    ride.along(0.0, 7.0)
    goal = ride.be_at(*ride.place(5.5))
    assert goal.status.state == "running"
    assert goal.s_m == pytest.approx(7.0, abs=0.03)


def test_the_neighbouring_row_never_captures_progress(path: Path) -> None:
    wide = Mission(PaperTask(lambda _: path, ROWS), MISSION)
    ride = Ride(wide)
    ride.settle()
    first = float(path.s_m[path.row == 0][0])
    ride.along(0.0, first + 2.0)
    for _ in range(50):
        x_m, y_m = point_at(path, first + 2.0)
        goal = ride.be_at(x_m + 0.49, y_m)
    assert goal.status.row == 0
    assert goal.s_m < first + 2.1


def test_a_lost_estimate_stands_still_and_goes_on_by_itself(ride: Ride) -> None:
    ride.settle()
    ride.along(0.0, 2.0)
    place = ride.place(2.0)
    lost = ride.be_at(*place, ok=False)
    assert lost.max_speed_mps == 0.0
    assert lost.status.fact == PositionLost(NoFixesYet())
    not_finite = ride.be_at(math.nan, 0.0)
    assert not_finite.max_speed_mps == 0.0
    assert ride.be_at(*place).max_speed_mps > 0.0


def test_waypoints_are_counted_only_in_order_and_only_when_reached() -> None:
    points = [(1.0, 0.0), (4.0, 0.0), (4.0, 3.0)]
    path = plan_waypoints(points, (-2.0, 0.0, 0.0), plain_rover(), MISSION)
    ride = Ride(Mission(PaperTask(lambda _: path, (), points), MISSION))
    ride.settle()
    reached = [goal.status.waypoints_reached for goal in ride.along(0.0, float(path.s_m[-1]))]
    assert reached == sorted(reached)
    assert reached[-1] == 3
    assert ride.mission.waypoints_reached == (True, True, True)


def test_a_missed_waypoint_fails_the_mission_and_is_named() -> None:
    points = [(1.0, 0.0), (4.0, 0.0)]
    path = plan_waypoints(points, (-2.0, 0.0, 0.0), plain_rover(), MISSION)
    ride = Ride(Mission(PaperTask(lambda _: path, (), points), MISSION))
    ride.settle()
    ride.along(0.0, 2.5)
    ride.along(2.5, 3.5, beside_m=0.0)
    assert ride.mission.waypoints_reached == (True, False)
    for s_m in np.arange(3.5, 6.2, 0.02):
        goal = ride.be_at(-2.0 + float(s_m), 0.3)
    assert goal.status.state == "failed"
    assert is_like(goal.status.fact, WaypointsMissed((2,), ANY))


def test_plans_once_from_where_the_robot_stands_when_it_has_settled(path: Path) -> None:
    asked = []

    def plan(estimate: Estimate) -> Path:
        asked.append((estimate.x_map_m, estimate.y_map_m))
        return path

    ride = Ride(Mission(PaperTask(plan, ROWS), MISSION))
    before = ride.be_at(-2.0, 0.0)
    assert before.path is None
    assert before.status.length_m == 0.0
    assert not asked
    goal = ride.settle()
    ride.be_at(-2.0, 0.0, "pause")
    ride.be_at(-2.0, 0.0, "resume")
    assert goal.path is path
    assert goal.status.length_m == path.s_m[-1]
    assert asked == [(-2.0, 0.0)]


def test_a_refused_plan_fails_the_mission_with_the_planners_words() -> None:
    def plan(_: Estimate) -> Path:
        raise MissionError(Said("no way to the field"))

    goal = Ride(Mission(PaperTask(plan, ROWS), MISSION)).settle()
    assert (goal.status.state, goal.status.fact) == ("failed", Said("no way to the field"))
    assert goal.path is None
    assert goal.max_speed_mps == 0.0


def test_a_path_that_misses_its_waypoints_is_refused(path: Path) -> None:
    goal = Ride(Mission(PaperTask(lambda _: path, ROWS, [(50.0, 50.0)]), MISSION)).settle()
    assert goal.status.state == "failed"
    assert is_like(goal.status.fact, WaypointPassed(1, ANY, MISSION.waypoint_radius_m))


def test_a_path_over_unknown_rows_is_refused() -> None:
    farm_path = plan_rows(lay_rows(FARM), FARM_START, plain_rover(), MISSION)
    goal = Ride(Mission(PaperTask(lambda _: farm_path, ROWS), MISSION)).settle()
    assert goal.status.state == "failed"
    assert goal.status.fact == RowsUnknown((2, 3, 4, 5))


def test_the_time_left_follows_a_change_of_speed(ride: Ride, path: Path) -> None:
    ride.settle()
    ride.along(0.0, 4.0)
    before = ride.be_at(*ride.place(4.0)).status
    ride.t_s += 0.02
    slower = ask(ChangeSetting(setting="mission.speed_mps", value=0.1))
    after = ride.mission.step(at(*ride.place(4.0), ride.t_s), [slower]).status
    left_m = float(path.s_m[-1]) - 4.0
    assert before.eta_s is not None and after.eta_s is not None
    assert before.eta_s < 2.0 * left_m / MISSION.speed_mps
    assert after.eta_s == pytest.approx(left_m / 0.1, rel=0.1)


def known_to(std_m: float, here: Estimate, **change: object) -> Estimate:
    cov = (std_m**2, 0.0, 0.0, 0.0, std_m**2, 0.0, 0.0, 0.0, 0.01)
    return msgspec.structs.replace(here, pos_std_m=std_m, pose_cov=cov, **change)


def test_a_pose_that_jumps_within_its_own_error_has_not_left_the_path(ride: Ride) -> None:
    ride.settle()
    ride.along(0.0, 6.0)
    x_m, y_m = ride.place(6.0)
    jumped = at(x_m - 0.6, y_m, ride.t_s + 0.02)
    assert ride.mission.step(known_to(0.25, jumped)).status.state == "running"
    goal = ride.mission.step(known_to(0.15, jumped))
    assert goal.status.state == "failed"
    assert is_like(goal.status.fact, OffPath(0.6, 0.5, ANY, ANY))


def test_a_robot_that_cannot_tell_its_rows_apart_waits_where_it_stands(path: Path) -> None:
    ride = Ride(Mission(PaperTask(lambda _: path, ROWS), MISSION))
    for t_s in np.arange(0.0, MISSION.stall_timeout_s, 0.5):
        goal = ride.mission.step(known_to(1.8, at(-2.0, 0.0, float(t_s))))
        assert goal.status.state == "waiting"
        assert goal.max_speed_mps == 0.0
    unsure = StartUnsure(1.8, 0.25)
    assert is_like(goal.status.fact, PositionAwaited(unsure))
    goal = ride.mission.step(known_to(1.8, at(-2.0, 0.0, MISSION.stall_timeout_s + 1.0)))
    assert goal.status.state == "failed"
    assert is_like(goal.status.fact, NoPositionFor(60.0, unsure))


def test_it_sets_off_once_its_place_is_known_or_a_camera_looks(path: Path) -> None:
    for change in ({"std_m": 0.05}, {"std_m": 1.8, "row_seen": False}):
        mission = Mission(PaperTask(lambda _: path, ROWS), MISSION)
        for t_s in np.arange(0.0, 2.0, 0.1):
            goal = mission.step(known_to(here=at(-2.0, 0.0, float(t_s)), **change))
        assert goal.status.state == "running"


def test_waypoints_need_no_row(path: Path) -> None:
    mission = Mission(PaperTask(lambda _: path, ROWS, has_crop=False), MISSION)
    for t_s in np.arange(0.0, 2.0, 0.1):
        goal = mission.step(known_to(1.8, at(-2.0, 0.0, float(t_s))))
    assert goal.status.state == "running"
