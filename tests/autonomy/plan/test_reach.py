"""Ways to what is too far from the robot are refused before anything is planned."""

from __future__ import annotations

from unittest.mock import ANY

import msgspec
import pytest

from agribot.autonomy.plan.mission.job_start import plan_job
from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.errors import MissionError
from agribot.core.facts import ErrandRefused, TooFarAway
from agribot.core.messages import GoTo, MapPoint, Path, Row
from tests.asking import ask
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import MISSION, at
from tests.autonomy.plan.test_mission_resume import cut_off
from tests.autonomy.plan.test_mission_states import Ride
from tests.finding import is_like

ROWS = lay_rows(FieldConfig(row_count=2, row_length_m=4.0))
FAR_M = 5_346_749.0


def never(*_: object) -> Path:
    raise AssertionError("a way was planned")


def task(rows: tuple[Row, ...] = ROWS, waypoints: tuple[MapPoint, ...] = ()) -> PaperTask:
    return PaperTask(never, rows, waypoints, home=never, go_to=never, rest=never)


@pytest.mark.parametrize(
    ("work", "nearest_m"),
    [(task(), ROWS[0].start_map_m), (task((), ((0.0, 0.0), (-1.0, 9.0))), (0.0, 0.0))],
    ids=["rows", "waypoints"],
)
def test_work_too_far_from_the_robot_is_refused_with_distance_and_limit(
    work: PaperTask, nearest_m: MapPoint
) -> None:
    here = at(nearest_m[0], nearest_m[1] - 2000.0, 0.0)
    with pytest.raises(MissionError) as refused:
        plan_job(work, MISSION, here)
    assert refused.value.fact == TooFarAway(2000.0, 1000.0)


def test_a_mission_far_from_its_rows_fails_and_plans_nothing() -> None:
    ride = Ride(Mission(task(), MISSION))
    ride.start = (FAR_M, 0.0)
    status = ride.settle().status
    assert status.state == "failed"
    assert is_like(status.fact, TooFarAway(5_346_747.0, 1000.0), within=0.5)


def test_a_goal_too_far_from_the_robot_is_refused_and_planned_nowhere() -> None:
    ride = Ride(Mission(task(), msgspec.structs.replace(MISSION, waits_for_goals=True)))
    ride.start = (FAR_M, 0.0)
    ride.be_at(*ride.start)
    goto = ask(GoTo(x_map_m=0.0, y_map_m=0.0), "Ada")
    ride.mission.step(at(*ride.start, 1.0), [goto])
    status = ride.be_at(*ride.start).status
    assert status.refusal_fact == ErrandRefused("goal", TooFarAway(FAR_M, 1000.0))


def test_a_run_that_goes_on_far_from_its_rows_plans_nothing() -> None:
    saved, _ = cut_off()
    moved = msgspec.structs.replace(saved, planned_from=(FAR_M, 0.0, 0.0))
    with pytest.raises(MissionError) as refused:
        plan_job(task(), MISSION, at(*saved.pose[:2], 0.0), moved)
    assert is_like(refused.value.fact, TooFarAway(ANY, 1000.0))


def test_the_limit_is_that_of_the_settings() -> None:
    short = msgspec.structs.replace(MISSION, max_waypoint_distance_m=1.0)
    with pytest.raises(MissionError) as refused:
        plan_job(task((), ((3.0, 0.0),)), short, at(0.0, 0.0, 0.0))
    assert refused.value.fact == TooFarAway(3.0, 1.0)
