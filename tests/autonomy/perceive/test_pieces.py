"""Connected pieces of a mask, compared with SciPy's and with pieces that are known."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy import ndimage

from agribot.autonomy.perceive.boundaries import boundary_counts
from agribot.autonomy.perceive.pieces import find_windows, label_pieces
from agribot.core.messages import PlantClass

TOUCHING = np.ones((3, 3), dtype=bool)


def draw_mask(text: str) -> npt.NDArray[np.bool_]:
    return np.array([[letter == "#" for letter in line] for line in text.split()])


@pytest.mark.parametrize("density", [0.0, 0.02, 0.2, 0.45, 0.7, 1.0])
def test_pieces_are_those_of_scipy_with_the_same_numbers(density: float) -> None:
    rng = np.random.default_rng(4)
    for shape in ((60, 90), (1, 40), (40, 1), (2, 2)):
        mask = rng.uniform(size=shape) < density
        expected, expected_count = ndimage.label(mask, TOUCHING)
        labels, count = label_pieces(mask)
        assert count == expected_count
        np.testing.assert_array_equal(labels, expected)
        assert find_windows(labels, count) == ndimage.find_objects(expected)


def test_a_comb_is_one_piece_however_late_its_teeth_meet() -> None:
    mask = draw_mask("#.#.#.#.# #.#.#.#.# #########")
    labels, count = label_pieces(mask)
    assert count == 1
    np.testing.assert_array_equal(labels, mask)


def test_a_spiral_is_one_piece() -> None:
    labels, count = label_pieces(
        draw_mask("####### ......# #####.# #...#.# #.###.# #.....# #######")
    )
    assert (count, set(np.unique(labels))) == (1, {0, 1})


def test_the_right_edge_does_not_touch_the_left_one() -> None:
    assert label_pieces(draw_mask("..# #.. ..#"))[1] == 3


def test_pieces_that_touch_at_a_corner_are_one() -> None:
    assert label_pieces(draw_mask("#.. .#. ..#"))[1] == 1


def test_a_number_without_pixels_has_no_window() -> None:
    labels = np.array([[1, 0, 3], [1, 0, 0]])
    assert find_windows(labels, 4) == [
        (slice(0, 2), slice(0, 1)), None, (slice(0, 1), slice(2, 3)), None
    ]  # fmt: skip


def test_outlines_lie_on_each_other_where_the_nearest_pixel_is_within_the_tolerance() -> None:
    rng = np.random.default_rng(9)
    for shape in ((90, 160), (200, 700)):  # tolerances of 1.4 and 5.5 pixels
        truth, guess = (
            (ndimage.uniform_filter(rng.normal(size=shape), 9) > 0.1).astype(np.uint8)
            for _ in range(2)
        )
        counts = boundary_counts(truth, guess)
        for kind in (PlantClass.WEED, PlantClass.CROP):
            said, true = (
                (one == kind) & ~ndimage.binary_erosion(one == kind, border_value=1)
                for one in (guess, truth)
            )
            tolerance_px = 0.0075 * np.hypot(*shape)
            near_true = ndimage.distance_transform_edt(~true) < tolerance_px
            near_said = ndimage.distance_transform_edt(~said) < tolerance_px
            assert counts[kind].tolist() == [
                said.sum(), (said & near_true).sum(), true.sum(), (true & near_said).sum()
            ]  # fmt: skip
