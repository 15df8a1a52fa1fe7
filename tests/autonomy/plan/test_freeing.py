"""Stuck, the robot backs out along its own track and tries again, a few times at one place."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.freeing import LEAST_BACK_M, SAME_PLACE_M, TRIES, Trail
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig, MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import JustSetOff, Stuck
from agribot.core.geo import is_backwards
from agribot.core.messages import Estimate, Goal, Path
from agribot.core.pose import Pose2
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import FARM_START, MISSION, at, event, point_at
from tests.robot_parts import plain_rover

ROWS = lay_rows(FieldConfig(row_count=2, row_length_m=6.0))  # North, 1 m apart, from (1, 2)
DT_S, HELD_S = 0.1, 3.0
BACKS_OUT = "backs out to try again"
STUCK = Stuck(0.5, 2.5, 0.0)


def plan(here: Estimate) -> Path:
    return plan_rows(ROWS, (here.x_map_m, here.y_map_m, math.pi / 2), plain_rover(), MISSION)


class Drive:
    """A robot that goes exactly where its mission wants, but where a clod holds it."""

    def __init__(
        self,
        clod_m: float,
        holds: int,
        config: MissionConfig = MISSION,
        clearance_m: float = math.inf,
        protection_m: float = 0.0,
    ) -> None:
        """`clod_m` along the first row a clod holds it a number of times."""
        self.mission = Mission(PaperTask(plan, ROWS, clearance_m=clearance_m), config)
        self.protection_m = protection_m
        self.clod_north_m, self.holds = 2.0 + clod_m, holds
        self.place = FARM_START[:2]
        self.yaw_rad = math.pi / 2
        self.t_s = self.held_s = 0.0
        self.is_stopped = False  # by the gate: the mission does not free the robot
        self.legs: list[str] = []
        self.north_m: list[float] = []
        self.left_m: list[float] = []  # of its path, which runs North here, it is to drive

    def step(self) -> Goal:
        self.mission.free(STUCK if self.held_s >= HELD_S else None)
        goal = self.mission.step(self.look())
        self.t_s += DT_S
        self.north_m.append(self.place[1])
        here = self.look()
        self.left_m.append(self.mission.relate_to_path(here).x_map_m - here.x_map_m)
        if goal.status.leg not in self.legs[-1:]:
            self.legs.append(goal.status.leg)
        self._move(goal)
        if self.held_s >= HELD_S and not goal.frees_itself:
            self.is_stopped = True
        return goal

    def look(self) -> Estimate:
        return msgspec.structs.replace(
            at(*self.place, self.t_s),
            yaw_map_rad=self.yaw_rad,
            across_protection_m=self.protection_m,
        )

    def _move(self, goal: Goal) -> None:
        if self.held_s >= HELD_S:
            self.holds, self.held_s = self.holds - 1, 0.0
        if goal.path is None or goal.max_speed_mps == 0.0:
            return
        s_m = goal.s_m + goal.max_speed_mps * DT_S
        there = point_at(goal.path, s_m)
        yaws_rad = np.unwrap(goal.path.yaw_map_rad)
        self.yaw_rad = float(np.interp(s_m, goal.path.s_m, yaws_rad))
        meets = self.place[1] <= self.clod_north_m < there[1] and there[0] < 1.3
        if not (meets and self.holds):
            self.place, self.held_s = there, 0.0
            return
        self.held_s += DT_S

    def to_the_end(self) -> Goal:
        goal = self.step()
        while (
            goal.status.state not in ("done", "failed") and not self.is_stopped and self.t_s < 300.0
        ):
            goal = self.step()
        return goal

    @property
    def tries(self) -> int:
        return self.legs.count(BACKS_OUT)


@pytest.mark.parametrize("holds", range(1, len(TRIES) + 1))
def test_held_by_a_clod_it_backs_out_as_it_came_and_does_its_rows(holds: int) -> None:
    drive = Drive(clod_m=3.0, holds=holds)
    status = drive.to_the_end().status
    assert (status.state, sorted(status.rows_done)) == ("done", [0, 1])
    assert drive.tries == holds
    first = next(k for k, north_m in enumerate(drive.north_m) if north_m > drive.clod_north_m - 0.1)
    passed = next(k for k, north_m in enumerate(drive.north_m) if north_m > drive.clod_north_m)
    back_m = drive.clod_north_m - min(drive.north_m[first:passed])
    assert back_m == pytest.approx(TRIES[holds - 1].back_m, abs=0.1)


@pytest.mark.parametrize("holds", range(1, len(TRIES) + 1))
def test_what_a_run_up_does_not_climb_it_meets_a_little_aside_and_then_drives_on_its_path(
    holds: int,
) -> None:
    drive = Drive(clod_m=3.0, holds=holds)
    drive.to_the_end()
    beyond_m = drive.clod_north_m + SAME_PLACE_M
    before = drive.north_m.index(max(north_m for north_m in drive.north_m if north_m < 3.0))
    passed = next(k for k, north_m in enumerate(drive.north_m) if north_m > drive.clod_north_m)
    beyond = next(k for k, north_m in enumerate(drive.north_m) if north_m > beyond_m + 0.1)
    assert set(drive.left_m[:before]) == {0.0}
    assert drive.left_m[passed] == pytest.approx(TRIES[holds - 1].left_m)
    assert set(drive.left_m[beyond:]) == {0.0}


def test_a_little_aside_it_has_that_much_less_room_to_the_crop() -> None:
    """It may be 25 cm off for all it knows: little enough on its path, too much 6 cm beside it."""
    drive = Drive(clod_m=3.0, holds=2, clearance_m=0.28, protection_m=0.25)
    works: dict[float, list[bool]] = {}
    while drive.place[1] < drive.clod_north_m + 0.3:
        goal = drive.step()
        works.setdefault(round(drive.left_m[-1], 3), []).append(goal.tool_on)
    assert any(works[0.0])
    assert not any(works[TRIES[1].left_m][1:]), "from the first tick in which it is judged there"


@pytest.mark.parametrize("free_tries", [0, 1, 3])
def test_what_holds_it_more_often_than_it_may_try_stops_it_for_a_person(free_tries: int) -> None:
    drive = Drive(3.0, 99, MissionConfig(free_tries=free_tries))
    drive.to_the_end()
    assert drive.is_stopped
    assert drive.tries == free_tries


def test_after_a_person_has_looked_it_may_try_anew() -> None:
    drive = Drive(3.0, MISSION.free_tries + 2)
    drive.to_the_end()
    assert drive.is_stopped
    assert drive.tries == MISSION.free_tries
    drive.mission.step(drive.look(), [event("stop"), event("clear_stop")])
    drive.mission.step(drive.look(), [event("resume")])
    drive.is_stopped = False
    status = drive.to_the_end().status
    assert (status.state, sorted(status.rows_done)) == ("done", [0, 1])


def test_a_robot_that_has_only_just_set_off_has_no_ground_behind_it_that_it_knows() -> None:
    trail = Trail()
    trail.add(Pose2(0.0, 0.0, 0.0))
    trail.add(Pose2(LEAST_BACK_M / 2.0, 0.0, 0.0))
    with pytest.raises(MissionError) as refused:
        trail.plan_back(Pose2(LEAST_BACK_M / 2.0, 0.0, 0.0), 0.3)
    assert refused.value.fact == JustSetOff()


@pytest.mark.parametrize("bend_radpm", [0.0, 0.8, -0.8])
def test_it_backs_along_the_bend_on_which_it_came(bend_radpm: float) -> None:
    def come(s_m: float) -> Pose2:
        if not bend_radpm:
            return Pose2(s_m, 0.0, 0.0)
        yaw_rad = bend_radpm * s_m
        return Pose2(
            math.sin(yaw_rad) / bend_radpm, (1.0 - math.cos(yaw_rad)) / bend_radpm, yaw_rad
        )

    trail = Trail()
    for s_m in np.arange(0.0, 1.0, 0.01).tolist():
        trail.add(come(s_m))
    path = trail.plan_back(come(1.0), 0.5)
    assert is_backwards(path.xy_map_m, path.yaw_map_rad)[:-1].all()
    then = come(1.0 - float(path.s_m[-1]))
    assert path.xy_map_m[-1] == pytest.approx(then.xy_m, abs=0.02)
    assert path.yaw_map_rad[-1] == pytest.approx(then.yaw_rad, abs=0.03)


def test_what_the_wheels_only_claimed_is_no_way_that_it_came() -> None:
    """Corrected backwards while its wheels spin, it has come by less than it believed."""
    trail = Trail()
    for s_m in (0.0, 0.1, 0.2, 0.3, 0.4, 0.25, 0.35, 0.2):
        trail.add(Pose2(s_m, 0.0, 0.0))
    assert trail.length_m == pytest.approx(0.2)
    trail.add(Pose2(9.0, 9.0, 1.0))
    assert trail.length_m == 0.0, "it went on elsewhere"
