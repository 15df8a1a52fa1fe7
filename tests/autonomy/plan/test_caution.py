"""Slower where the row is known less well, and not at all where it is lost."""

from __future__ import annotations

import math

import msgspec
import pytest

from agribot.autonomy.plan.mission.caution import (
    BACK_S,
    CREEP_RATIO,
    PATIENCE_S,
    WAIT_S,
    CropGuard,
    across_std_m,
    caution_ratio,
    protection_limit_m,
)
from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig, MissionConfig
from agribot.core.facts import (
    CameraAndGnssDisagree,
    DeadReckoning,
    Fact,
    GnssSilent,
    MayBeOffRow,
    NoHeadway,
    PictureFrozen,
)
from agribot.core.messages import Estimate, GnssQuality, Goal, RequestWord
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import FARM_START, MISSION, at, event, point_at
from tests.finding import holds
from tests.robot_parts import plain_rover

CONFIG = MissionConfig()


def known(east_std_m: float, north_std_m: float) -> Estimate:
    return Estimate(
        t_s=0.0, x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0, v_mps=0.0, yaw_rate_radps=0.0,
        slip_rad=0.0, pose_cov=(east_std_m**2, 0, 0, 0, north_std_m**2, 0, 0, 0, 0.01),
        pos_std_m=max(east_std_m, north_std_m), yaw_std_rad=0.1, quality=GnssQuality.SINGLE,
        ok=True,
    )  # fmt: skip


def test_only_the_part_across_the_row_counts() -> None:
    estimate = known(0.05, 2.0)
    assert across_std_m(estimate, math.pi / 2) == pytest.approx(0.05)
    assert across_std_m(estimate, 0.0) == pytest.approx(2.0)
    turned = msgspec.structs.replace(known(0.0, 0.0), pose_cov=(1, -1, 0, -1, 1, 0, 0, 0, 0.01))
    assert across_std_m(turned, math.pi / 4) == pytest.approx(math.sqrt(2.0))
    assert across_std_m(turned, -math.pi / 4) == pytest.approx(0.0)


def test_speed_falls_to_a_creep_and_then_to_nothing() -> None:
    assert caution_ratio(CONFIG.full_speed_std_m, CONFIG) == 1.0
    assert caution_ratio(CONFIG.max_row_std_m, CONFIG) == pytest.approx(CREEP_RATIO)
    assert caution_ratio(CONFIG.max_row_std_m + 0.01, CONFIG) == 0.0
    assert caution_ratio(math.nan, CONFIG) == 0.0
    steps = [caution_ratio(0.01 * step, CONFIG) for step in range(26)]
    assert steps == sorted(steps, reverse=True)


LIMIT_M = 0.3
DISAGREE = CameraAndGnssDisagree(0.4, is_left_open=True)


def judged(guard: CropGuard, t_s: float, level_m: float) -> Fact | None:
    estimate = msgspec.structs.replace(known(0.05, 0.05), row_seen=True)
    return guard.judge(
        msgspec.structs.replace(estimate, t_s=t_s, across_protection_m=level_m), LIMIT_M
    )


def test_the_limit_is_what_lies_between_the_wheels_and_the_crop_less_the_tracking() -> None:
    drive = plain_rover().drive
    inside_m = (drive.track_m - drive.wheel_width_m) / 2.0
    assert 0.2 < protection_limit_m(drive) < inside_m
    assert protection_limit_m(drive, 0.6) < protection_limit_m(drive, 1.0)
    assert protection_limit_m(drive, 1.0) == protection_limit_m(drive)


def test_above_the_limit_the_tool_is_off_and_the_robot_creeps_then_stands_and_goes_on() -> None:
    guard = CropGuard()
    assert judged(guard, 0.0, 0.29) is None
    assert guard.may_work
    assert judged(guard, 1.0, 0.35) is None
    assert not guard.may_work
    assert guard.ratio == CREEP_RATIO
    assert judged(guard, 0.9 + PATIENCE_S, 0.35) is None
    assert judged(guard, 1.1 + PATIENCE_S, 0.35) == MayBeOffRow(0.35, 0.3)
    assert guard.ratio == 0.0
    assert judged(guard, 30.0, 0.2) is None
    assert guard.may_work


def test_a_level_that_rides_up_and_down_at_the_limit_is_one_warning() -> None:
    guard = CropGuard()
    reasons = [judged(guard, t_s, 1.0 if t_s % 2.0 == 0.0 else 0.2) for t_s in range(20)]
    assert reasons == [MayBeOffRow(1.0, 0.3)] * 20
    assert judged(guard, 18.0 + BACK_S, 0.2) is None


def test_far_above_the_limit_it_stands_at_once_unless_a_person_bids_it_creep_on() -> None:
    guard = CropGuard()
    assert judged(guard, 0.0, 1.0)
    assert guard.ratio == 0.0
    guard.restart()
    assert judged(guard, 1.0, 1.0) is None
    assert guard.ratio == CREEP_RATIO
    assert judged(guard, 1.1 + PATIENCE_S, 1.0)
    guard.leave()
    assert judged(guard, 40.0, math.inf)


def test_a_robot_that_only_knows_little_creeps_on_until_it_may_see_its_row_again() -> None:
    guard, unsure = CropGuard(), known(0.2, 0.2)
    unsure = msgspec.structs.replace(
        unsure, across_protection_m=0.66, across_unknown_m=0.66, row_seen=False
    )
    for t_s in (0.0, PATIENCE_S + 1.0):
        assert guard.judge(msgspec.structs.replace(unsure, t_s=t_s), LIMIT_M) is None
        assert guard.ratio == CREEP_RATIO
    assert guard.judge(msgspec.structs.replace(unsure, t_s=60.0), LIMIT_M)
    assert guard.ratio == 0.0
    for change in (
        {"fact": PictureFrozen(0.05)},
        {"across_unknown_m": 0.66 / 1.6},  # the GNSS may lie
        {"row_seen": None},  # neither a camera nor corrections show it
    ):
        assert CropGuard().judge(msgspec.structs.replace(unsure, **change), LIMIT_M)


def test_without_a_camera_and_corrections_it_stands_at_the_limit_until_a_person_looks() -> None:
    guard, blind = CropGuard(), known(0.1, 0.1)
    blind = msgspec.structs.replace(blind, across_protection_m=0.31, across_unknown_m=0.31)
    assert guard.judge(blind, LIMIT_M) == MayBeOffRow(0.31, 0.3)
    assert guard.ratio == 0.0
    guard.restart()
    assert guard.judge(blind, LIMIT_M) is None
    assert guard.ratio == CREEP_RATIO


def test_without_a_camera_it_waits_for_its_fix_before_it_passes_plants_with_the_tool_off() -> None:
    guard = CropGuard()
    unsure = msgspec.structs.replace(
        known(0.1, 0.1), quality=GnssQuality.RTK_FLOAT, across_protection_m=0.35,
        across_unknown_m=0.35,
    )  # fmt: skip
    for t_s in (0.0, WAIT_S - 1.0):
        assert guard.judge(msgspec.structs.replace(unsure, t_s=t_s), LIMIT_M)
        assert guard.ratio == 0.0
    assert guard.judge(msgspec.structs.replace(unsure, t_s=WAIT_S + 1.0), LIMIT_M) is None
    assert guard.ratio == CREEP_RATIO
    back = msgspec.structs.replace(unsure, t_s=WAIT_S + 2.0, across_protection_m=0.1)
    assert guard.judge(back, LIMIT_M) is None
    assert guard.may_work


class Ride:
    """A mission over two rows of 4 m, its robot always where it should be."""

    def __init__(self) -> None:
        rows = lay_rows(FieldConfig(row_count=2, row_length_m=4.0))
        self.path = plan_rows(rows, FARM_START, plain_rover(), MISSION)
        self.mission = Mission(PaperTask(lambda _: self.path, rows, clearance_m=LIMIT_M), MISSION)
        self.t_s = 0.0
        for _ in range(100):
            self.be_at(0.0)

    def be_at(
        self,
        s_m: float,
        level_m: float = 0.1,
        contradiction: Fact | None = None,
        action: RequestWord | None = None,
        fact: Fact | None = None,
        row_seen: bool | None = None,
    ) -> Goal:
        self.t_s += 0.02
        estimate = msgspec.structs.replace(
            at(*point_at(self.path, s_m), self.t_s, True),
            across_protection_m=level_m, protection_m=level_m, contradiction_fact=contradiction,
            fact=fact, row_seen=row_seen,
        )  # fmt: skip
        return self.mission.step(estimate, [event(action)] if action else [])

    def drive_to(self, s_m: float) -> Goal:
        steps = round(s_m / 0.02)
        return [self.be_at(0.02 * step) for step in range(steps)][-1]

    @property
    def in_row_m(self) -> float:
        return float(self.path.s_m[(self.path.row == 0)][40])


def test_a_mission_in_its_row_obeys_the_level_and_goes_on_by_itself() -> None:
    ride = Ride()
    here_m = ride.in_row_m
    full = ride.drive_to(here_m)
    assert full.tool_on
    creeping = ride.be_at(here_m, 0.4, row_seen=True)
    assert not creeping.tool_on
    assert creeping.max_speed_mps == pytest.approx(CREEP_RATIO * full.max_speed_mps)
    standing = ride.be_at(here_m, 0.6)
    assert standing.max_speed_mps == 0.0
    assert standing.status.state == "running"
    assert holds(standing.status.fact, MayBeOffRow)
    assert ride.be_at(here_m, 0.1).max_speed_mps == full.max_speed_mps


def test_a_mission_that_stands_so_for_long_waits_for_a_person_instead_of_failing() -> None:
    ride = Ride()
    here_m = ride.in_row_m
    ride.drive_to(here_m)
    ticks = round((MISSION.stall_timeout_s + 1.0) / 0.02)
    paused = [ride.be_at(here_m, 0.6) for _ in range(ticks)][-1]
    assert paused.status.state == "paused"
    assert holds(paused.status.fact, NoHeadway, MayBeOffRow)
    resumed = ride.be_at(here_m, 0.6, action="resume")
    assert resumed.status.state == "running"
    assert 0.0 < resumed.max_speed_mps <= 0.1


def test_on_the_headland_the_level_may_be_anything() -> None:
    ride = Ride()
    last_m = float(ride.path.s_m[ride.path.row == 0][-1])
    ride.drive_to(last_m + 0.9)
    assert ride.be_at(last_m + 0.9, 2.0).max_speed_mps > 0.1


def test_where_a_sensor_fails_it_stands_on_the_headland_before_it_may_be_in_the_crop() -> None:
    probe, silent = Ride(), DeadReckoning(GnssSilent(25.0), 0.1, 0.5, is_lost=False)
    last_m = float(probe.path.s_m[probe.path.row == 0][-1])
    probe.drive_to(last_m + 0.9)
    crop_m = last_m + 0.9
    while probe.be_at(crop_m, 0.6).max_speed_mps:
        crop_m += 0.02
    assert crop_m > last_m + 1.4
    ride, before_m = Ride(), crop_m - 0.4
    ride.drive_to(before_m)
    assert ride.be_at(before_m, 0.25, fact=silent).max_speed_mps > 0.1
    assert ride.be_at(before_m, 0.6).max_speed_mps > 0.1
    stands = ride.be_at(before_m, 0.6, fact=silent)
    assert stands.max_speed_mps == 0.0
    assert holds(stands.status.fact, MayBeOffRow)
    assert ride.be_at(before_m, 0.1).max_speed_mps > 0.1  # the fix is back


def test_sensors_that_contradict_each_other_pause_a_mission_until_a_person_resumes_it() -> None:
    ride = Ride()
    here_m = ride.in_row_m
    ride.drive_to(here_m)
    halted = ride.be_at(here_m, contradiction=DISAGREE)
    assert (halted.status.state, halted.max_speed_mps) == ("paused", 0.0)
    assert halted.status.fact == DISAGREE
    assert ride.be_at(here_m).status.state == "paused"
    assert ride.be_at(here_m, action="resume").max_speed_mps > 0.1
