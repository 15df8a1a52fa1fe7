"""A row that is lost is no trap: look, back out, enter anew, leave it out, ask."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.mission.row_recovery import SURE_M
from agribot.autonomy.plan.ways.boustrophedon import plan_rows, plan_without
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.facts import Fact, NoHeadway, PictureFrozen, RowLost, RowsSkipped
from agribot.core.messages import Estimate, GnssQuality, Goal, MissionStatus, Path
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import FARM_START, MISSION, at, event, point_at
from tests.finding import holds
from tests.robot_parts import plain_rover

ROWS = lay_rows(FieldConfig(row_count=4, row_length_m=6.0))  # North, 1 m apart, from (1, 2)
DT_S, LOST_M = 0.1, 5.0
Sees = Callable[["Drive"], bool | None]


def plan(here: Estimate) -> Path:
    return plan_rows(ROWS, (here.x_map_m, here.y_map_m, math.pi / 2), plain_rover(), MISSION)


def plan_around(path: Path, index: int, skipped: int) -> Path:
    return plan_without(path, index, skipped, ROWS, plain_rover(), MISSION)


class Drive:
    """A robot that goes exactly where its mission wants, and knows its row where it sees it."""

    def __init__(
        self, sees: Sees, fact: Fact | None = None, quality: GnssQuality = GnssQuality.RTK_FIXED
    ) -> None:
        task = PaperTask(plan, ROWS, around=plan_around, clearance_m=math.inf)
        self.mission = Mission(task, MISSION)
        self.sees, self.fact, self.quality = sees, fact, quality
        self.t_s, self.place = 0.0, FARM_START[:2]
        self.aside_m, self.row = 0.0, -1
        self.legs: list[str] = []
        self.north_m: list[tuple[str, float]] = []

    @property
    def backed_out(self) -> int:
        """How often it did."""
        return sum(leg.startswith("backs out") for leg in self.legs)

    def step(self) -> Goal:
        sees = self.sees(self)
        estimate = at(self.place[0] + self.aside_m, self.place[1], self.t_s)
        std_m = 0.01 if sees else 0.3
        estimate = msgspec.structs.replace(
            estimate, pose_cov=(std_m**2, 0, 0, 0, 1e-4, 0, 0, 0, 1e-4), row_seen=sees,
            fact=self.fact if not sees else None, across_protection_m=0.1,
            quality=self.quality,
        )  # fmt: skip
        goal = self.mission.step(estimate)
        self.t_s += DT_S
        self.row = goal.status.row
        if goal.status.leg not in self.legs[-1:]:
            self.legs.append(goal.status.leg)
        self.north_m.append((goal.status.leg, self.place[1]))
        if goal.path is not None and goal.max_speed_mps > 0.0:
            s_m = goal.s_m + goal.max_speed_mps * DT_S
            self.place = point_at(goal.path, s_m)
        return goal

    def to_the_end(self, most_s: float = 900.0) -> MissionStatus:
        status = self.step().status
        while status.state not in ("done", "failed") and self.t_s < most_s:
            status = self.step().status
            if status.state == "paused" and not status.leg:
                break
        return status


def is_in_row(drive: Drive, row: int) -> bool:
    return abs(drive.place[0] - ROWS[row].start_map_m[0]) < 0.3 and drive.place[1] > LOST_M


def test_lost_once_it_backs_to_where_it_was_sure_enters_anew_and_does_the_row() -> None:
    drive = Drive(lambda d: not (is_in_row(d, 0) and d.backed_out == 0))
    status = drive.to_the_end()
    assert (status.state, status.rows_done) == ("done", (0, 1, 2, 3))
    assert drive.legs.count("backs out to find its row") == 1
    backing_m = [north_m for leg, north_m in drive.north_m if leg.startswith("backs out")]
    assert min(backing_m) == pytest.approx(LOST_M - SURE_M, abs=0.1)


def test_lost_again_in_the_same_row_it_leaves_it_out_does_the_others_and_says_so() -> None:
    drive = Drive(lambda d: not (is_in_row(d, 1) and d.place[1] < 7.0))
    status = drive.to_the_end()
    assert (status.state, sorted(status.rows_done)) == ("done", [0, 2, 3])
    assert status.fact == RowsSkipped((1,))
    assert drive.backed_out == 2


def test_a_row_of_which_nothing_was_ever_seen_may_be_none_and_is_not_left_out() -> None:
    drive = Drive(lambda d: not is_in_row(d, 1), quality=GnssQuality.SINGLE)
    status = drive.to_the_end()
    assert status.state == "failed"
    assert holds(status.fact, NoHeadway, RowLost)
    assert status.rows_done == (0,)


def test_where_row_after_row_is_lost_it_does_not_go_on_for_ever() -> None:
    drive = Drive(lambda d: not any(is_in_row(d, row) for row in range(4)))
    status = drive.to_the_end()
    assert status.state == "failed"
    assert holds(status.fact, NoHeadway, RowLost)
    assert status.rows_done == ()


@pytest.mark.parametrize(
    ("blind", "fact"),
    [(None, None), (False, PictureFrozen(0.05))],
    ids=["no camera", "camera fails"],
)
def test_without_a_camera_that_could_find_the_row_it_stands_and_waits(
    blind: bool | None, fact: Fact | None
) -> None:
    drive = Drive(lambda d: blind if is_in_row(d, 0) else True, fact)
    status = drive.to_the_end()
    assert status.state == "failed"
    assert holds(status.fact, NoHeadway, RowLost)
    assert drive.backed_out == 0


def test_found_aside_of_its_row_it_backs_out_before_the_row_instead_of_steering_over_plants() -> (
    None
):
    def sees(drive: Drive) -> bool:
        is_lost = is_in_row(drive, 0) and drive.place[1] < LOST_M + 0.3 and not drive.backed_out
        drive.aside_m = 0.2 if is_in_row(drive, 0) and not drive.backed_out else 0.0
        return not is_lost

    drive = Drive(sees)
    status = drive.to_the_end()
    assert status.state == "done"
    backing_m = [north_m for leg, north_m in drive.north_m if leg.startswith("backs out")]
    assert min(backing_m) < ROWS[0].start_map_m[1]


def test_a_person_who_pauses_it_while_it_backs_out_can_let_it_go_on() -> None:
    drive = Drive(lambda d: not (is_in_row(d, 0) and d.backed_out == 0))
    while drive.step().status.leg != "backs out to find its row":
        assert drive.t_s < 200.0
    drive.mission.step(at(*drive.place, drive.t_s), [event("pause")])
    assert drive.mission.step(at(*drive.place, drive.t_s)).status.state == "paused"
    drive.mission.step(at(*drive.place, drive.t_s), [event("resume")])
    assert drive.to_the_end().rows_done == (0, 1, 2, 3)
