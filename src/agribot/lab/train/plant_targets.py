"""What a network is to answer about the plants of a picture: where stems are, and the way to them.

Stems are peaks of a heat map for each class (CenterNet, Zhou et al. 2019); every cell of a plant
says the way to its stem (Panoptic-DeepLab, Cheng et al. 2020).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from agribot.autonomy.perceive.stems import CELL_PX, SQUARE_PX, find_centres
from agribot.lab.train.augment import choose_windows, recolour
from agribot.lab.train.lights import change_light
from agribot.lab.train.losses import IGNORED
from agribot.lab.train.picture_stack import NO_PLANT, PictureStack
from agribot.lab.train.plant_truth import LEAST_PX
from agribot.lab.train.sensors import change_sensors, compress_some

SQUARES = CELL_PX // SQUARE_PX  # squares along the side of a cell
# The maps of a target, (MAPS, H / CELL_PX, W / CELL_PX): heat of weeds and of crops in the squares
# of the cell, row by row, the way to the stem in units of WAY_UNIT_PX, right and down, how much the
# way counts, and the heat; then the classes of the cell's own pixels, row by row.
HEAT = slice(0, 2 * SQUARES**2)
WAY = slice(HEAT.stop, HEAT.stop + 2)
WAY_WEIGHT = slice(WAY.stop, WAY.stop + 1)
HEAT_WEIGHT = slice(WAY_WEIGHT.stop, WAY_WEIGHT.stop + 1)
LABEL = slice(HEAT_WEIGHT.stop, HEAT_WEIGHT.stop + CELL_PX**2)
MAPS = LABEL.stop
WAY_UNIT_PX = 32.0
# Width of a peak of heat: of the radius of what is seen of the plant, and its limits in squares.
SIGMA_RATIO, SIGMA_SQUARES = 0.3, (1.1, 4.0)

PEAK_REACH_SQUARES = int(np.ceil(3.0 * SIGMA_SQUARES[1]))


def augment_views(
    stack: PictureStack, count: int, crop_px: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Make (count, 3, crop_px, crop_px) float32 in 0..255 and targets (count, MAPS, cells, cells).

    The pictures are those of a stack with plants.
    """
    chosen = stack.choose(count, rng)
    windows = choose_windows(stack, chosen, crop_px, rng)
    images = change_light(windows.cut_images(stack.images[chosen]), rng)
    images = change_sensors(images, rng)
    images = compress_some(recolour(images, rng), rng)
    targets = make_targets(
        windows.cut_pixels(stack.labels[chosen]),
        windows.cut_pixels(stack.numbers[chosen]),
        windows.move_points(stack.stems_px[chosen]),
        stack.kinds[chosen].to(torch.int64),
    )
    return images, targets


def make_targets(label: Tensor, number: Tensor, stems_px: Tensor, kinds: Tensor) -> Tensor:
    """Make targets (N, MAPS, H / CELL_PX, W / CELL_PX) of pictures.

    `label` and `number` (N, H, W) are the class and the plant of each pixel, `stems_px` (N, K, 2)
    and `kinds` (N, K) the plants, as of `PictureStack`. Plants with few visible pixels are left
    out; heat counts nowhere where a pixel has no class.
    """
    count, most = kinds.shape
    is_seen, seen_px = _count_seen(number, most)
    pixels = functional.pixel_unshuffle(number[:, None].to(torch.float32), CELL_PX).to(torch.int64)
    shape = pixels.shape[2:]
    seen_cells = is_seen.gather(1, pixels.flatten(1)).view_as(pixels)
    owner = _find_commonest(torch.where(seen_cells, pixels, 0))
    stems = _list_stems(stems_px, is_seen[:, 1:] & (kinds != NO_PLANT), shape)
    _give_cells(owner, stems)
    targets = torch.zeros((count, MAPS, *shape), device=label.device)
    targets[:, HEAT] = _draw_heat(stems_px, stems, kinds, seen_px, shape)
    targets[:, WAY] = _find_ways(owner, stems_px)
    cells = _count_numbers(owner, most).clamp(min=1).to(torch.float32)
    weight = cells.rsqrt()
    weight[:, 0] = 0.0
    targets[:, WAY_WEIGHT] = weight.gather(1, owner.flatten(1)).view(count, 1, *shape)
    classes = functional.pixel_unshuffle(label[:, None].to(torch.float32), CELL_PX)
    targets[:, LABEL] = classes
    targets[:, HEAT_WEIGHT] = (classes != IGNORED).all(dim=1, keepdim=True).to(torch.float32)
    return targets


def make_class_targets(label: Tensor) -> Tensor:
    """Make targets (N, MAPS, H / CELL_PX, W / CELL_PX) of photographs with these classes (N, H, W).

    Their plants are unknown: heat and ways count nowhere.
    """
    classes = functional.pixel_unshuffle(label[:, None].to(torch.float32), CELL_PX)
    nothing = torch.zeros((len(label), MAPS - CELL_PX**2, *classes.shape[2:]))
    return torch.cat([nothing, classes], dim=1)


def join_heat(maps: Tensor) -> Tensor:
    """Join the heat in maps (N, ..., rows, columns) to (N, 2, H / SQUARE_PX, W / SQUARE_PX)."""
    return functional.pixel_shuffle(maps[:, HEAT], SQUARES)


def join_labels(targets: Tensor) -> Tensor:
    """Join the classes in targets (N, MAPS, rows, columns) to int64 (N, H, W)."""
    return functional.pixel_shuffle(targets[:, LABEL], CELL_PX)[:, 0].to(torch.int64)


class _Stems(NamedTuple):
    """Stems within their pictures, (M,) each: picture, plant in its list, and cell."""

    picture: Tensor
    plant: Tensor
    row: Tensor
    column: Tensor


def _count_numbers(numbers: Tensor, most: int) -> Tensor:
    """Count how often each number from 0 to `most` is in (N, ...): (N, most + 1)."""
    counts = torch.zeros((len(numbers), most + 1), dtype=torch.int64, device=numbers.device)
    flat = numbers.flatten(1)
    return counts.scatter_add_(1, flat, torch.ones_like(flat))


def _count_seen(number: Tensor, most: int) -> tuple[Tensor, Tensor]:
    """Return which plants are visible enough, and their pixels, (N, most + 1); 0 is no plant."""
    seen_px = _count_numbers(number, most)
    is_seen = seen_px >= LEAST_PX
    is_seen[:, 0] = False
    return is_seen, seen_px


def _find_commonest(numbers: Tensor) -> Tensor:
    """Find the number other than 0 that most of (N, PIXELS, rows, columns) are; 0 if all are 0."""
    votes = torch.stack([(numbers == one[:, None]).sum(dim=1) for one in numbers.unbind(1)], dim=1)
    best = torch.where(numbers > 0, votes, 0).argmax(dim=1, keepdim=True)
    return numbers.gather(1, best)[:, 0]


def _list_stems(stems_px: Tensor, is_wanted: Tensor, shape: Sequence[int]) -> _Stems:
    cells = torch.floor((stems_px + 0.5) / CELL_PX).to(torch.int64)
    column, row = cells[..., 0], cells[..., 1]
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    picture, plant = torch.nonzero(is_wanted & inside, as_tuple=True)
    return _Stems(picture, plant, row[picture, plant], column[picture, plant])


def _give_cells(owner: Tensor, stems: _Stems) -> None:
    """Give a stem its cell, and the free ones of the eight around it, of (N, rows, columns)."""
    _, rows, columns = owner.shape
    unclaimed = torch.iinfo(torch.int64).max
    claims = torch.full_like(owner, unclaimed)
    for down, right in itertools.product((-1, 0, 1), repeat=2):
        row, column = stems.row + down, stems.column + right
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        place = ((stems.picture * rows + row) * columns + column)[inside]
        claims.view(-1).scatter_reduce_(0, place, stems.plant[inside] + 1, "amin")
    owner.copy_(torch.where((owner == 0) & (claims != unclaimed), claims, owner))
    own = torch.zeros_like(owner)
    place = (stems.picture * rows + stems.row) * columns + stems.column
    own.view(-1).scatter_reduce_(0, place, stems.plant + 1, "amax")
    owner.copy_(torch.where(own > 0, own, owner))


def _draw_heat(
    stems_px: Tensor, stems: _Stems, kinds: Tensor, seen_px: Tensor, shape: Sequence[int]
) -> Tensor:
    """Draw Gaussians about the stems, 1 in their squares: cell by cell, as in `HEAT`."""
    rows, columns = (SQUARES * cells for cells in shape)
    heat = torch.zeros((len(kinds), 2, rows, columns), device=kinds.device)
    radius_px = torch.sqrt(seen_px[stems.picture, stems.plant + 1] / torch.pi)
    sigma = (SIGMA_RATIO * radius_px / SQUARE_PX).clamp(*SIGMA_SQUARES)[:, None, None]
    around = torch.arange(-PEAK_REACH_SQUARES, PEAK_REACH_SQUARES + 1, device=heat.device)
    gap2 = around[:, None] ** 2 + around[None, :] ** 2
    peak = torch.exp(-gap2 / (2.0 * sigma**2))
    square = torch.floor((stems_px[stems.picture, stems.plant] + 0.5) / SQUARE_PX).to(torch.int64)
    row = square[:, 1, None, None] + around[None, :, None]
    column = square[:, 0, None, None] + around[None, None, :]
    reach = torch.ceil(3.0 * sigma)
    near = (around.abs()[None, :, None] <= reach) & (around.abs()[None, None, :] <= reach)
    inside = near & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    plane = (stems.picture * 2 + kinds[stems.picture, stems.plant])[:, None, None]
    place = (plane * rows + row) * columns + column
    heat.view(-1).scatter_reduce_(0, place[inside], peak[inside].to(heat.dtype), "amax")
    return functional.pixel_unshuffle(heat, SQUARES)


def _find_ways(owner: Tensor, stems_px: Tensor) -> Tensor:
    """Find the ways (N, 2, rows, columns), right and down, from cells to the stems of their plants.

    They are 0 in cells of no plant.
    """
    count, rows, columns = owner.shape
    index = (owner - 1).clamp(min=0).flatten(1)[..., None].expand(-1, -1, 2)
    stem_px = stems_px.gather(1, index).view(count, rows, columns, 2)
    cells = np.indices((rows, columns)).reshape(2, -1).T
    centre_px = torch.from_numpy(find_centres(cells)).to(stems_px).view(rows, columns, 2)
    ways = (stem_px - centre_px) / WAY_UNIT_PX * (owner > 0)[..., None]
    return ways.permute(0, 3, 1, 2).to(torch.float32)
