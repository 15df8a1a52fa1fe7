from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("cv2")

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.train.photo_batches import ALONG_ROWS, PhotoBatches, ScaledPictures

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


def test_a_set_larger_than_the_memory_gives_the_same_batches_from_less_of_it() -> None:
    rng = np.random.default_rng(5)
    labels = [rng.integers(0, 3, (160, 200)).astype(np.uint8) for _ in range(9)]

    class Disk(list[tuple[ByteArray, ByteArray]]):
        reads = 0

        def __getitem__(self, index: Any) -> Any:
            Disk.reads += 1
            return super().__getitem__(index)

    pairs = Disk((COLOURS[label], label) for label in labels)
    whole = PhotoBatches(pairs, scale=0.5, batch_size=4, crop_px=64)
    assert Disk.reads == 9
    one = ScaledPictures(pairs, np.array([0.5]), 1).held_bytes
    few = PhotoBatches(pairs, scale=0.5, batch_size=4, crop_px=64, memory_bytes=12 * one)
    for seed in range(6):
        for a, b in zip(
            whole(np.random.default_rng(seed)), few(np.random.default_rng(seed)), strict=True
        ):
            assert bool((a == b).all())
    scaled = ScaledPictures(pairs, np.array([0.5]), int(3.5 * one))
    for index in rng.integers(0, 9, 60):
        scaled[int(index)]
        assert scaled.held_bytes <= 3.5 * one


def test_along_rows_pictures_stay_upright() -> None:
    label = np.full((200, 200), PlantClass.SOIL, np.uint8)
    label[100:] = PlantClass.CROP
    upright = PhotoBatches(
        [(COLOURS[label], label)], scale=1.0, batch_size=8, crop_px=160, view=ALONG_ROWS
    )
    _, labels = upright(np.random.default_rng(0))
    upper, lower = labels[:, 32, 48:112], labels[:, 128, 48:112]
    assert (upper.numpy() == PlantClass.SOIL).all()
    assert (lower.numpy() == PlantClass.CROP).all()
