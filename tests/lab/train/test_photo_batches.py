from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2")

from agribot.core.messages import PlantClass
from agribot.lab.train.photo_batches import PhotoBatches

# Far apart, so that no change of light makes one the other.
COLOURS = np.array([[250, 30, 30], [30, 250, 30], [20, 20, 60]], dtype=np.uint8)


@pytest.fixture(scope="module")
def batches() -> PhotoBatches:
    label = np.full((300, 400), PlantClass.SOIL, np.uint8)
    label[40:120, 60:200] = PlantClass.CROP
    label[180:260, 240:330] = PlantClass.WEED
    return PhotoBatches([(COLOURS[label], label)] * 2, scale=0.5, batch_size=4, crop_px=96)


def test_a_batch_has_the_shapes_and_ranges_of_a_training_step(batches: PhotoBatches) -> None:
    images, labels = batches(np.random.default_rng(0))
    assert images.shape == (4, 3, 96, 96)
    assert labels.shape == (4, 96, 96)
    assert float(images.min()) >= 0.0
    assert float(images.max()) <= 255.0
    assert set(np.unique(labels.numpy()).tolist()) <= {0, 1, 2}


def test_the_same_generator_gives_the_same_batch_whatever_came_before(
    batches: PhotoBatches,
) -> None:
    first = batches(np.random.default_rng([3, 7]))
    batches(np.random.default_rng(1))
    again = batches(np.random.default_rng([3, 7]))
    other = batches(np.random.default_rng([3, 8]))
    assert bool((first[0] == again[0]).all())
    assert bool((first[1] == again[1]).all())
    assert not bool((first[0] == other[0]).all())


def test_labels_turn_and_shrink_with_their_image(batches: PhotoBatches) -> None:
    agree, total = 0, 0
    for index in range(12):
        images, labels = batches(np.random.default_rng(index))
        red, green, _ = images.numpy().transpose(1, 0, 2, 3)
        seen = np.full(labels.shape, PlantClass.SOIL)
        seen[red - green > 60] = PlantClass.WEED
        seen[green - red > 60] = PlantClass.CROP
        agree += int((seen == labels.numpy()).sum())
        total += labels.numel()
    assert agree / total > 0.97


def test_plants_are_shown_more_often_than_the_pictures_hold_them(batches: PhotoBatches) -> None:
    labels = np.stack([batches(np.random.default_rng(i))[1].numpy() for i in range(12)])
    assert (labels == PlantClass.CROP).mean() > 1.3 * (80 * 140) / (300 * 400)


def test_a_picture_smaller_than_the_crop_is_continued_by_its_mirror_image() -> None:
    label = np.full((40, 50), PlantClass.CROP, np.uint8)
    batches = PhotoBatches([(COLOURS[label], label)], scale=1.0, batch_size=2, crop_px=96)
    images, labels = batches(np.random.default_rng(0))
    assert images.shape == (2, 3, 96, 96)
    assert bool((labels == PlantClass.CROP).all())
