"""Drawn views along rows to the horizon: what is labelled, and how many are asked for."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.messages import PlantClass
from agribot.lab.train.losses import IGNORED
from agribot.lab.train.simulated import draw_front


def test_a_front_view_names_near_plants_and_leaves_far_ones_out() -> None:
    (view,) = draw_front(np.random.default_rng([3, 1]), 1)
    assert view.image_rgb.shape == (480, 640, 3) and view.image_rgb.dtype == np.uint8
    near, far = view.label[240:], view.label[:240]
    assert {PlantClass.CROP, PlantClass.WEED, PlantClass.SOIL} <= set(np.unique(near).tolist())
    assert (near == IGNORED).mean() < (far == IGNORED).mean()
    numbered = view.plants.number > 0
    assert set(np.unique(view.label[numbered]).tolist()) <= {
        PlantClass.CROP, PlantClass.WEED, IGNORED,
    }  # fmt: skip
    assert view.plants.number.max() == len(view.plants.kind) > 20


def test_the_same_state_gives_the_same_front_view() -> None:
    first, again = (next(draw_front(np.random.default_rng(8), 1)) for _ in range(2))
    np.testing.assert_array_equal(first.image_rgb, again.image_rgb)
    np.testing.assert_array_equal(first.label, again.label)


def test_a_count_of_front_views_below_zero_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "--front-images", "-1", "--out", "unused"]) == 2
    assert "--front-images -1: out of range; give at least 0" in capsys.readouterr().err
