"""Training batches from photographs: random turns, scales and light.

Seen from straight above plants look the same from every side, so that a crop is turned freely.
Rare plants are shown more often: crops centre on vegetation, and plants of one picture are set
into another.
"""

from __future__ import annotations

from collections import OrderedDict
from threading import Lock
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import torch
from PIL import Image
from torch import Tensor

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.train.photo_transforms import relight, warp

# Largest and smallest scale, over the scale at which the network works.
SCALE_RATIO = (0.86, 1.66)
LEVELS = 4
FROM_LEVEL_RATIO = (0.85, 1.0)  # factors left to the warp after the nearest larger level
ON_PLANTS_RATIO = 0.6  # share of crops centred on vegetation, half of them on the rare plants
PASTE_CROP_RATIO = 0.7
LEAST_PASTE_PX = 30
MEMORY_BYTES = 2_000_000_000  # memory of pictures at all scales, some 300 of 512 px


class View(NamedTuple):
    """Options of a view of plants: turns, plants set into other pictures; which plants are rare.

    Where rows run away from the camera, the place in the picture says what a plant is: it is not
    turned, and nothing is moved to another place.
    """

    most_turn_rad: float
    paste_ratio: float
    rare: PlantClass


STRAIGHT_DOWN = View(np.pi, 0.35, PlantClass.CROP)
ALONG_ROWS = View(0.1, 0.0, PlantClass.WEED)


class Level(NamedTuple):
    """A picture at one scale, and where its rare and all its plants are."""

    image_rgb: ByteArray
    label: ByteArray
    rare_rows_columns: npt.NDArray[np.intp]
    plant_rows_columns: npt.NDArray[np.intp]


class LabelledPictures(Protocol):
    """Pictures (height, width, 3) and labels (height, width) by number, such as a list of them."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> tuple[ByteArray, ByteArray]: ...


class ScaledPictures:
    """All pictures at all scales, as many as `memory_bytes` hold; the others are read again."""

    def __init__(
        self,
        pairs: LabelledPictures,
        scales: npt.NDArray[np.float64],
        memory_bytes: int,
        rare: PlantClass = STRAIGHT_DOWN.rare,
        stretch: float = 1.0,
    ) -> None:
        self._stretch = stretch
        self._pairs, self._scales, self._memory_bytes = pairs, scales, memory_bytes
        self._rare = rare
        self._kept: OrderedDict[int, list[Level]] = OrderedDict()
        self.held_bytes = 0
        self._one_at_a_time = Lock()  # batches may be drawn by several threads
        for index in range(len(pairs)):
            levels = self[index]
            if self.held_bytes + _count_bytes(levels) > memory_bytes:
                break

    def __len__(self) -> int:
        return len(self._pairs)

    def __getitem__(self, index: int) -> list[Level]:
        with self._one_at_a_time:
            if index in self._kept:
                self._kept.move_to_end(index)
                return self._kept[index]
        pair = self._pairs[index]
        levels = [_make_level(*pair, (s * self._stretch, s), self._rare) for s in self._scales]
        with self._one_at_a_time:
            if index not in self._kept:  # else another thread has just read it
                self._kept[index] = levels
                self.held_bytes += _count_bytes(levels)
            while self.held_bytes > self._memory_bytes and len(self._kept) > 1:
                self.held_bytes -= _count_bytes(self._kept.popitem(last=False)[1])
        return levels


class PhotoBatches:
    """A source of batches; the same generator state gives the same batch.

    `scale` is the network's input width over the width of the photographs, `stretch` the scale of
    their height over it. However little memory there is, the batches are the same.
    """

    def __init__(
        self,
        pairs: LabelledPictures,
        scale: float,
        batch_size: int,
        crop_px: int,
        memory_bytes: int = MEMORY_BYTES,
        view: View = STRAIGHT_DOWN,
        stretch: float = 1.0,
    ) -> None:
        self.batch_size = batch_size
        self._view = view
        self.crop_px = crop_px
        # A picture smaller than the input is enlarged, as when the network runs.
        largest = max(1.0, scale / FROM_LEVEL_RATIO[0])
        scales = scale * np.geomspace(*SCALE_RATIO, LEVELS) / FROM_LEVEL_RATIO[0]
        scales = np.minimum(np.minimum(largest, scales), scale * SCALE_RATIO[1])
        self._pictures = ScaledPictures(pairs, scales, memory_bytes, view.rare, stretch)
        # A turned square must not reach over the edge of its window.
        self._window_px = int(np.ceil(crop_px * 1.2))

    def __call__(self, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Draw images (N, 3, crop_px, crop_px) float32 and labels (N, crop_px, crop_px) int64."""
        samples = [self._sample(rng) for _ in range(self.batch_size)]
        images = np.stack([image for image, _ in samples]).transpose(0, 3, 1, 2)
        labels = np.stack([label for _, label in samples])
        return torch.from_numpy(images.astype(np.float32)), torch.from_numpy(
            labels.astype(np.int64)
        )

    def _sample(self, rng: np.random.Generator) -> tuple[ByteArray, ByteArray]:
        image, label = self._crop(rng)
        if rng.random() >= self._view.paste_ratio:
            return image, label
        kind = PlantClass.CROP if rng.random() < PASTE_CROP_RATIO else PlantClass.WEED
        other_image, other_label = self._crop(rng)
        pasted = other_label == kind
        if pasted.sum() < LEAST_PASTE_PX:
            return image, label
        return (
            np.where(pasted[..., None], other_image, image),
            np.where(pasted, other_label, label),
        )

    def _crop(self, rng: np.random.Generator) -> tuple[ByteArray, ByteArray]:
        picture = self._pictures[int(rng.integers(len(self._pictures)))]
        level = picture[int(rng.integers(len(picture)))]
        image, label = self._window(level, rng)
        turn_rad = self._view.most_turn_rad
        image, label = warp(image, label, self.crop_px, FROM_LEVEL_RATIO, rng, turn_rad)
        return relight(image, rng), label

    def _window(self, level: Level, rng: np.random.Generator) -> tuple[ByteArray, ByteArray]:
        height, width = level.label.shape
        centre = np.array([rng.uniform(0, height), rng.uniform(0, width)])
        if rng.random() < ON_PLANTS_RATIO:
            places = level.plant_rows_columns
            if rng.random() < 0.5 and len(level.rare_rows_columns):
                places = level.rare_rows_columns
            if len(places):
                jitter_px = rng.uniform(-0.35, 0.35, 2) * self.crop_px
                centre = places[int(rng.integers(len(places)))] + jitter_px
        size_px = self._window_px
        limit = np.maximum(0, np.array([height, width]) - size_px)
        top, left = np.clip(np.round(centre - size_px / 2), 0, limit).astype(int)
        window = (slice(top, top + size_px), slice(left, left + size_px))
        return level.image_rgb[window], level.label[window]


def _count_bytes(levels: list[Level]) -> int:
    return sum(part.nbytes for level in levels for part in level)


def _make_level(
    image_rgb: ByteArray, label: ByteArray, scales: tuple[float, float], rare: PlantClass
) -> Level:
    """Scale a picture and its label by factors of the height and of the width."""
    height, width = (
        max(1, round(size * scale)) for size, scale in zip(label.shape, scales, strict=True)
    )
    # Pillow's filter widens with the reduction: fine leaves do not alias.
    image = np.asarray(
        Image.fromarray(image_rgb).resize((width, height), Image.Resampling.BILINEAR)
    )
    small = resize_nearest(label, (height, width))
    sparse = small[::4, ::4]
    plants = (sparse == PlantClass.CROP) | (sparse == PlantClass.WEED)
    return Level(image, small, 4 * np.argwhere(sparse == rare), 4 * np.argwhere(plants))
