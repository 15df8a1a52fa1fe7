"""A mission that is cut off goes on where it was; skipped rows, the way home, the reports."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.saved_mission import PoseTuple, SavedMission
from agribot.autonomy.plan.ways.boustrophedon import plan_home, plan_rows
from agribot.autonomy.plan.ways.certify import certify
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.facts import (
    AllRowsWorked,
    CarriedAway,
    NotResumed,
    OtherMission,
    ReturnedHome,
    RowsSkipped,
)
from agribot.core.messages import Estimate, FloatArray, Goal, Path
from agribot.core.row_shape import project_on_row
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import FARM_START, MISSION
from tests.autonomy.plan.test_mission_states import Ride
from tests.finding import holds
from tests.robot_parts import plain_rover

ROWS = lay_rows(FieldConfig(row_count=3, row_length_m=4.0))
HALF_ROW_M = 2.0


def plan(estimate: Estimate) -> Path:
    start = (estimate.x_map_m, estimate.y_map_m, math.pi / 2)
    return plan_rows(ROWS, start, plain_rover(), MISSION)


def home(estimate: Estimate, pose: PoseTuple, _: FloatArray) -> Path:
    start = (estimate.x_map_m, estimate.y_map_m, math.pi / 2)
    return plan_home(ROWS, start, (pose[0], pose[1], math.pi / 2), plain_rover(), MISSION)


def ride(saved: SavedMission | None = None) -> Ride:
    return Ride(Mission(PaperTask(plan, ROWS, home=home), MISSION, saved))


def row_at_m(one: Ride, row: int, part: float = 0.5) -> float:
    path = one.mission.path
    assert path is not None
    inside = path.s_m[path.row == row]
    return float(inside[0] + part * (inside[-1] - inside[0]))


def cut_off() -> tuple[SavedMission, float]:
    """Row 0 done, half of row 1; through JSON, as a file would hold it."""
    one = ride()
    one.settle()
    s_m = row_at_m(one, 1)
    one.along(0.0, s_m)
    saved = one.mission.snapshot()
    assert saved is not None
    return msgspec.json.decode(msgspec.json.encode(saved), type=SavedMission), s_m


def test_after_a_crash_the_work_goes_on_at_the_same_place() -> None:
    saved, s_m = cut_off()
    assert [result.done for result in saved.rows] == [True, False, False]
    assert saved.rows[1].worked_m == pytest.approx(HALF_ROW_M, abs=0.1)
    again = ride(saved)
    again.start = saved.pose[:2]
    goal = again.settle()
    assert goal.status.state == "running"
    assert goal.s_m == pytest.approx(s_m, abs=0.05)
    assert goal.status.rows_done == (0,)
    assert goal.tool_on
    last = again.along(s_m, float(again.mission.path.s_m[-1]) + 0.02)[-1].status  # type: ignore[union-attr]
    assert (last.state, last.rows_done) == ("done", (0, 1, 2))
    assert again.mission.row_results[1].worked_m == pytest.approx(2 * HALF_ROW_M, abs=0.1)


def test_a_robot_that_was_carried_away_does_not_go_on_and_says_how_far() -> None:
    saved, _ = cut_off()
    again = ride(saved)
    again.start = (saved.pose[0] + 3.0, saved.pose[1] + 4.0)
    status = again.settle().status
    assert status.state == "failed"
    assert isinstance(status.fact, CarriedAway)
    assert status.fact.away_m == pytest.approx(5.0)


def test_another_task_is_not_taken_for_the_saved_one() -> None:
    saved, _ = cut_off()
    other = Ride(Mission(PaperTask(plan, ROWS, [(0.0, 0.0)]), MISSION, saved))
    longer = msgspec.structs.replace(saved, length_m=saved.length_m + 1.0)
    again = ride(longer)
    for one in (other, again):
        one.start = saved.pose[:2]
        status = one.settle().status
        assert status.state == "failed"
    assert holds(status.fact, OtherMission)


def test_moved_while_paused_it_stays_paused_until_it_is_back() -> None:
    one = ride()
    one.settle()
    s_m = row_at_m(one, 0)
    one.along(0.0, s_m)
    x_m, y_m = one.place(s_m)
    one.be_at(x_m, y_m, "pause")
    refused = one.be_at(x_m + 1.2, y_m, "resume").status
    assert refused.state == "paused"
    assert isinstance(refused.fact, NotResumed)
    assert isinstance(refused.fact.cause, CarriedAway)
    assert refused.fact.cause.away_m == pytest.approx(1.2, abs=0.01)
    assert one.be_at(x_m, y_m, "resume").status.state == "running"


def test_a_skipped_row_is_passed_with_the_tool_off_and_not_counted_as_done() -> None:
    one = ride()
    one.settle()
    s_m, end_m = row_at_m(one, 1, 0.3), float(one.mission.path.s_m[-1])  # type: ignore[union-attr]
    one.along(0.0, s_m)
    x_m, y_m = one.place(s_m)
    assert one.be_at(x_m, y_m).tool_on
    assert not one.be_at(x_m, y_m, "skip_row").tool_on
    later = one.along(s_m, end_m + 0.02)
    assert not any(goal.tool_on for goal in later if goal.status.row == 1)
    assert any(goal.tool_on for goal in later if goal.status.row == 2)
    assert later[-1].status.state == "done"
    assert later[-1].status.rows_done == (0, 2)
    assert later[-1].status.fact == RowsSkipped((1,))


def test_between_rows_the_next_one_is_skipped() -> None:
    one = ride()
    one.settle()
    turn_m = (row_at_m(one, 0, 1.0) + row_at_m(one, 1, 0.0)) / 2.0
    one.along(0.0, turn_m)
    assert one.be_at(*one.place(turn_m)).status.leg == "to row 2"
    one.be_at(*one.place(turn_m), "skip_row")
    assert one.mission.row_results[1].skipped
    passed = [g for g in one.along(turn_m, row_at_m(one, 1, 0.9)) if g.status.row == 1]
    assert passed
    assert not any(goal.tool_on for goal in passed)


def test_it_returns_home_around_the_crop_with_the_tool_off() -> None:
    one = ride()
    one.settle()
    s_m = row_at_m(one, 1)
    one.along(0.0, s_m)
    goal = one.be_at(*one.place(s_m), "return_home")
    assert goal.status.leg == "way home"
    assert goal.path is not None
    certify(goal.path, ROWS, plain_rover(), MISSION.plant_clearance_m)
    assert goal.path.xy_map_m[-1] == pytest.approx(FARM_START[:2], abs=0.01)
    way = one.along(0.0, float(goal.path.s_m[-1]) + 0.02)
    assert not any(goal.tool_on for goal in way)
    assert way[-1].status.state == "cancelled"
    assert way[-1].status.fact == ReturnedHome("operator")
    saved = one.mission.snapshot()
    assert saved is not None and saved.s_m == pytest.approx(s_m, abs=0.05)


def test_leg_distance_and_time_left_are_told_on_the_way() -> None:
    one = ride()
    assert one.be_at(*one.start).status.eta_s is None
    one.settle()
    length_m = float(one.mission.path.s_m[-1])  # type: ignore[union-attr]
    goals = one.along(0.0, length_m)
    left_m = [goal.status.distance_left_m for goal in goals]
    left_s = [goal.status.eta_s or 0.0 for goal in goals]
    assert left_m[0] == pytest.approx(length_m, abs=0.05)
    assert left_m[-1] < 0.05
    assert np.all(np.diff(left_m) <= 1e-9)
    assert np.all(np.diff(left_s) <= 1e-9)
    assert length_m / MISSION.speed_mps < left_s[0] < length_m / MISSION.turn_speed_mps * 1.5
    legs = list(dict.fromkeys(goal.status.leg for goal in goals))
    assert legs[:6] == ["to row 1", "row 1", "to row 2", "row 2", "to row 3", "row 3"]


def test_an_outage_of_the_position_loses_nothing() -> None:
    one = ride()
    one.settle()
    s_m = row_at_m(one, 0)
    one.along(0.0, s_m)
    x_m, y_m = one.place(s_m)
    for _ in range(200):
        lost = one.be_at(x_m, y_m, ok=False)
        assert lost.max_speed_mps == 0.0
        assert not lost.tool_on
    back = one.be_at(x_m, y_m)
    assert back.status.state == "running"
    assert back.s_m == pytest.approx(s_m, abs=0.05)


def from_the_far_side(estimate: Estimate) -> Path:
    """The same rows the other way round: the last one first."""
    x_m, y_m = ROWS[-1].end_map_m
    return plan_rows(ROWS, (x_m + 1.0, y_m + 1.0, -math.pi / 2), plain_rover(), MISSION)


def rest(estimate: Estimate, indices: Sequence[int]) -> Path:
    left = [row for row in ROWS if row.index in indices]
    start = (estimate.x_map_m, estimate.y_map_m, math.pi / 2)
    return plan_rows(left, start, plain_rover(), MISSION, ROWS)


def worked(goals: Sequence[Goal], one: Ride) -> FloatArray:
    """Places at which the tool worked, (N, 2)."""
    return np.array([one.place(goal.s_m) for goal in goals if goal.tool_on]).reshape(-1, 2)


def along_rows_m(places: FloatArray) -> list[FloatArray]:
    """Of each row, how far along it the tool worked."""
    found = []
    for row in ROWS:
        beside = project_on_row(row, places[:, 0], places[:, 1])
        along = np.asarray(beside.along_m)[np.abs(np.asarray(beside.left_m)) < 0.1]
        found.append(along[(along >= 0.0) & (along <= 4.0)])
    return found


@pytest.mark.parametrize("has_rest", [True, False])
@pytest.mark.parametrize("part", [0.2, 0.31, 0.52, 0.77, 0.9])
def test_killed_anywhere_and_planned_anew_every_row_is_worked_and_none_twice(
    part: float, has_rest: bool
) -> None:
    """Without a planner of the rest, the whole new path is driven with the tool off meanwhile."""
    first = ride()
    first.settle()
    length_m = float(first.mission.path.s_m[-1])  # type: ignore[union-attr]
    before = worked(first.along(0.0, part * length_m), first)
    saved = first.mission.snapshot()
    assert saved is not None
    saved = msgspec.json.decode(msgspec.json.encode(saved), type=SavedMission)
    task = PaperTask(from_the_far_side, ROWS, rest=rest if has_rest else None)
    again = Ride(Mission(task, MISSION, saved))
    again.start = saved.pose[:2]
    status = again.settle().status
    assert status.state == "running", status.reason
    assert set(status.rows_done) == {row.index for row in saved.rows if row.done}
    path = again.mission.path
    assert path is not None
    if has_rest:
        assert not set(status.rows_done) & set(path.row.tolist())
    goals = again.along(0.0, float(path.s_m[-1]) + 0.02)
    assert goals[-1].status.state == "done"
    assert sorted(goals[-1].status.rows_done) == [0, 1, 2]
    after = worked(goals, again)
    for old, new in zip(along_rows_m(before), along_rows_m(after), strict=True):
        once = np.sort(np.concatenate([old, new]))
        assert once[0] < 0.1 and once[-1] > 3.9
        assert np.diff(once).max() < 0.1
        if len(old):
            twice = new[(new > old.min()) & (new < old.max())]
            assert len(twice) == 0 or np.ptp(twice) < 0.15


def test_rows_that_were_all_worked_are_not_worked_again_under_another_plan() -> None:
    one = ride()
    one.settle()
    one.along(0.0, row_at_m(one, 2, 1.0) + 0.7)
    saved = one.mission.snapshot()
    assert saved is not None
    again = Ride(Mission(PaperTask(from_the_far_side, ROWS, rest=rest), MISSION, saved))
    again.start = saved.pose[:2]
    status = again.settle().status
    assert (status.state, status.fact) == ("failed", AllRowsWorked())


@pytest.mark.parametrize("has_rest", [True, False])
def test_rows_that_were_skipped_stay_so_under_another_plan(has_rest: bool) -> None:
    one = ride()
    one.settle()
    s_m = row_at_m(one, 1)
    one.along(0.0, s_m)
    one.be_at(*one.place(s_m), "skip_row")
    saved = msgspec.json.decode(msgspec.json.encode(one.mission.snapshot()), type=SavedMission)
    task = PaperTask(from_the_far_side, ROWS, rest=rest if has_rest else None)
    again = Ride(Mission(task, MISSION, saved))
    again.start = saved.pose[:2]
    assert again.settle().status.rows_done == (0,)
    path = again.mission.path
    assert path is not None
    goals = again.along(0.0, float(path.s_m[-1]) + 0.02)
    assert goals[-1].status.rows_done == (0, 2)
    assert goals[-1].status.fact == RowsSkipped((1,))
    assert [len(along) > 0 for along in along_rows_m(worked(goals, again))] == [False, False, True]


def test_what_was_worked_on_another_field_does_not_count() -> None:
    saved, _ = cut_off()
    elsewhere = lay_rows(
        FieldConfig(row_count=3, row_length_m=4.0, first_row_start_map_m=(40.0, 0.0))
    )

    def plan_there(estimate: Estimate) -> Path:
        return plan_rows(elsewhere, (38.0, 0.0, math.pi / 2), plain_rover(), MISSION)

    again = Ride(Mission(PaperTask(plan_there, elsewhere), MISSION, saved))
    again.start = saved.pose[:2]
    status = again.settle().status
    assert status.state == "failed"
    assert holds(status.fact, OtherMission)
