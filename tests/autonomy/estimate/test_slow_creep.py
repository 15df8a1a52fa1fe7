"""Fixes that creep by millimetres a second while the robot drives, without any noise."""

from __future__ import annotations

import pytest

from agribot.autonomy.estimate.witnesses.slow_creep import CreepMark, SlowCreep

PERIOD_S, VELOCITY_MPS, WALK_M2_PER_S = 0.1, 0.03, 0.0018**2
ROW_S = 20.0  # a row of 8 m, and back


def drive(creep_mps: complex, lasts_s: float = 80.0, lag_s: float = 0.0) -> SlowCreep:
    """Drive to and fro along rows to the East, with velocities that lag behind."""
    watch = SlowCreep()
    for k in range(round(lasts_s / PERIOD_S)):
        t_s = k * PERIOD_S
        led_mps = 0.4 if t_s % (2.0 * ROW_S) < ROW_S else -0.4
        off_m = creep_mps * t_s + lag_s * led_mps
        mark = CreepMark(t_s, off_m, k * PERIOD_S**2, led_mps + 0j, 0.4 * t_s, 0.01**2)
        watch.add(mark, VELOCITY_MPS, WALK_M2_PER_S)
    return watch


@pytest.mark.parametrize(("creep_mps", "within_s"), [(0.014, 21.5), (0.011, 31.5), (0.009, 61.5)])
def test_a_creep_of_millimetres_a_second_is_doubted(creep_mps: float, within_s: float) -> None:
    across = drive(1j * creep_mps, within_s).doubt
    assert across is not None
    assert abs(across.apart_m) == pytest.approx(creep_mps * across.window_s, rel=0.06)


def test_a_creep_of_5_mm_s_is_not_distinguished_from_velocities_that_are_off_for_good() -> None:
    assert drive(0.005j, 100.0).doubt is None


def test_a_velocity_that_lags_behind_a_turn_is_no_creep() -> None:
    assert drive(0j, lag_s=0.2).doubt is None


def test_what_a_creep_may_have_done_unseen_grows_with_the_time_since_the_last_stand() -> None:
    early, late = drive(0j, 25.0).widest, drive(0j, 85.0).widest
    assert early is not None and late is not None
    assert early.std_m == pytest.approx(0.055, abs=0.005)
    assert late.std_m == pytest.approx(0.15, abs=0.01)


def stand(watch: SlowCreep, off_m: complex, lasts_s: float) -> SlowCreep:
    for k in range(round(lasts_s / PERIOD_S)):
        gaps2_s2 = 8.0 + k * PERIOD_S**2
        mark = CreepMark(80.0 + k * PERIOD_S, off_m, gaps2_s2, 0j, 32.0, 0.01**2)
        watch.add(mark, VELOCITY_MPS, WALK_M2_PER_S)
    return watch


def test_a_creep_that_ends_when_the_robot_stands_stays_doubted_until_a_person_has_looked() -> None:
    watch = stand(drive(0.01j), 0.8j, 120.0)
    assert watch.doubt is not None
    watch.restart()
    assert watch.doubt is None and watch.widest is None


def test_wheels_that_stand_for_20_s_have_judged_the_fixes() -> None:
    judged = stand(drive(0j), 0j, 22.0).widest
    assert judged is None
