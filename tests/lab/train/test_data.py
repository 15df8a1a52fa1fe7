from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agribot.core.errors import AgribotError
from agribot.core.messages import ByteArray
from agribot.lab.train import data
from agribot.lab.train.augment import augment_batch
from agribot.lab.train.data import DataSet
from agribot.lab.train.picture_stack import PictureStack
from tests import nightly
from tests.lab.train.drawn_images import drawn_image, drawn_scene


def quiet(text: str) -> None:
    pass


def data_set(folder: Path, name: str = "train", stream: int = 0, seed: int = 0) -> DataSet:
    return DataSet(folder=folder, name=name, stream=stream, seed=seed, views_per_scene=3)


def test_images_and_labels_come_back_as_they_were_drawn(tmp_path: Path) -> None:
    images = data_set(tmp_path)
    images.draw(3, drawn_scene, quiet)
    drawn = drawn_scene(np.random.default_rng([0, 0, 0]), 3)
    for (image, label), (image_rgb, truth) in zip(images.read(3), drawn, strict=True):
        assert np.array_equal(image, image_rgb)
        assert np.array_equal(label, truth)


def test_drawing_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    scenes = 0

    def counted(rng: np.random.Generator, views: int) -> Iterator[tuple[ByteArray, ByteArray]]:
        nonlocal scenes
        scenes += 1
        yield from drawn_scene(rng, views)

    data_set(tmp_path / "a").draw(6, counted, quiet)
    data_set(tmp_path / "a").draw(12, counted, quiet)
    assert scenes == 4
    data_set(tmp_path / "b").draw(12, drawn_scene, quiet)
    assert_same_images(tmp_path / "a", tmp_path / "b", 12)


def test_scenes_are_drawn_alike_in_any_order_from_jobs_that_a_process_can_be_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def send_backwards(work: Any, jobs: Sequence[Any], workers: int, stop: Any) -> Iterator[Any]:
        assert workers == 2
        for job in reversed(jobs):
            yield work(pickle.loads(pickle.dumps(job)), stop)

    data_set(tmp_path / "one").draw(9, drawn_scene, quiet)
    monkeypatch.setattr(data, "results", send_backwards)
    data_set(tmp_path / "two").draw(9, drawn_scene, quiet, workers=2)
    assert_same_images(tmp_path / "one", tmp_path / "two", 9)


def assert_same_images(one: Path, other: Path, count: int) -> None:
    pairs = list(zip(data_set(one).read(count), data_set(other).read(count), strict=True))
    assert len(pairs) == count
    assert all(np.array_equal(first[0], second[0]) for first, second in pairs)


@nightly.by_day("test_scenes_are_drawn_alike_in_any_order_from_jobs_that_a_process_can_be_sent")
def test_processes_draw_the_same_images(tmp_path: Path) -> None:
    data_set(tmp_path / "one").draw(9, drawn_scene, quiet)
    data_set(tmp_path / "two").draw(9, drawn_scene, quiet, workers=2)
    assert_same_images(tmp_path / "one", tmp_path / "two", 9)


def test_training_and_test_scenes_differ(tmp_path: Path) -> None:
    train, test = data_set(tmp_path), data_set(tmp_path, "test", stream=1)
    for images in (train, test):
        images.draw(6, drawn_scene, quiet)
    seen = {image.tobytes() for image, _ in train.read(6)}
    assert not seen & {image.tobytes() for image, _ in test.read(6)}


def test_a_folder_of_another_seed_is_refused(tmp_path: Path) -> None:
    data_set(tmp_path).draw(3, drawn_scene, quiet)
    with pytest.raises(AgribotError, match="--seed"):
        data_set(tmp_path, seed=1).draw(3, drawn_scene, quiet)


def test_augmentation_repeats_with_its_seed_and_keeps_labels_on_their_pixels() -> None:
    images = [drawn_image(np.random.default_rng(seed)) for seed in range(6)]
    stack = PictureStack(images, 6)
    batch, target = augment_batch(stack, 6, 64, np.random.default_rng(1))
    again, _ = augment_batch(stack, 6, 64, np.random.default_rng(1))
    assert batch.shape == (6, 3, 64, 64) and target.shape == (6, 64, 64)
    assert (batch == again).all()
    assert set(target.flatten().tolist()) <= {0, 1, 2}
    # Crop discs are greener than the ground whatever the light.
    greenness = batch[:, 1] - batch[:, 0]
    assert greenness[target == 1].mean() > greenness[target == 2].mean() + 20
