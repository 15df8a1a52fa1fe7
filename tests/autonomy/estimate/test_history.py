from __future__ import annotations

import pytest

from agribot.autonomy.estimate.filter.history import Motion, MotionHistory


def straight(history: MotionHistory, last: int = 100) -> None:
    for k in range(last + 1):
        history.append(Motion(k * 0.01, k * 0.004, 0.0, 0.1 * k, 0.4, 10.0))


def test_a_time_between_two_points_is_interpolated() -> None:
    history = MotionHistory()
    straight(history)
    motion = history.at(0.505)
    assert motion is not None
    assert motion.x_m == pytest.approx(50.5 * 0.004)
    assert motion.yaw_rad == pytest.approx(5.05)


def test_what_is_older_than_the_ring_is_unknown() -> None:
    history = MotionHistory(capacity=50)
    straight(history)
    assert history.at(0.2) is None
    assert history.at(0.6) is not None
    assert MotionHistory().at(0.0) is None


def test_a_little_ahead_of_the_wheels_motion_goes_on_and_far_ahead_is_unknown() -> None:
    history = MotionHistory(ahead_s=0.3)
    straight(history)
    motion = history.at(1.05)
    assert motion is not None
    assert motion.x_m == pytest.approx(105 * 0.004)
    assert history.at(1.4) is None
