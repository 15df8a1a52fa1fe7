"""Poses of the plane: a group, and points that go there and back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.core.arithmetic import clamp
from agribot.core.pose import Pose2

POSES = [Pose2(*values) for values in np.random.default_rng(1).uniform(-3.0, 3.0, (6, 3)).tolist()]


def same(a: Pose2, b: Pose2) -> bool:
    apart_rad = math.remainder(a.yaw_rad - b.yaw_rad, math.tau)
    return math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) < 1e-12 and abs(apart_rad) < 1e-12


def test_ahead_of_a_robot_that_looks_north_is_north_and_left_of_it_is_west() -> None:
    pose = Pose2(10.0, 20.0, math.pi / 2.0)
    assert pose.transform(2.0, 0.5) == pytest.approx((9.5, 22.0))
    assert pose.locate(9.5, 22.0) == pytest.approx((2.0, 0.5))
    assert pose.ahead == pytest.approx((0.0, 1.0))
    assert pose.left == pytest.approx((-1.0, 0.0))


@pytest.mark.parametrize("pose", POSES)
def test_a_pose_and_its_inverse_cancel(pose: Pose2) -> None:
    origin = Pose2(0.0, 0.0, 0.0)
    assert same(pose.compose(pose.inverse()), origin)
    assert same(pose.inverse().compose(pose), origin)


def test_poses_chain_in_any_grouping() -> None:
    a, b, c = POSES[:3]
    assert same(a.compose(b).compose(c), a.compose(b.compose(c)))


@pytest.mark.parametrize("pose", POSES)
def test_many_points_go_the_way_of_each(pose: Pose2) -> None:
    ahead_m, left_m = np.random.default_rng(2).uniform(-5.0, 5.0, (2, 20))
    x_m, y_m = pose.transform(ahead_m, left_m)
    for index in range(20):
        one = pose.transform(float(ahead_m[index]), float(left_m[index]))
        assert one == (x_m[index], y_m[index])
    back = pose.locate(x_m, y_m)
    np.testing.assert_allclose(back, (ahead_m, left_m), atol=1e-12)
    np.testing.assert_allclose(
        pose.resolve(*pose.rotate(ahead_m, left_m)), (ahead_m, left_m), atol=1e-12
    )


def test_a_composed_point_is_the_point_of_the_composition() -> None:
    a, b = POSES[:2]
    assert a.compose(b).transform(1.0, 2.0) == pytest.approx(a.transform(*b.transform(1.0, 2.0)))


def test_a_value_is_clamped_to_its_limits_and_what_is_no_number_stays_none() -> None:
    assert [clamp(value, -1.0, 2.0) for value in (-3.0, 0.5, 7.0)] == [-1.0, 0.5, 2.0]
    assert clamp(9, 0, 4) == 4
    assert math.isnan(clamp(math.nan, 0.0, 1.0))
