"""A row on paper is judged by the crop that stands about it, not by its author."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.core.messages import FloatArray, Row
from agribot.core.row_shape import project_on_row
from agribot.sim.row_judge import lay_through_crop

PITCH_M = 1.0


def sow(jitter_m: float = 0.0, seed: int = 0) -> FloatArray:
    """Three rows of 41 plants along East, every 25 cm, at -1, 0 and 1 m North."""
    x_m, row = np.meshgrid(np.arange(41) * 0.25, (-1.0, 0.0, 1.0))
    crop = np.stack([x_m.ravel(), PITCH_M * row.ravel()], axis=1)
    return np.asarray(crop + np.random.default_rng(seed).normal(0.0, jitter_m, crop.shape))


def drawn(off_m: float, turn_deg: float, curvature_radpm: float = 0.0) -> Row:
    """The middle row as somebody drew it, past both its ends: aside and turned about its middle."""
    half = 6.0 * np.array([math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))])
    middle = np.array([5.0, off_m])
    start, end = (middle - half).tolist(), (middle + half).tolist()
    return Row(index=4, start_map_m=tuple(start), end_map_m=tuple(end),
               curvature_radpm=curvature_radpm)  # fmt: skip


@pytest.mark.parametrize(("off_m", "turn_deg"), [(0, 0), (0.3, 0), (-0.2, 1.5), (0.1, -2.0)])
def test_a_drawn_row_is_laid_through_its_crop(off_m: float, turn_deg: float) -> None:
    row = lay_through_crop(drawn(off_m, turn_deg), sow(jitter_m=0.02))
    for end, x_m in ((row.start_map_m, 0.0), (row.end_map_m, 10.0)):
        assert end[1] == pytest.approx(0.0, abs=0.02)
        assert end[0] == pytest.approx(x_m, abs=0.06), "from plant to plant"
    assert row.index == 4


def test_a_row_that_was_drawn_too_short_stays_so() -> None:
    row = Row(index=0, start_map_m=(2.1, 0.1), end_map_m=(6.9, 0.1))
    laid = lay_through_crop(row, sow())
    assert laid.start_map_m == pytest.approx((2.1, 0.0), abs=0.2)
    assert laid.end_map_m == pytest.approx((6.9, 0.0), abs=0.2)


def test_a_row_drawn_beside_all_crop_stays_where_it_is() -> None:
    row = drawn(0.5, 0.0)
    assert lay_through_crop(row, sow()) == row
    assert lay_through_crop(row, np.empty((0, 2))) == row


def test_a_row_drawn_one_row_off_is_the_one_beside_it() -> None:
    """No check can know that another one was meant."""
    row = lay_through_crop(drawn(0.9, 0.0), sow())
    assert row.start_map_m[1] == pytest.approx(PITCH_M, abs=1e-6)


def test_a_bend_is_not_straightened() -> None:
    row = drawn(0.1, 0.0, curvature_radpm=0.01)
    assert lay_through_crop(row, sow()) == row


def test_a_tuft_at_one_end_tells_no_direction() -> None:
    crop = np.array([[0.0, 0.2], [0.05, 0.2], [0.1, 0.2]])
    row = drawn(0.0, 0.0)
    assert lay_through_crop(row, crop) == row
    assert project_on_row(row, 5.0, 0.0).left_m == pytest.approx(0.0)
