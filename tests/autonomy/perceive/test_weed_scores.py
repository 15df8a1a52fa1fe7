"""What a plant network says about stems of weeds, on the ground of one picture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from agribot.autonomy.perceive.weed_scores import NEAR_M
from agribot.core.messages import ByteArray, PlantClass, WeedScores
from tests.autonomy.perceive.drawn_field import GROUND, Disc
from tests.autonomy.perceive.drawn_plants import draw_plants

WEED, CROP = PlantClass.WEED, PlantClass.CROP


def score(*discs: Disc, seen: float = 0.9) -> tuple[WeedScores, ByteArray]:
    plants = draw_plants(*discs, score=seen).plants
    assert plants is not None
    scores = GROUND.score_grid.score(plants)
    cells = np.frombuffer(scores.scores, dtype=np.uint8)
    return scores, cells.reshape(scores.rows, scores.columns)


def place_cells(scores: WeedScores) -> npt.NDArray[np.float64]:
    """Places of the middles of all cells in the body frame, (rows, columns, 2)."""
    row, column = np.indices((scores.rows, scores.columns)) + 0.5
    x_m, y_m = scores.x_body_m + row * scores.cell_m, scores.y_body_m + column * scores.cell_m
    return np.stack([x_m, y_m], axis=-1)


@pytest.mark.parametrize("seen", [0.1, 0.9])
def test_the_surest_cell_is_where_the_weed_stands_also_one_that_is_no_plant_yet(
    seen: float,
) -> None:
    scores, cells = score((0.7, 0.1, 0.04, WEED), seen=seen)
    best = np.unravel_index(cells.argmax(), cells.shape)
    assert np.abs(place_cells(scores)[best] - (0.7, 0.1)).max() < 0.03
    assert cells[best] == pytest.approx(255 * seen, abs=30 * seen)


def test_a_stem_of_crop_scores_no_more_than_bare_soil() -> None:
    assert score((0.7, 0.1, 0.04, CROP))[1].max() == score()[1].max() == 1


def test_only_ground_near_the_camera_counts_as_seen() -> None:
    scores, cells = score((1.4, 0.0, 0.04, WEED))
    gap_m = np.hypot(*(place_cells(scores) - GROUND.camera_xyz_body_m[:2]).transpose(2, 0, 1))
    assert cells.max() == 1
    assert not cells[gap_m > NEAR_M + scores.cell_m].any()
    assert cells[(gap_m > 0.6) & (gap_m < 0.8) & (np.abs(place_cells(scores)[..., 1]) < 0.1)].all()
