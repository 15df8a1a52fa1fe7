"""What a network is to answer about the plants of a picture: where stems are, and the way to them.

Stems are peaks of a heat map for each class (CenterNet, Zhou et al. 2019); every cell of a plant
says the way to its stem (Panoptic-DeepLab, Cheng et al. 2020).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from agribot.autonomy.perceive.stems import CELL_PX, find_centres
from agribot.core.messages import ByteArray, FloatArray
from agribot.lab.train.augment import PictureWindow, choose_crop, recolour
from agribot.lab.train.losses import IGNORED
from agribot.lab.train.plant_truth import LEAST_PX, DrawnView, PlantTruth
from agribot.lab.train.sensors import change_sensor

# The maps of a target, (MAPS, H / CELL_PX, W / CELL_PX): heat of weeds and of crops, the way to the
# stem in units of WAY_UNIT_PX, right and down, how much the way counts, and the heat; then the
# classes of the cell's own pixels, row by row.
MAPS = 6 + CELL_PX**2
HEAT, WAY, WAY_WEIGHT, HEAT_WEIGHT = slice(0, 2), slice(2, 4), slice(4, 5), slice(5, 6)
LABEL = slice(6, MAPS)
WAY_UNIT_PX = 32.0
# Width of a peak of heat: of the radius of what is seen of the plant, and its limits in cells.
SIGMA_RATIO, SIGMA_CELLS = 0.3, (0.7, 2.0)

Numbers = npt.NDArray[np.int64]


def augment_views(
    views: list[DrawnView], crop_px: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Make (N, 3, crop_px, crop_px) float32 in 0..255 and targets (N, MAPS, cells, cells)."""
    crops = [choose_crop(view.label, crop_px, rng) for view in views]
    pairs = list(zip(crops, views, strict=True))
    images = [
        recolour(change_sensor(crop.cut_image(view.image_rgb), rng), rng) for crop, view in pairs
    ]
    return torch.stack(images), torch.stack([_cut_targets(crop, view) for crop, view in pairs])


def _cut_targets(crop: PictureWindow, view: DrawnView) -> Tensor:
    plants = view.plants
    moved = PlantTruth(
        number=crop.cut_label(plants.number).numpy().astype(np.uint16),
        stem_px=crop.move_points(plants.stem_px),
        kind=plants.kind,
    )
    label = crop.cut_label(view.label).numpy().astype(np.uint8)
    return torch.from_numpy(make_targets(label, moved))


def make_targets(label: ByteArray, plants: PlantTruth) -> npt.NDArray[np.float32]:
    """Make the target (MAPS, H / CELL_PX, W / CELL_PX) of a picture with these classes (H, W).

    Plants of which little is seen are left out; heat counts nowhere where a pixel has no class.
    """
    pixels = _split_cells(plants.number)
    seen_px = np.bincount(plants.number.ravel(), minlength=len(plants.kind) + 1)
    is_seen = seen_px >= LEAST_PX
    is_seen[0] = False
    owner = _find_commonest(np.where(is_seen[pixels], pixels, 0))
    targets = np.zeros((MAPS, *owner.shape), dtype=np.float32)
    row, column = np.floor((plants.stem_px + 0.5) / CELL_PX).astype(np.int64).T[::-1]
    rows, columns = owner.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    stems = np.flatnonzero(is_seen[1:] & inside)
    for index in stems:
        radius_cells = np.sqrt(seen_px[index + 1] / np.pi) / CELL_PX
        heat = targets[plants.kind[index]]
        _add_peak(heat, row[index], column[index], float(radius_cells))
        top, left = max(0, row[index] - 1), max(0, column[index] - 1)
        near = owner[top : row[index] + 2, left : column[index] + 2]
        near[near == 0] = index + 1
    owner[row[stems], column[stems]] = stems + 1
    targets[WAY] = _find_ways(owner, plants.stem_px)
    cells = np.bincount(owner.ravel(), minlength=len(is_seen))
    weight = 1.0 / np.sqrt(np.maximum(cells, 1))
    weight[0] = 0.0
    targets[WAY_WEIGHT] = weight[owner]
    classes = _split_cells(label)
    targets[LABEL] = np.moveaxis(classes, -1, 0)
    targets[HEAT_WEIGHT] = (classes != IGNORED).all(axis=-1)
    return targets


def tell_classes_alone(label: Tensor) -> Tensor:
    """Make targets (N, MAPS, H / CELL_PX, W / CELL_PX) of photographs with these classes (N, H, W).

    Nobody knows their plants: heat and ways count nowhere.
    """
    classes = functional.pixel_unshuffle(label[:, None].to(torch.float32), CELL_PX)
    nothing = torch.zeros((len(label), MAPS - CELL_PX**2, *classes.shape[2:]))
    return torch.cat([nothing, classes], dim=1)


def join_labels(targets: Tensor) -> Tensor:
    """Join the classes in targets (N, MAPS, rows, columns) to int64 (N, H, W)."""
    return functional.pixel_shuffle(targets[:, LABEL], CELL_PX)[:, 0].to(torch.int64)


def _split_cells(pixels: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """Sort the pixels (H, W) by cell, (H / CELL_PX, W / CELL_PX, CELL_PX ** 2)."""
    height, width = pixels.shape
    split = pixels.reshape(height // CELL_PX, CELL_PX, width // CELL_PX, CELL_PX)
    return split.swapaxes(1, 2).reshape(height // CELL_PX, width // CELL_PX, CELL_PX**2)


def _find_commonest(numbers: npt.NDArray[np.integer]) -> Numbers:
    """Find the number other than 0 that most of the last axis are; 0 where all are 0."""
    same = [(numbers == numbers[..., k : k + 1]).sum(axis=-1) for k in range(numbers.shape[-1])]
    votes = np.where(numbers > 0, np.stack(same, axis=-1), 0)
    best = votes.argmax(axis=-1)
    return np.take_along_axis(numbers, best[..., None], axis=-1)[..., 0].astype(np.int64)


def _add_peak(heat: npt.NDArray[np.float32], row: int, column: int, radius_cells: float) -> None:
    """Raise the map to a Gaussian about a cell, 1 there."""
    sigma = float(np.clip(SIGMA_RATIO * radius_cells, *SIGMA_CELLS))
    reach = int(np.ceil(3.0 * sigma))
    top, left = max(0, row - reach), max(0, column - reach)
    window = heat[top : row + reach + 1, left : column + reach + 1]
    down = np.arange(top, top + window.shape[0])[:, None] - row
    right = np.arange(left, left + window.shape[1])[None, :] - column
    peak = np.exp(-(down**2 + right**2) / (2.0 * sigma**2))
    np.maximum(window, peak.astype(np.float32), out=window)


def _find_ways(owner: Numbers, stem_px: FloatArray) -> FloatArray:
    """Find the ways (2, rows, columns), right and down, from cells to the stems of their plants."""
    ways = np.zeros((2, *owner.shape))
    is_owned = owner > 0
    centre_px = find_centres(np.argwhere(is_owned))
    ways[:, is_owned] = ((stem_px[owner[is_owned] - 1] - centre_px) / WAY_UNIT_PX).T
    return ways
