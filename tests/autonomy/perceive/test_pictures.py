from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.pictures import classify, enlarge
from agribot.core.errors import PerceptionError
from agribot.core.messages import ByteArray, PlantClass


class ByColour:
    """Stands in for a network: samples the image at its own resolution; red weed, green crop."""

    def __init__(self, map_shape: tuple[int, int]) -> None:
        self.map_shape = map_shape
        self.shapes: list[tuple[int, ...]] = []

    def segment(self, image_rgb: ByteArray) -> ClassMap:
        self.shapes.append(image_rgb.shape)
        rows, columns = (
            ((np.arange(n) + 0.5) * (size / n)).astype(int)
            for n, size in zip(self.map_shape, image_rgb.shape[:2], strict=True)
        )
        small = image_rgb[rows[:, None], columns]
        class_id = np.full(self.map_shape, PlantClass.SOIL, np.uint8)
        class_id[small[..., 0] > 127] = PlantClass.WEED
        class_id[small[..., 1] > 127] = PlantClass.CROP
        return ClassMap(
            class_id=class_id, confidence=np.full(self.map_shape, 255, np.uint8), scale_px=(1, 1)
        )


def field(height: int, width: int) -> tuple[ByteArray, ByteArray]:
    """A crop across the middle and a weed in each corner, with the classes of the pixels."""
    image_rgb = np.zeros((height, width, 3), np.uint8)
    h, w = height // 8, width // 8
    image_rgb[3 * h : 5 * h, 2 * w : 6 * w, 1] = 255
    for rows in (slice(0, h), slice(height - h, height)):
        for columns in (slice(0, w), slice(width - w, width)):
            image_rgb[rows, columns, 0] = 255
    class_id = np.full((height, width), PlantClass.SOIL, np.uint8)
    class_id[image_rgb[..., 0] > 0] = PlantClass.WEED
    class_id[image_rgb[..., 1] > 0] = PlantClass.CROP
    return image_rgb, class_id


def agreement(found: ByteArray, truth: ByteArray) -> float:
    assert found.shape == truth.shape
    return float((found == truth).mean())


@pytest.mark.parametrize(
    ("height", "width"), [(96, 128), (480, 640), (966, 1296), (300, 900), (900, 300), (201, 77)]
)
def test_classes_lie_where_the_plants_are_in_any_size_and_shape(height: int, width: int) -> None:
    image_rgb, truth = field(height, width)
    found = classify(ByColour((96, 128)), image_rgb)
    assert agreement(found.class_id, truth) > 0.96
    assert set(np.unique(found.class_id)) == {0, 1, 2}


@pytest.mark.parametrize("tile_px", [(96, 128), (200, 200), (64, 500), (2000, 2000)])
def test_tiles_cover_a_picture_without_gaps_or_shifts(tile_px: tuple[int, int]) -> None:
    image_rgb, truth = field(500, 700)
    found = classify(ByColour((96, 128)), image_rgb, tile_px)
    assert agreement(found.class_id, truth) > 0.97
    assert found.confidence.min() > 80


def test_tiles_show_what_one_look_misses() -> None:
    image_rgb = np.zeros((960, 1280, 3), np.uint8)
    image_rgb[101:105, 203:207, 0] = 255  # a weed smaller than a pixel of the map
    assert PlantClass.WEED not in classify(ByColour((96, 128)), image_rgb).class_id[:90]
    tiled = classify(ByColour((96, 128)), image_rgb, (96, 128)).class_id
    assert (tiled == PlantClass.WEED).sum() == 16
    assert (tiled[101:105, 203:207] == PlantClass.WEED).all()


def test_a_huge_picture_reaches_the_network_reduced() -> None:
    network = ByColour((96, 128))
    image_rgb, truth = field(3000, 4000)
    found = classify(network, image_rgb)
    assert agreement(found.class_id, truth) > 0.98
    assert network.shapes[0][0] < 3 * 96


def test_a_long_picture_is_padded_and_not_stretched() -> None:
    network = ByColour((96, 128))
    classify(network, field(100, 900)[0])
    height, width, _ = network.shapes[0]
    assert width / height == pytest.approx(128 / 96, rel=0.02)


def test_one_pixel_and_one_row_are_classified() -> None:
    for shape in ((1, 1), (1, 5000), (3, 2)):
        assert (
            classify(ByColour((96, 128)), np.zeros((*shape, 3), np.uint8)).class_id.shape == shape
        )


def test_an_empty_picture_and_tiny_tiles_are_refused() -> None:
    with pytest.raises(PerceptionError, match="empty"):
        classify(ByColour((96, 128)), np.zeros((0, 4, 3), np.uint8))
    with pytest.raises(PerceptionError, match="too small"):
        classify(ByColour((96, 128)), np.zeros((40, 40, 3), np.uint8), (4, 4))


def test_enlarging_draws_a_slanted_border_straighter_than_the_nearest_pixel() -> None:
    rows, columns = np.mgrid[0:240, 0:240] + 0.5
    truth = np.where(columns > 0.5 * rows + 60, PlantClass.CROP, PlantClass.SOIL)
    share = (truth == PlantClass.CROP).reshape(30, 8, 30, 8).mean(axis=(1, 3))
    class_id = np.where(share > 0.5, PlantClass.CROP, PlantClass.SOIL).astype(np.uint8)
    confidence = np.round(255 * np.maximum(share, 1.0 - share)).astype(np.uint8)
    nearest = np.repeat(np.repeat(class_id, 8, axis=0), 8, axis=1)
    fine = enlarge(class_id, confidence, (240, 240)).class_id
    assert (fine != truth).mean() < 0.5 * (nearest != truth).mean()


def test_a_map_of_the_right_size_is_left_alone() -> None:
    class_id = np.random.default_rng(0).integers(0, 3, (6, 8), dtype=np.uint8)
    assert enlarge(class_id, np.full((6, 8), 200, np.uint8), (6, 8)).class_id is class_id
