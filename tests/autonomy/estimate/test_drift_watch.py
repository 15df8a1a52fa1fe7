"""Fixes that creep slowly: what a standing and a driving robot can detect, without any noise."""

from __future__ import annotations

import pytest

from agribot.autonomy.estimate.witnesses.drift_watch import DriftWatch, Trust, WitnessReport

PERIOD_S = 0.1
# The filter's trust in an RTK receiver in order, and in wheels on soil.
TRUST = Trust(
    fix_m=0.01, bias_m2_per_s=0.0018**2, velocity_mps=0.03, course_rad=0.01, scale_ratio=0.01,
    walk_m2_per_m=0.018**2,
)  # fmt: skip


def find_delay_s(
    creep_mps: float, speed_mps: float = 0.0, flown_mps: float = 0.0, lasts_s: float = 80.0
) -> float | None:
    """Drive with fixes that creep; `flown_mps` is what the receiver's velocity shows beside."""
    watch = DriftWatch()
    for k in range(round(lasts_s / PERIOD_S)):
        t_s = k * PERIOD_S
        watch.add(report(t_s, creep_mps, speed_mps, flown_mps), TRUST)
        if watch.is_drifting:
            return t_s
    return None


def report(t_s: float, creep_mps: float, speed_mps: float, flown_mps: float) -> WitnessReport:
    return WitnessReport(
        t_s=t_s, place_m=complex(creep_mps * t_s, speed_mps * t_s),
        velocity_mps=complex(flown_mps, speed_mps), driven_mps=complex(0.0, speed_mps),
        turn=1.0 + 0j, arm_m=0j, way_m=speed_mps * t_s, turned_rad=0.0,
    )  # fmt: skip


def test_what_a_gyro_is_found_to_have_turned_too_fast_is_no_creep_of_the_fixes() -> None:
    watch = DriftWatch()
    for k in range(900):
        watch.add(report(k * PERIOD_S, 0.0, 0.4, 0.0), TRUST)
        if k == 600:
            watch.straighten(since_s=57.0, rate_radps=0.001)
    assert watch.slow.doubt is None
    assert watch.slow.widest is not None
    assert watch.slow.widest.std_m == pytest.approx(0.15, abs=0.02)


@pytest.mark.parametrize(("creep_mps", "within_s"), [(0.02, 6.0), (0.01, 11.0), (0.005, 21.0)])
def test_a_robot_that_stands_detects_a_creep_of_millimetres_a_second(
    creep_mps: float, within_s: float
) -> None:
    delay_s = find_delay_s(creep_mps)
    assert delay_s is not None and delay_s <= within_s
    assert creep_mps * delay_s < 0.13


def test_the_slowest_creep_that_is_detected_is_slower_while_the_robot_stands() -> None:
    assert find_delay_s(0.0025) and not find_delay_s(0.002)
    assert find_delay_s(0.02, speed_mps=0.4) and not find_delay_s(0.017, speed_mps=0.4)


@pytest.mark.parametrize(("creep_mps", "within_s"), [(0.05, 5.0), (0.03, 11.0), (0.02, 40.5)])
def test_a_robot_that_drives_detects_a_faster_creep_by_its_velocity(
    creep_mps: float, within_s: float
) -> None:
    delay_s = find_delay_s(creep_mps, speed_mps=0.4)
    assert delay_s is not None and delay_s <= within_s


def test_a_velocity_that_is_off_by_millimetres_a_second_does_not_hide_a_creep() -> None:
    """As those of receivers that stand are: 6 mm/s over 38 s of a NEO-M8T."""
    assert find_delay_s(0.015, flown_mps=0.006)
    assert not find_delay_s(0.0, flown_mps=0.006)


def test_a_standing_robot_that_is_carried_is_no_creep() -> None:
    """Its velocity moves with the fixes."""
    assert not find_delay_s(0.02, flown_mps=0.02)
