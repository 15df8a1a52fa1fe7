"""What a set of images and masks holds, day by day: counted while it is checked."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.plant_cover import excess_green
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.layouts import Item

GRID = (24, 32)  # rows and columns of the map of where plants are in a picture
GREEN_STRIDE_PX = 8  # stride of the pixels whose greenness is measured


class PictureCounts(msgspec.Struct, frozen=True, kw_only=True):
    """Pixels by class in one mask; `greenness` is the mean excess green of the image, -1 to 2."""

    image: str
    group: str
    width_px: int
    height_px: int
    weed_px: int
    crop_px: int
    soil_px: int
    unlabelled_px: int
    greenness: float

    @property
    def known_px(self) -> int:
        return self.weed_px + self.crop_px + self.soil_px


class GroupCounts(msgspec.Struct, frozen=True, kw_only=True):
    """A set of a collection, such as a day; its pixels are those of readable pairs.

    `without_mask` are the images without annotation.
    """

    group: str
    images: int
    annotated: int
    without_mask: tuple[str, ...]
    pictures: int
    weed_px: int
    crop_px: int
    soil_px: int


class SetAnalysis:
    """Counts pairs one after the other; `where` is how much of each class lies where.

    `where` (2, *GRID) sums the share of weed and of crop in each field of the grid.
    """

    def __init__(self) -> None:
        self.pictures: list[PictureCounts] = []
        self.where: npt.NDArray[np.float64] = np.zeros((2, *GRID))

    def add(self, item: Item, image_rgb: ByteArray, classes: ByteArray) -> None:
        """Count an image (H, W, 3) and its classes (H, W)."""
        counts = np.bincount(classes.ravel(), minlength=256)
        known = counts[: len(PlantClass)]
        stride = slice(None, None, GREEN_STRIDE_PX)
        self.pictures.append(
            PictureCounts(
                image=item.image or "",
                group=item.group,
                width_px=classes.shape[1],
                height_px=classes.shape[0],
                weed_px=int(known[PlantClass.WEED]),
                crop_px=int(known[PlantClass.CROP]),
                soil_px=int(known[PlantClass.SOIL]),
                unlabelled_px=int(counts.sum() - known.sum()),
                greenness=float(excess_green(image_rgb[stride, stride]).mean()),
            )
        )
        for index, kind in enumerate((PlantClass.WEED, PlantClass.CROP)):
            self.where[index] += _share_of_fields(classes == kind)

    def count_groups(self, items: Sequence[Item]) -> list[GroupCounts]:
        """Sum up each set of the collection, in the order of the names."""
        groups = sorted({item.group for item in items})
        return [
            self._count_group(group, [i for i in items if i.group == group]) for group in groups
        ]

    def _count_group(self, group: str, items: list[Item]) -> GroupCounts:
        pictures = [one for one in self.pictures if one.group == group]
        return GroupCounts(
            group=group,
            images=sum(item.image is not None for item in items),
            annotated=sum(item.image is not None and item.mask is not None for item in items),
            without_mask=tuple(i.image for i in items if i.image is not None and i.mask is None),
            pictures=len(pictures),
            weed_px=sum(one.weed_px for one in pictures),
            crop_px=sum(one.crop_px for one in pictures),
            soil_px=sum(one.soil_px for one in pictures),
        )


def _share_of_fields(is_kind: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Compute the share of true pixels (H, W) in each field of the grid; 0 in an empty one."""
    rows, columns = (
        np.arange(size) * fields // size for size, fields in zip(is_kind.shape, GRID, strict=True)
    )
    field = (rows[:, None] * GRID[1] + columns).ravel()
    pixels = np.bincount(field, minlength=GRID[0] * GRID[1])
    found = np.bincount(field, is_kind.ravel(), GRID[0] * GRID[1])
    share: npt.NDArray[np.float64] = (found / np.maximum(pixels, 1)).reshape(GRID)
    return share
