"""When wheels have lost their way, and when they cannot have moved the robot at all."""

from __future__ import annotations

import math

import pytest

from agribot.autonomy.estimate.filter.models import velocity_variance
from agribot.autonomy.estimate.witnesses.lost_way import can_be_of_wheels, have_lost_way
from agribot.core.messages import GnssFix, GnssQuality

STD_MPS = 0.03


@pytest.mark.parametrize(
    ("shown_mps", "driven"),
    [
        ((0.4, 0.0), (0.4, 0.0)),  # they grip
        ((0.0, 0.0), (0.4, 0.0)),  # they spin
        ((-0.2, 0.0), (-0.4, 0.0)),  # backwards
        ((0.1, 0.15), (0.3, 0.5)),  # it turns about a wheel that is held
    ],
)
def test_wheels_that_lose_some_of_their_way_move_a_robot_so(
    shown_mps: tuple[float, float], driven: tuple[float, float]
) -> None:
    assert can_be_of_wheels(shown_mps, driven, STD_MPS)


@pytest.mark.parametrize(
    ("shown_mps", "driven"),
    [
        ((0.5, 0.0), (0.0, 0.0)),  # its wheels stand
        ((0.8, 0.0), (0.4, 0.0)),  # faster than they turn
        ((-0.4, 0.0), (0.4, 0.0)),  # the other way
        ((0.0, 0.5), (0.4, 0.0)),  # aside, on the straight
    ],
)
def test_a_robot_that_moves_otherwise_is_carried(
    shown_mps: tuple[float, float], driven: tuple[float, float]
) -> None:
    assert not can_be_of_wheels(shown_mps, driven, STD_MPS)


def test_velocities_that_scatter_or_of_which_nothing_is_stated_tell_nothing_of_it() -> None:
    fix = GnssFix(
        t_s=0.0, lat_deg=0.0, lon_deg=0.0, alt_m=0.0, pos_std_m=1.0, quality=GnssQuality.SINGLE
    )
    for stated_mps in (0.3, fix.velocity_std_mps):
        std_mps = math.sqrt(velocity_variance(stated_mps, 0.0, 0.0, 0.1))
        assert not can_be_of_wheels((0.4, 0.0), (0.4, 0.0), std_mps)


def test_wheels_have_lost_their_way_that_are_off_for_long_by_more_than_noise() -> None:
    assert have_lost_way(-0.3, 0.05**2, is_steady=True)
    assert not have_lost_way(-0.3, 0.05**2, is_steady=False), "a single outlier"
    assert not have_lost_way(-0.1, 0.05**2, is_steady=True), "no more than noise"
