"""Procedural textures of the ground, lit by the sun across their own relief."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import ndimage, spatial

from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray
from agribot.core.world import Soil
from agribot.sim.camera.flints import add_flints
from agribot.sim.camera.ground import TONE_SIZE
from agribot.sim.flora.texture import make_tileable_noise

SIZE = 512
PERIOD_M = 1.28  # ground that one texture covers
COARSEST = 6.0  # cycles in a texture: broader stains would show that it repeats
WET_DARKENING = 0.42
BARE = Soil()
EARTH = ("soil", "track")
Material = tuple[FloatArray, FloatArray]  # colour (n, n, 3) 0 to 255, height (n, n) in texels


def _scatter_ellipses(
    rng: np.random.Generator, count: int, radius_px: tuple[float, float], stretch: float
) -> tuple[FloatArray, FloatArray]:
    """Scatter ellipses on a torus: their domes (n, n) 0 to 1 and a random number for each."""
    dome, tone = np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE))
    for _ in range(count):
        x, y, angle = rng.uniform(0, SIZE), rng.uniform(0, SIZE), rng.uniform(0, np.pi)
        radius = np.exp(rng.uniform(*np.log(radius_px)))
        long = radius * stretch * rng.uniform(0.8, 1.2)
        reach = int(max(radius, long)) + 1
        grid_y, grid_x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        along = (grid_x * np.cos(angle) + grid_y * np.sin(angle)) / long
        across = (-grid_x * np.sin(angle) + grid_y * np.cos(angle)) / radius
        shape = np.sqrt(np.clip(1.0 - along**2 - across**2, 0.0, 1.0))
        rows, columns = (grid_y + int(y)) % SIZE, (grid_x + int(x)) % SIZE
        over = shape > dome[rows, columns]
        dome[rows[over], columns[over]] = shape[over]
        tone[rows[over], columns[over]] = rng.uniform(-1.0, 1.0)
    return dome, tone


def _blend(under: FloatArray, over: FloatArray, share: FloatArray) -> FloatArray:
    mixed: FloatArray = under + (over - under) * share[..., None]
    return mixed


def _make_soil(rng: np.random.Generator) -> Material:
    """Make crumbled loam with clods, pebbles and bits of straw."""
    shape = (SIZE, SIZE)
    rough = make_tileable_noise(rng, shape, exponent=1.35, coarsest=COARSEST)
    crumbs = np.abs(make_tileable_noise(rng, shape, exponent=0.7, coarsest=18, finest=110))
    clods, _ = _scatter_ellipses(rng, 420, (2.5, 13.0), 1.2)
    height = 2.0 * rough + 1.2 * crumbs + 6.0 * clods
    stain = make_tileable_noise(rng, shape, exponent=1.4, coarsest=COARSEST)
    base = np.array([124.0, 98.0, 72.0]) * (1.0 + 0.07 * stain[..., None])
    base = base * (0.95 + 0.045 * np.clip(rough, -2, 2)[..., None])
    pebbles, grey = _scatter_ellipses(rng, int(rng.integers(10, 60)), (1.2, 4.5), 1.3)
    stone = np.array([146.0, 138.0, 126.0]) * (1.0 + 0.16 * grey[..., None])
    base = _blend(base, stone, 0.85 * np.clip(pebbles * 4, 0, 1))
    straw, pale = _scatter_ellipses(rng, int(rng.integers(5, 50)), (0.8, 1.1), 16.0)
    stalk = np.array([180.0, 158.0, 112.0]) * (1.0 + 0.15 * pale[..., None])
    base = _blend(base, stalk, 0.8 * np.clip(straw * 2, 0, 1))
    return base, height + 3.5 * pebbles + 2.0 * straw


def _make_grass(rng: np.random.Generator) -> Material:
    """Make a short lawn: streaks of blades in several directions over brown thatch."""
    shape = (SIZE, SIZE)
    patch = make_tileable_noise(rng, shape, exponent=1.0, coarsest=COARSEST)
    height = np.full(shape, -9.0)
    for angle in (0.15, 0.8, 1.45, 2.1, 2.75):
        streaks = make_tileable_noise(rng, shape, exponent=0.2, coarsest=24)
        length = 11
        line = np.zeros((length, length))
        offset = np.linspace(-5.0, 5.0, 41)
        columns = np.round(5 + offset * np.cos(angle)).astype(int)
        line[np.round(5 + offset * np.sin(angle)).astype(int), columns] = 1.0
        blades = ndimage.convolve(streaks, line / line.sum(), mode="wrap")
        height = np.maximum(height, blades / blades.std())
    lift = np.clip((height - 0.2) / 2.6, 0.0, 1.0)[..., None]
    thatch, blade = np.array([78.0, 82.0, 44.0]), np.array([122.0, 152.0, 72.0])
    colour = (thatch + (blade - thatch) * lift) * (1.0 + 0.06 * patch[..., None])
    dry = np.clip(0.25 * patch - 0.2, 0.0, 0.35)
    return _blend(colour, np.array([164.0, 152.0, 92.0]) + 0 * colour, dry), 1.2 * height


def _make_pavement(rng: np.random.Generator) -> Material:
    """Make concrete slabs of 0.8 m with joints, stains and fine grain."""
    shape = (SIZE, SIZE)
    grain = make_tileable_noise(rng, shape, exponent=0.35, coarsest=30)
    stain = make_tileable_noise(rng, shape, exponent=1.3, coarsest=COARSEST)
    at = np.arange(SIZE) % (SIZE // 2)
    edge = np.minimum(at, SIZE // 2 - at)
    joint = np.clip(1.0 - np.minimum(edge[:, None], edge[None, :]) / 1.8, 0.0, 1.0)
    colour = np.array([150.0, 147.0, 140.0]) * (1 + 0.05 * stain + 0.035 * grain)[..., None]
    return _blend(colour, 0.5 * colour, joint), 0.25 * grain - 2.0 * joint


def _make_gravel(rng: np.random.Generator) -> Material:
    """Make packed stones: cells about random points of a torus."""
    points = rng.uniform(0.0, SIZE, (2600, 2))
    grid = np.moveaxis(np.mgrid[0:SIZE, 0:SIZE], 0, -1).reshape(-1, 2) + 0.5
    found = spatial.KDTree(points, boxsize=np.full(2, float(SIZE))).query(grid, k=2)
    distance, nearest = np.asarray(found[0]), np.asarray(found[1])[:, 0]
    gap = (distance[:, 1] - distance[:, 0]).reshape(SIZE, SIZE)
    tone = rng.normal(0.0, 1.0, (len(points), 1)) * 0.14 + rng.normal(0.0, 0.025, (len(points), 3))
    stone = np.array([142.0, 136.0, 128.0]) * (1.0 + tone[nearest].reshape(SIZE, SIZE, 3))
    rise = np.sqrt(np.clip(gap / 5.0, 0.0, 1.0))
    return stone * (0.45 + 0.55 * rise)[..., None], 4.0 * rise


def _make_track(rng: np.random.Generator) -> Material:
    """Make loam that wheels have pressed flat, with the prints of their lugs both ways."""
    shape = (SIZE, SIZE)
    rough = make_tileable_noise(rng, shape, exponent=1.0, coarsest=COARSEST)
    stain = make_tileable_noise(rng, shape, exponent=1.4, coarsest=COARSEST)
    row, column = np.mgrid[0:SIZE, 0:SIZE] * (2 * np.pi * 20 / SIZE)
    print_depth = np.clip(1.6 * np.sin(row + column) * np.sin(row - column) + 0.3 * rough, -1, 1)
    colour = np.array([111.0, 88.0, 65.0]) * (1.0 + 0.06 * stain + 0.03 * rough)[..., None]
    return colour, 0.6 * rough + 2.6 * print_depth


SURFACES: dict[str, Callable[[np.random.Generator], Material]] = {
    "soil": _make_soil,
    "grass": _make_grass,
    "pavement": _make_pavement,
    "gravel": _make_gravel,
    "track": _make_track,
}


@lru_cache(maxsize=16)
def _make_material(surface: str, seed: int) -> Material:
    make = SURFACES.get(surface)
    if make is None:
        known = ", ".join(SURFACES)
        raise DescriptionError(f"unknown ground surface '{surface}'; use one of: {known}")
    return make(np.random.default_rng([seed, list(SURFACES).index(surface), 5]))


def _scatter_litter(soil: Soil, seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Scatter stones and straw: domes 0 to 1 and tones of the ones and of the other, (n, n)."""
    rng = np.random.default_rng([seed, 6])
    stones, grey = _scatter_ellipses(rng, round(90 * soil.stones_ratio), (3.0, 11.0), 1.25)
    straw, pale = _scatter_ellipses(rng, round(420 * soil.residue_ratio), (0.9, 1.9), 20.0)
    return stones, grey, straw, pale


def build_litter_heights(
    soil: Soil, stone_m: float, straw_m: float, step_m: float, seed: int = 0
) -> FloatArray:
    """Build the heights (n, n) of stones and straw over PERIOD_M, as a grid of `step_m` holds them.

    They lie where the textures of the same seed show them.
    """
    stones, _grey, straw, _pale = _scatter_litter(soil, seed)
    width = max(1, round(step_m / PERIOD_M * SIZE))
    mean: FloatArray = ndimage.uniform_filter(
        stone_m * stones + straw_m * straw, width, mode="wrap"
    )
    return mean


def _add_litter(material: Material, soil: Soil, seed: int) -> Material:
    """Add stones and the residue of the last crop."""
    colour, height = material
    stones, grey, straw, pale = _scatter_litter(soil, seed)
    rock = np.array([150.0, 143.0, 132.0]) * (1.0 + 0.16 * grey[..., None])
    colour = _blend(colour, rock, 0.92 * np.clip(stones * 5, 0, 1))
    stalk = np.array([186.0, 165.0, 118.0]) * (1.0 + 0.18 * pale[..., None])
    colour = _blend(colour, stalk, 0.9 * np.clip(straw * 2, 0, 1))
    return colour, height + 7.0 * stones + 3.0 * straw


def build_surface_texture(
    surface: str,
    seed: int,
    to_sun: FloatArray,
    relief_ratio: float,
    soil: Soil = BARE,
    flint_cover_ratio: float = 0.0,
) -> npt.NDArray[np.float32]:
    """Build colours (n, n, 3), 0 to 255, rows along map y; slopes that face the sun are brighter.

    What lies on the `soil`, and flints, is on the surfaces "soil" and "track".

    Raises: DescriptionError: no such surface.
    """
    colour, height = _make_material(surface, seed)
    if surface in EARTH and (soil.stones_ratio or soil.residue_ratio):
        colour, height = _add_litter((colour, height), soil, seed)
    if surface in EARTH and flint_cover_ratio > 0.0:
        colour, height = add_flints((colour, height), flint_cover_ratio, seed)
    slope_x = np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)
    slope_y = np.roll(height, -1, axis=0) - np.roll(height, 1, axis=0)
    steep = 0.20 * relief_ratio
    lit = 1.0 - steep * (slope_x * to_sun[0] + slope_y * to_sun[1])
    hollow = height - ndimage.uniform_filter(height, 9, mode="wrap")
    lit = np.clip(lit, 0.35, 1.6) * np.clip(1.0 + 0.035 * hollow, 0.7, 1.15)
    image: npt.NDArray[np.float32] = np.clip(colour * lit[..., None], 0.0, 255.0).astype(np.float32)
    return image


@lru_cache(maxsize=4)
def build_tone_map(seed: int, wet_ratio: float = 0.0) -> npt.NDArray[np.float32]:
    """Build slow changes of brightness, (n, n) about 1, that hide the repeats of a texture.

    `wet_ratio` of the ground is darker, in patches of a metre or a few.
    """
    shape = (TONE_SIZE, TONE_SIZE)
    noise = make_tileable_noise(np.random.default_rng([seed, 9]), shape, exponent=1.1, finest=32)
    tone = 1.0 + 0.09 * noise
    if wet_ratio > 0.0:
        damp = make_tileable_noise(
            np.random.default_rng([seed, 10]), shape, exponent=2.4, coarsest=7
        )
        edge = np.quantile(damp, 1.0 - wet_ratio) if wet_ratio < 1.0 else -np.inf
        tone *= 1.0 - WET_DARKENING * np.clip((damp - edge) / 1.4 + 0.5, 0.0, 1.0)
    return tone.astype(np.float32)
