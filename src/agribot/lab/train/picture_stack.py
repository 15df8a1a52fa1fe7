"""Pictures of one size in the memory of a device, from which batches are cut all at once."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
import torch

from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.plant_truth import DrawnView, PlantTruth

BLOCK_PX = 8  # side of the squares in which windows are compared by the weeds
NO_PLANT = 255  # kind of what only fills up a list of plants

Numbers = npt.NDArray[np.int64]
_NO_NUMBERS = np.zeros((0, 0), dtype=np.uint16)  # instead of those that lie in the stack


class PictureStack:
    """N pictures (H, W), with their single plants where they are drawn views.

    `images` (N, H, W, 3) and `labels` (N, H, W) are uint8; `numbers` (N, H, W) int16 is the plant
    of each pixel as of `PlantTruth`, `stems_px` (N, K, 2) and `kinds` (N, K) are its plants, filled
    up with `NO_PLANT`. All of these lie on `device`.

    Raises: ConfigError: no picture, fewer than `count`, or of different sizes.
    """

    def __init__(
        self, pictures: Iterable[LabelledImage | DrawnView], count: int, device: str = "cpu"
    ) -> None:
        self.device = device
        self._weeds_px: list[npt.NDArray[np.int32]] = []
        plants: list[PlantTruth] = []
        for index, picture in enumerate(pictures):
            if index == 0:
                self._allocate(count, picture[1].shape, isinstance(picture, DrawnView))
            self._take(index, picture)
            if isinstance(picture, DrawnView):
                self.numbers[index] = torch.from_numpy(picture.plants.number.astype(np.int16))
                plants.append(picture.plants._replace(number=_NO_NUMBERS))
        if not count or len(self._weeds_px) != count:
            raise ConfigError(f"{len(self._weeds_px)} pictures instead of {count}; give at least 1")
        self.has_plants = bool(plants)
        if self.has_plants:
            stems_px, kinds = _fill_up(plants)
            self.stems_px = torch.from_numpy(stems_px).to(torch.float32).to(device)
            self.kinds = torch.from_numpy(kinds).to(device)

    def _allocate(self, count: int, shape: tuple[int, ...], has_plants: bool) -> None:
        """Take the memory for pictures of a shape, before they come."""
        self.images = torch.empty((count, *shape, 3), dtype=torch.uint8, device=self.device)
        self.labels = torch.empty((count, *shape), dtype=torch.uint8, device=self.device)
        numbered = count if has_plants else 0
        self.numbers = torch.empty((numbered, *shape), dtype=torch.int16, device=self.device)

    def _take(self, index: int, picture: LabelledImage | DrawnView) -> None:
        image_rgb, label = picture[:2]
        if label.shape != self.shape:
            raise ConfigError(
                f"pictures of {label.shape} and of {self.shape} (rows, columns): a training cuts "
                "its batches from pictures of the same size; scale them to one"
            )
        self.images[index] = torch.from_numpy(image_rgb.copy())
        self.labels[index] = torch.from_numpy(label.copy())
        self._weeds_px.append(_sum_weeds(label))

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a picture."""
        _, rows, columns = self.labels.shape
        return rows, columns

    def choose(self, count: int, rng: np.random.Generator) -> Numbers:
        """Choose pictures by their numbers, (count,)."""
        return rng.integers(len(self), size=count)

    def count_weeds(
        self, chosen: Numbers, top: Numbers, left: Numbers, size_px: Numbers
    ) -> Numbers:
        """Count the weed pixels of a square (count,) of each, to the nearest block."""
        first_row, first_column = top // BLOCK_PX, left // BLOCK_PX
        last_row, last_column = (top + size_px) // BLOCK_PX, (left + size_px) // BLOCK_PX
        sums = np.stack([self._weeds_px[index] for index in chosen])
        each = np.arange(len(chosen))
        counted: Numbers = (
            sums[each, last_row, last_column]
            - sums[each, first_row, last_column]
            - sums[each, last_row, first_column]
            + sums[each, first_row, first_column]
        ).astype(np.int64)
        return counted


def _sum_weeds(label: ByteArray) -> npt.NDArray[np.int32]:
    """Sum the weed pixels of a picture (H, W) above and left of each corner of its blocks."""
    rows, columns = (size // BLOCK_PX for size in label.shape)
    is_weed = label[: rows * BLOCK_PX, : columns * BLOCK_PX] == PlantClass.WEED
    blocks = is_weed.reshape(rows, BLOCK_PX, columns, BLOCK_PX).sum(axis=(1, 3), dtype=np.int32)
    sums: npt.NDArray[np.int32] = np.pad(blocks, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    return sums.astype(np.int32)


def _fill_up(plants: list[PlantTruth]) -> tuple[FloatArray, ByteArray]:
    """Make all lists of stems and kinds as long as the longest."""
    most = max(1, *(len(one.kind) for one in plants))
    stems_px = np.zeros((len(plants), most, 2))
    kinds = np.full((len(plants), most), NO_PLANT, dtype=np.uint8)
    for index, one in enumerate(plants):
        stems_px[index, : len(one.kind)] = one.stem_px
        kinds[index, : len(one.kind)] = one.kind
    return stems_px, kinds
