"""A row that is skipped in time is left out of the way."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.plan.ways.boustrophedon import plan_rows, plan_without
from agribot.autonomy.plan.ways.certify import certify
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.errors import MissionError
from agribot.core.facts import RowsSkipped, Said
from agribot.core.messages import Estimate, Path
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import MISSION
from tests.autonomy.plan.test_mission_states import Ride
from tests.robot_parts import plain_rover

ROWS = lay_rows(FieldConfig(row_count=4, row_length_m=4.0))


def plan(estimate: Estimate) -> Path:
    start = (estimate.x_map_m, estimate.y_map_m, math.pi / 2)
    return plan_rows(ROWS, start, plain_rover(), MISSION)


def around(path: Path, index: int, skipped: int) -> Path:
    path = plan_without(path, index, skipped, ROWS, plain_rover(), MISSION)
    certify(path, ROWS, plain_rover(), MISSION.plant_clearance_m)
    return path


def ride(saved: SavedMission | None = None) -> Ride:
    return Ride(Mission(PaperTask(plan, ROWS, around=around), MISSION, saved))


def after_row_m(one: Ride, row: int) -> float:
    """Half a metre behind a row, where its turn has not begun."""
    path = one.mission.path
    assert path is not None
    return float(path.s_m[path.row == row][-1]) + 0.5


def skipping(row: int) -> tuple[Ride, float]:
    """A ride that skips the row after `row` as soon as that is done."""
    one = ride()
    one.settle()
    s_m = after_row_m(one, row)
    one.along(0.0, s_m)
    one.be_at(*one.place(s_m), "skip_row")
    return one, s_m


def finish(one: Ride, s_m: float) -> Ride:
    assert one.mission.path is not None
    one.along(s_m, float(one.mission.path.s_m[-1]) + 0.02)
    return one


def test_the_way_leads_around_the_skipped_row_and_is_shorter_by_it() -> None:
    one, s_m = skipping(0)
    full, path = plan(one.mission._last), one.mission.path  # type: ignore[arg-type]
    assert path is not None
    assert set(path.row.tolist()) == {-1, 0, 2, 3}
    assert path.s_m[-1] < full.s_m[-1] - 3.0
    status = finish(one, s_m).be_at(0.0, 0.0).status
    assert (status.state, status.rows_done) == ("done", (0, 2, 3))
    assert status.fact == RowsSkipped((1,))


def test_the_last_row_skipped_ends_the_mission_behind_the_one_before() -> None:
    one, s_m = skipping(2)
    status = finish(one, s_m).be_at(0.0, 0.0).status
    assert (status.state, status.rows_done) == ("done", (0, 1, 2))
    assert one.mission.path is not None
    assert one.mission.path.s_m[-1] < s_m + 1.1


def test_in_a_skipped_row_the_next_one_can_be_skipped_too() -> None:
    one = ride()
    one.settle()
    s_m = after_row_m(one, 1) - 2.5  # in row 1
    one.along(0.0, s_m)
    one.be_at(*one.place(s_m), "skip_row")
    one.be_at(*one.place(s_m), "skip_row")
    assert one.mission.path is not None
    assert set(one.mission.path.row.tolist()) == {-1, 0, 1, 3}
    status = finish(one, s_m).be_at(0.0, 0.0).status
    assert (status.state, status.rows_done) == ("done", (0, 3))


def test_two_rows_skipped_one_after_the_other_are_both_left_out() -> None:
    one, s_m = skipping(0)
    one.be_at(*one.place(s_m), "skip_row")
    assert one.mission.path is not None
    assert set(one.mission.path.row.tolist()) == {-1, 0, 3}
    assert finish(one, s_m).be_at(0.0, 0.0).status.rows_done == (0, 3)


def test_after_a_crash_the_same_way_around_is_taken() -> None:
    one, s_m = skipping(0)
    later_m = s_m + 3.0
    one.along(s_m, later_m)
    saved = one.mission.snapshot()
    assert saved is not None
    saved = msgspec.json.decode(msgspec.json.encode(saved), type=SavedMission)
    again = ride(saved)
    again.start = saved.pose[:2]
    goal = again.settle()
    assert goal.status.state == "running", goal.status.reason
    assert one.mission.path is not None and goal.path is not None
    np.testing.assert_array_equal(goal.path.xy_map_m, one.mission.path.xy_map_m)
    assert finish(again, later_m).be_at(0.0, 0.0).status.rows_done == (0, 2, 3)


def test_without_a_clear_way_around_the_row_is_passed_with_the_tool_off() -> None:
    def closed(path: Path, index: int, skipped: int) -> Path:
        raise MissionError(Said("no way around"))

    one = Ride(Mission(PaperTask(plan, ROWS, around=closed), MISSION))
    one.settle()
    s_m = after_row_m(one, 0)
    one.along(0.0, s_m)
    one.be_at(*one.place(s_m), "skip_row")
    assert one.mission.path is not None
    goals = one.along(s_m, float(one.mission.path.s_m[-1]) + 0.02)
    passed = [goal for goal in goals if goal.status.row == 1]
    assert passed and not any(goal.tool_on for goal in passed)
    assert goals[-1].status.rows_done == (0, 2, 3)


@pytest.mark.parametrize("further_m", [0.0, 0.8, 1.6, 2.4])
def test_called_in_the_middle_of_a_turn_the_way_stays_clear_of_the_crop(further_m: float) -> None:
    one = ride()
    one.settle()
    s_m = after_row_m(one, 0) + further_m
    one.along(0.0, s_m)
    goal = one.be_at(*one.place(s_m), "skip_row")
    assert goal.path is not None
    certify(goal.path, ROWS, plain_rover(), MISSION.plant_clearance_m)
    status = finish(one, s_m).be_at(0.0, 0.0).status
    assert (status.state, sorted(status.rows_done)) == ("done", [0, 2, 3])
