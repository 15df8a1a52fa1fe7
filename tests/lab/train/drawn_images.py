"""Tiny labelled images: green discs for crop, yellow ones for weed, on brown ground."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from torch import Tensor

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.train.augment import augment_batch
from agribot.lab.train.picture_stack import PictureStack

COLOURS = np.array([[170, 170, 40], [40, 150, 40], [110, 80, 60]], dtype=np.float64)
SHAPE = (96, 128)


def drawn_image(rng: np.random.Generator) -> tuple[ByteArray, ByteArray]:
    label = np.full(SHAPE, PlantClass.SOIL, dtype=np.uint8)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    for _ in range(8):
        row, column, radius = rng.uniform((0, 0, 5), (*SHAPE, 14))
        label[np.hypot(rows - row, columns - column) < radius] = rng.integers(2)
    noise = rng.normal(0.0, 8.0, (*SHAPE, 3))
    return np.clip(COLOURS[label] + noise, 0, 255).astype(np.uint8), label


def drawn_scene(rng: np.random.Generator, views: int) -> Iterator[tuple[ByteArray, ByteArray]]:
    for _ in range(views):
        yield drawn_image(rng)


def batch_of_four(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    return augment_batch(PictureStack(drawn_scene(rng, 4), 4), 4, 64, rng)
