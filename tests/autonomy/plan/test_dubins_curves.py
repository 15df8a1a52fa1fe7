from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agribot.autonomy.plan.ways.curves import SPACING_M, Segment, find_end_pose, length_m, sample
from agribot.autonomy.plan.ways.dubins import find_shortest, list_words
from agribot.core.facts import PathWithoutLength
from agribot.core.pose import Pose2
from tests.finding import refused

poses = st.builds(
    Pose2,
    st.floats(-3.0, 3.0),
    st.floats(-3.0, 3.0),
    st.floats(-math.pi, math.pi),
)


@settings(max_examples=200, deadline=None)
@given(start=poses, end=poses, radius_m=st.floats(0.3, 1.0))
def test_every_word_ends_at_the_wanted_pose(start: Pose2, end: Pose2, radius_m: float) -> None:
    for word in list_words(start, end, radius_m):
        reached = find_end_pose(start, word)
        assert math.dist(reached.xy_m, end.xy_m) < 1e-4
        assert abs(math.remainder(reached.yaw_rad - end.yaw_rad, math.tau)) < 1e-4


@settings(max_examples=200, deadline=None)
@given(start=poses, end=poses)
def test_no_word_is_shorter_than_the_straight_line(start: Pose2, end: Pose2) -> None:
    assert length_m(find_shortest(start, end, 0.5)) >= math.dist(start.xy_m, end.xy_m) - 1e-6


def test_half_turn_to_a_row_two_radii_away_is_a_plain_semicircle() -> None:
    word = find_shortest(Pose2(0.0, 0.0, math.pi / 2), Pose2(1.0, 0.0, -math.pi / 2), 0.5)
    assert length_m(word) == pytest.approx(math.pi * 0.5)


def test_sampled_points_are_dense_and_consistent_with_the_segments() -> None:
    segments = (Segment(1.003, 0.0, 4), Segment(0.77, -2.0), Segment(0.0, 0.0), Segment(2.0, 1.5))
    path = sample(Pose2(1.0, 2.0, 3.0), segments)
    step_m = np.hypot(*np.diff(path.xy_map_m, axis=0).T)
    assert step_m.max() <= SPACING_M + 1e-9
    assert path.s_m[-1] == pytest.approx(length_m(segments))
    end = find_end_pose(Pose2(1.0, 2.0, 3.0), segments)
    assert path.xy_map_m[-1] == pytest.approx(end.xy_m)
    assert math.remainder(path.yaw_map_rad[-1] - end.yaw_rad, math.tau) == pytest.approx(0.0)
    assert np.all(np.abs(path.yaw_map_rad) <= math.pi)
    assert np.all((path.row == 4) == (path.s_m < 1.003))


def test_path_without_length_is_refused() -> None:
    with refused(PathWithoutLength):
        sample(Pose2(0.0, 0.0, 0.0), (Segment(0.0, 0.0),))
