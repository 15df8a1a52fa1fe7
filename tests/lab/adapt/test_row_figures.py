"""Figures of rows are shares of the pixels that rows name."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.core.messages import PlantClass
from agribot.lab.adapt.row_figures import RowTally
from agribot.lab.dataset.classes import UNLABELLED

LABEL = np.full((10, 10), UNLABELLED, np.uint8)
LABEL[6:, :5] = PlantClass.CROP
LABEL[6:, 5:9] = PlantClass.WEED


def test_shares_are_of_the_plants_on_rows_and_between_them() -> None:
    class_id = np.full((10, 10), PlantClass.SOIL, np.uint8)
    class_id[6:8, :5] = PlantClass.CROP
    class_id[8, :5] = class_id[6:9, 5:9] = PlantClass.WEED
    tally = RowTally()
    tally.add(class_id, LABEL)
    figures = tally.make_figures()
    assert figures.on_rows == pytest.approx({"crop": 0.5, "weed": 0.25, "soil": 0.25})
    assert figures.between_rows == pytest.approx({"crop": 0.0, "weed": 0.75, "soil": 0.25})
    assert figures.balanced == pytest.approx(0.625)


def test_a_network_that_calls_everything_crop_has_a_balance_of_one_half() -> None:
    tally = RowTally()
    tally.add(np.full((10, 10), PlantClass.CROP, np.uint8), LABEL)
    assert tally.make_figures().balanced == 0.5


def test_without_plants_between_rows_their_share_is_absent_and_not_zero() -> None:
    tally = RowTally()
    tally.add(np.full((10, 10), PlantClass.CROP, np.uint8), np.where(LABEL == 0, 255, LABEL))
    figures = tally.make_figures()
    assert figures.between_rows is None
    assert figures.balanced is None


def test_the_upper_part_of_a_picture_does_not_count() -> None:
    tally = RowTally()
    label = np.full((10, 10), PlantClass.CROP, np.uint8)
    class_id = np.where(np.arange(10)[:, None] < 3, PlantClass.WEED, PlantClass.CROP)
    tally.add(np.repeat(class_id, 10, axis=1).astype(np.uint8), label)
    assert tally.make_figures().on_rows == {"crop": 1.0, "weed": 0.0, "soil": 0.0}
