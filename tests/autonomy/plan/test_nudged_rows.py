"""A person moves the line of a row aside, a centimetre at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.plan.mission.job import MissionJob
from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.row_log import MOST_NUDGED_M
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.facts import InNoRow, RowMovedFar, RowNotMoved
from agribot.core.messages import Estimate, Path
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import MISSION, at
from tests.autonomy.plan.test_mission_states import Ride
from tests.robot_parts import plain_rover

ROWS = lay_rows(FieldConfig(row_count=2, row_length_m=4.0))  # to the North, then back


def plan(estimate: Estimate) -> Path:
    start = (estimate.x_map_m, estimate.y_map_m, math.pi / 2)
    return plan_rows(ROWS, start, plain_rover(), MISSION)


@pytest.fixture
def ride() -> Ride:
    one = Ride(Mission(PaperTask(plan, ROWS), MISSION))
    one.settle()
    return one


def middle_m(one: Ride, row: int) -> float:
    assert one.mission.path is not None
    return float(np.mean(one.mission.path.s_m[one.mission.path.row == row]))


def moved_m(one: Ride) -> tuple[float, float]:
    """Where the robot appears to be on its path, East and North of where it is."""
    here = at(0.0, 0.0, one.t_s)
    there = one.mission.relate_to_path(here)
    return there.x_map_m - here.x_map_m, there.y_map_m - here.y_map_m


def test_a_step_to_the_left_is_to_the_left_as_the_robot_drives_in_every_row(ride: Ride) -> None:
    done_m = 0.0
    for row, west in ((0, 1.0), (1, -1.0)):
        to_m = middle_m(ride, row)
        ride.along(done_m, to_m)
        goal = ride.be_at(*ride.place(to_m), "nudge_left", "nudge_left")
        assert abs(goal.status.row_nudged_m) == pytest.approx(0.02)
        # Left of a way to the North is West: seen as too far East, the robot steers there.
        assert moved_m(ride) == pytest.approx((0.02 * west, 0.0), abs=1e-9)
        done_m = to_m
    results = ride.mission.row_results
    assert [row.nudged_m for row in results] == pytest.approx([0.02, -0.02])


def test_a_row_is_moved_no_farther_than_the_limit_and_the_next_one_not_at_all(ride: Ride) -> None:
    to_m = middle_m(ride, 0)
    ride.along(0.0, to_m)
    steps = round(MOST_NUDGED_M / 0.01)
    for _ in range(steps):
        assert ride.be_at(*ride.place(to_m), "nudge_right").status.refusal_fact is None
    goal = ride.be_at(*ride.place(to_m), "nudge_right")
    assert goal.status.refusal_fact == RowNotMoved(RowMovedFar(1, MOST_NUDGED_M))
    assert goal.status.row_nudged_m == pytest.approx(-MOST_NUDGED_M)
    ride.along(to_m, middle_m(ride, 1))
    assert moved_m(ride) == (0.0, 0.0)


def test_between_rows_there_is_no_line_to_move(ride: Ride) -> None:
    goal = ride.be_at(*ride.start, "nudge_left")
    assert goal.status.refusal_fact == RowNotMoved(InNoRow())


def test_a_mission_that_goes_on_keeps_what_was_moved(ride: Ride) -> None:
    to_m = middle_m(ride, 0)
    ride.along(0.0, to_m)
    ride.be_at(*ride.place(to_m), "nudge_left")
    saved = ride.mission.snapshot()
    assert saved is not None
    assert ride.mission.path is not None
    job = MissionJob(PaperTask(plan, ROWS), MISSION, ride.mission.path, saved.pose)
    job.restore(saved)
    assert job.nudged_here_m == pytest.approx(0.01)
