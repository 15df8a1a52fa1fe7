"""Angular stones that lie on soil by the thousand, as flints of chalk land do."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import spatial

from agribot.core.messages import FloatArray

# Number of cells of a texture, the large ones first; some hold a stone. Margin of soil between two
# stones, texels.
CELLS, MARGIN_TEXELS = (500, 6000), (3.0, 1.2)
# Colours of stones, and how many are of each: pale crust, grey, dark core.
STONE_RGB = np.array([[206.0, 199.0, 184.0], [146.0, 143.0, 138.0], [86.0, 82.0, 80.0]])
STONE_SHARE = (0.5, 0.35, 0.15)
TONE_STD, HUE_STD, RISE_TEXELS = 0.13, 0.03, 5.0


class _Stones(NamedTuple):
    """Stones in all cells: their rise (n, n) 0 to 1, colour (n, n, 3), and rank (n, n) 0 to 1.

    The stones up to a rank are those that a texture with this cover shows.
    """

    rise: FloatArray
    colour: FloatArray
    rank: FloatArray


def add_flints(
    material: tuple[FloatArray, FloatArray], cover_ratio: float, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Lay stones on a material, colour (n, n, 3) and height (n, n), on about this share of it."""
    colour, height = material
    for index in range(len(CELLS)):
        stones = _break_stones(len(height), index, seed)
        shown = (stones.rank < cover_ratio) & (stones.rise > 0.0)
        colour = np.where(shown[..., None], stones.colour, colour)
        height = np.where(shown, height + RISE_TEXELS * stones.rise, height)
    return colour, height


@lru_cache(maxsize=32)
def _break_stones(size: int, index: int, seed: int) -> _Stones:
    """Break the cells about random points of a torus into stones."""
    rng = np.random.default_rng([seed, 11, index])
    count = CELLS[index]
    points = rng.uniform(0.0, size, (count, 2))
    grid = np.moveaxis(np.mgrid[0:size, 0:size], 0, -1).reshape(-1, 2) + 0.5
    found = spatial.KDTree(points, boxsize=np.full(2, float(size))).query(grid, k=2)
    distance, nearest = np.asarray(found[0]), np.asarray(found[1])[:, 0]
    gap = (distance[:, 1] - distance[:, 0]).reshape(size, size)
    colour = STONE_RGB[rng.choice(len(STONE_RGB), count, p=STONE_SHARE)]
    colour = colour * (1.0 + rng.normal(0.0, TONE_STD, (count, 1)))
    colour = colour * (1.0 + rng.normal(0.0, HUE_STD, (count, 3)))
    cell: npt.NDArray[np.intp] = nearest.reshape(size, size)
    rise = np.sqrt(np.clip((gap - MARGIN_TEXELS[index]) / 4.0, 0.0, 1.0))
    return _Stones(rise, colour[cell], rng.random(count)[cell])
