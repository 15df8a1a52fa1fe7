from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from agribot.lab.train.fit import Trainer, TrainingPlan
from agribot.lab.train.loader import AHEAD, BatchLoader
from agribot.lab.train.photo_batches import PhotoBatches
from tests import nightly
from tests.lab.train.drawn_images import batch_of_four, drawn_image

STEPS = 9


def draw_number(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    number = torch.tensor(rng.random())
    return number, number


def take_all(workers: int, first: int = 0) -> list[float]:
    loader = BatchLoader(draw_number, 3, 0, STEPS, workers)
    drawn = [float(loader.take(step)[0]) for step in range(first, STEPS)]
    loader.close()
    return drawn


@pytest.mark.parametrize("workers", [1, 3])
def test_workers_change_no_batch_whichever_step_comes_first(workers: int) -> None:
    assert take_all(workers) == take_all(0)
    assert take_all(workers, first=4) == take_all(0)[4:]


def test_batches_are_drawn_ahead_by_other_threads_but_not_beyond_the_last_step() -> None:
    threads: list[str] = []

    def draw(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        threads.append(threading.current_thread().name)
        return draw_number(rng)

    loader = BatchLoader(draw, 3, 0, STEPS, workers=2)
    loader.take(0)
    loader.take(STEPS - 1)
    loader.close()
    assert 2 <= len(threads) <= 2 + 2 * AHEAD
    assert threading.main_thread().name not in threads


def test_what_a_worker_cannot_read_stops_the_training_with_its_reason() -> None:
    def fail(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        raise FileNotFoundError("photo.png")

    loader = BatchLoader(fail, 3, 0, STEPS, workers=1)
    with pytest.raises(FileNotFoundError, match=r"photo\.png"):
        loader.take(0)
    loader.close()


@nightly.by_day(
    "test_workers_change_no_batch_whichever_step_comes_first",
)
def test_a_training_with_workers_ends_with_the_same_weights(tmp_path: Path) -> None:
    plan = TrainingPlan(steps=3, batch_size=4, crop_px=64, bf16=False)
    one, other = (
        Trainer(plan, batch_of_four, tmp_path / str(workers), workers=workers)
        .run(lambda text: None)
        .state_dict()
        for workers in (0, 2)
    )
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_photographs_that_do_not_fit_the_memory_are_the_same_to_several_threads() -> None:
    pairs = [drawn_image(np.random.default_rng(index)) for index in range(4)]
    source = PhotoBatches(pairs, 1.0, 2, 64, memory_bytes=1)
    drawn = []
    for workers in (0, 4):
        loader = BatchLoader(source, 5, 0, STEPS, workers)
        drawn.append([loader.take(step)[0] for step in range(STEPS)])
        loader.close()
    assert all(torch.equal(one, other) for one, other in zip(*drawn, strict=True))
