from __future__ import annotations

import numpy as np
import pytest

from agribot.core.errors import ConfigError
from agribot.core.messages import PlantClass
from agribot.lab.train.augment import choose_windows
from agribot.lab.train.picture_stack import BLOCK_PX, PictureStack
from tests.lab.train.drawn_images import SHAPE, drawn_image

PICTURES = [drawn_image(np.random.default_rng(seed)) for seed in range(4)]


def test_pictures_of_different_sizes_are_refused() -> None:
    image_rgb, label = PICTURES[0]
    with pytest.raises(ConfigError, match="same size"):
        PictureStack([*PICTURES, (image_rgb[:64], label[:64])], 5)
    with pytest.raises(ConfigError, match="at least 1"):
        PictureStack([], 0)


def test_weeds_are_counted_in_whole_blocks() -> None:
    stack, chosen = PictureStack(PICTURES, 4), np.arange(4)
    top, left = np.array([0, 8, 16, 24]), np.array([8, 0, 32, 16])
    counted = stack.count_weeds(chosen, top, left, np.full(4, 8 * BLOCK_PX))
    for (_, label), row, column, weeds in zip(PICTURES, top, left, counted, strict=True):
        window = label[row : row + 64, column : column + 64]
        assert weeds == (window == PlantClass.WEED).sum()


def test_windows_lie_within_their_pictures_and_show_more_weeds_than_chance() -> None:
    stack, rng = PictureStack(PICTURES, 4), np.random.default_rng(3)
    chosen = stack.choose(400, rng)
    windows = choose_windows(stack, chosen, 40, rng)
    assert (windows.top >= 0).all() and (windows.left >= 0).all()
    assert (windows.top + windows.source_px <= SHAPE[0]).all()
    assert (windows.left + windows.source_px <= SHAPE[1]).all()
    weeds = (windows.cut_pixels(stack.labels[chosen]) == PlantClass.WEED).float().mean()
    assert float(weeds) > 1.1 * np.mean([label == PlantClass.WEED for _, label in PICTURES])
