"""Other light on training pictures: what each change does, and that it moves nothing."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from agribot.lab.train.lights import (
    add_flare,
    cast_shadows,
    change_light,
    expose,
    saturate,
    shake,
    split_balance,
)

SIZE_PX = 32


def paint(red: float, green: float, blue: float, count: int = 1) -> Tensor:
    colour = torch.tensor([red, green, blue]).view(1, 3, 1, 1)
    return colour.expand(count, 3, SIZE_PX, SIZE_PX).clone()


def draw_leaf() -> Tensor:
    """Draw a green square on grey soil."""
    images = paint(100.0, 95.0, 90.0)
    images[:, :, 8:20, 10:26] = torch.tensor([60.0, 130.0, 50.0]).view(1, 3, 1, 1)
    return images


def test_a_shadow_is_as_dark_as_it_is_asked_to_be_and_bluer_than_the_sun() -> None:
    darkest = {}
    for left in (0.6, 0.3):
        shaded = cast_shadows(
            paint(100.0, 100.0, 100.0), np.array([[left]]), np.random.default_rng(3)
        )
        darkest[left] = shaded.amin(dim=(0, 2, 3))
        assert float(shaded.max()) <= 100.0
        assert float(darkest[left][1]) == pytest.approx(100.0 * left, rel=0.05)
        assert darkest[left][0] < darkest[left][1] < darkest[left][2]
    assert (darkest[0.3] < darkest[0.6]).all()


def test_all_the_light_leaves_no_shadow() -> None:
    images = draw_leaf()
    torch.testing.assert_close(
        cast_shadows(images, np.array([[1.0]]), np.random.default_rng(3)), images
    )


def test_exposure_is_a_factor_and_clips_what_is_too_bright() -> None:
    images = torch.cat([paint(40.0, 60.0, 200.0), paint(40.0, 60.0, 200.0)])
    exposed = expose(images, np.array([[1.0], [2.0]]), np.array([[1.0], [1.0]]))
    torch.testing.assert_close(exposed[0], images[0])
    torch.testing.assert_close(exposed[1], paint(80.0, 120.0, 255.0)[0])
    spread = expose(images, np.array([[1.0], [1.0]]), np.array([[1.5], [0.5]]))
    assert float(spread[0, 0, 0, 0]) == 0.0 and float(spread[1, 0, 0, 0]) == pytest.approx(84.0)


def test_a_white_balance_scales_the_channels_dark_and_bright_by_gains_of_their_own() -> None:
    images = torch.cat([paint(2.0, 2.0, 2.0), paint(120.0, 120.0, 120.0)])
    dark, bright = np.array([[1.5, 1.0, 1.0]] * 2), np.array([[1.0, 1.0, 2.0]] * 2)
    changed = split_balance(images, dark, bright)[:, :, 0, 0]
    assert changed[0].tolist() == pytest.approx([3.0, 2.0, 2.0], rel=0.02)
    share = 120.0 / 255.0
    wanted = [120.0 * (1.5 - 0.5 * share), 120.0, 120.0 * (1.0 + share)]
    assert changed[1].tolist() == pytest.approx(wanted, rel=1e-4)


def test_no_saturation_is_grey_and_leaves_the_brightness() -> None:
    images = draw_leaf()
    grey = saturate(images, np.array([[0.0]]))
    assert torch.allclose(grey[:, 0], grey[:, 1]) and torch.allclose(grey[:, 1], grey[:, 2])
    torch.testing.assert_close(grey.mean(dim=1), images.mean(dim=1))


def test_a_flare_only_adds_light() -> None:
    images = draw_leaf()
    flared = add_flare(images, np.random.default_rng(5))
    assert bool((flared >= images).all()) and float((flared - images).max()) > 20.0


def test_a_shaken_camera_keeps_even_ground_and_softens_edges() -> None:
    even = paint(70.0, 80.0, 90.0)
    torch.testing.assert_close(shake(even, np.random.default_rng(2)), even)
    leaf = draw_leaf()
    shaken = shake(leaf, np.random.default_rng(2))
    assert shaken.shape == leaf.shape and len(np.unique(shaken)) > len(np.unique(leaf))


@pytest.mark.parametrize("seed", range(6))
def test_no_light_moves_a_leaf(seed: int) -> None:
    """Of many changed pictures of one scene the mean still shows the leaf in its place."""
    images = draw_leaf().expand(64, -1, -1, -1).clone()
    changed = change_light(images, np.random.default_rng(seed)).mean(dim=0)
    greenness = 2.0 * changed[1] - changed[0] - changed[2]
    is_leaf = greenness > 0.5 * (greenness.max() + greenness.min())
    rows, columns = torch.nonzero(is_leaf, as_tuple=True)
    assert (int(rows.min()), int(rows.max())) == (8, 19)
    assert (int(columns.min()), int(columns.max())) == (10, 25)


def test_about_half_of_the_pictures_stay_as_they_are_and_all_are_pictures() -> None:
    image = draw_leaf()[0]
    changed = change_light(image.expand(200, -1, -1, -1), np.random.default_rng(1))
    unchanged = np.mean([torch.equal(image, one) for one in changed])
    assert 0.3 < unchanged < 0.65
    assert float(changed.min()) >= 0.0 and float(changed.max()) <= 255.0


def test_the_same_state_gives_the_same_light() -> None:
    images = draw_leaf().expand(8, -1, -1, -1)
    first, again = (change_light(images, np.random.default_rng(4)) for _ in range(2))
    assert torch.equal(first, again)
