from __future__ import annotations

import math

import pytest

from agribot.autonomy.weeds.poses import PoseHistory
from tests.autonomy.weeds.weed_field import make_estimate


def history(*estimates: tuple[float, float, float, float]) -> PoseHistory:
    poses = PoseHistory()
    for t_s, x_m, y_m, yaw_rad in estimates:
        poses.add(make_estimate(t_s, x_m, y_m, yaw_rad))
    return poses


def test_a_pose_between_two_estimates_lies_on_the_line_between_them() -> None:
    pose = history((0.0, 0.0, 0.0, 0.0), (0.02, 0.01, -0.02, 0.1)).at(0.005)
    assert pose is not None
    assert (pose.x_map_m, pose.y_map_m, pose.yaw_map_rad) == pytest.approx((0.0025, -0.005, 0.025))


def test_yaw_is_interpolated_across_the_half_turn() -> None:
    pose = history((0.0, 0.0, 0.0, math.pi - 0.02), (0.1, 0.0, 0.0, -math.pi + 0.04)).at(0.05)
    assert pose is not None
    assert pose.yaw_map_rad == pytest.approx(-math.pi + 0.01)


def test_the_newest_estimate_itself_is_found() -> None:
    pose = history((0.0, 0.0, 0.0, 0.0), (0.02, 1.0, 2.0, 0.3)).at(0.02)
    assert pose is not None
    assert (pose.x_map_m, pose.y_map_m) == (1.0, 2.0)


def test_covariance_comes_with_the_pose() -> None:
    poses = PoseHistory()
    poses.add(make_estimate(0.0, 0.0, 0.0, 0.0, pos_std_m=0.1))
    poses.add(make_estimate(0.02, 0.0, 0.0, 0.0, pos_std_m=0.2))
    early, late = poses.at(0.004), poses.at(0.016)
    assert early is not None
    assert late is not None
    assert early.cov[0] == pytest.approx(0.01)
    assert late.cov[0] == pytest.approx(0.04)


@pytest.mark.parametrize("t_s", [-0.01, 0.05, 5.0])
def test_times_outside_the_memory_have_no_pose(t_s: float) -> None:
    assert history((0.0, 0.0, 0.0, 0.0), (0.02, 0.0, 0.0, 0.0)).at(t_s) is None


def test_an_empty_memory_has_no_pose() -> None:
    assert PoseHistory().at(0.0) is None


def test_nothing_is_invented_inside_a_gap_of_the_estimates() -> None:
    assert history((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0)).at(0.5) is None


def test_an_estimate_that_is_not_ok_is_not_remembered() -> None:
    poses = PoseHistory()
    poses.add(make_estimate(0.0, 0.0, 0.0, 0.0, ok=False))
    assert poses.at(0.0) is None


def test_old_poses_are_forgotten_and_recent_ones_kept() -> None:
    poses = PoseHistory(span_s=1.0)
    for i in range(1000):
        poses.add(make_estimate(0.02 * i, 0.02 * i, 0.0, 0.0))
    newest_s = 0.02 * 999
    assert poses.at(newest_s - 1.1) is None
    kept = poses.at(newest_s - 0.9)
    assert kept is not None
    assert kept.x_map_m == pytest.approx(newest_s - 0.9)


def test_a_late_duplicate_does_not_disturb_the_order() -> None:
    poses = history((0.0, 0.0, 0.0, 0.0), (0.02, 1.0, 0.0, 0.0), (0.01, 9.0, 0.0, 0.0))
    pose = poses.at(0.01)
    assert pose is not None
    assert pose.x_map_m == pytest.approx(0.5)
