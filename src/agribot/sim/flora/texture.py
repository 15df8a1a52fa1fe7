"""Procedural textures: tileable noise and the atlas of leaf surfaces."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import fft

from agribot.core.messages import FloatArray
from agribot.sim.flora.habit import Species
from agribot.sim.flora.species import SPECIES

CELL_WIDTH = 64
CELL_HEIGHT = 128
PETIOLE_V = 0.3  # part of a leaf texture, from the base, that petioles and stems take


def make_tileable_noise(
    rng: np.random.Generator,
    shape: tuple[int, int],
    *,
    exponent: float,
    coarsest: float = 2.0,
    finest: float | None = None,
) -> FloatArray:
    """Make periodic noise (rows, columns) of unit deviation, amplitude ~ frequency^-exponent.

    `coarsest` and `finest` bound the spatial frequency in cycles per longer side.
    """
    rows, columns = shape
    longer = max(shape)
    fy = np.abs(fft.fftfreq(rows)[:, None]) * longer
    fx = fft.rfftfreq(columns)[None, :] * longer
    frequency = np.hypot(fx, fy)
    amplitude = np.where(frequency < coarsest, 0.0, np.maximum(frequency, 1e-9) ** -exponent)
    if finest is not None:
        amplitude *= np.exp(-((frequency / finest) ** 2))
    white = fft.rfft2(rng.standard_normal(shape))
    field: FloatArray = fft.irfft2(white * amplitude, s=shape)
    field /= field.std()
    return field


def _draw_veins(kind: Species, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the share of the rib's colour, 0 to 1; u in [-1, 1] across, v in [0, 1] along."""
    if kind.veins == 0:
        pattern: FloatArray = 0.8 * np.exp(-((u / 0.09) ** 2)) + 0.10 * np.cos(u * 40) + 0 * v
        return np.clip(pattern, 0.0, 1.0)
    taper = 0.05 + 0.06 * (1 - v)
    pattern = 0.95 * np.exp(-((u / taper) ** 2))
    for start in np.linspace(0.2, 0.95, kind.veins):
        distance = (v - start) - 0.16 * np.abs(u)
        pattern = pattern + 0.35 * np.exp(-((distance / 0.012) ** 2)) * np.exp(-0.8 * np.abs(u))
    return np.clip(pattern, 0.0, 1.0)


def _draw_leaf_cell(rng: np.random.Generator, kind: Species) -> FloatArray:
    shape = (CELL_HEIGHT, CELL_WIDTH)
    u = np.linspace(-1.0, 1.0, CELL_WIDTH)[None, :]
    v = np.linspace(0.0, 1.0, CELL_HEIGHT)[:, None]
    blotch = make_tileable_noise(rng, shape, exponent=1.3)[..., None]
    colour: FloatArray = np.array(kind.leaf_rgb) * (1 + kind.wear * blotch)
    colour = colour + np.array([10.0, 2.0, -6.0]) * (np.abs(u) ** 3)[..., None]
    rib = _draw_veins(kind, u, v)[..., None]
    colour = colour * (1 - 0.6 * rib) + np.array(kind.rib_rgb) * 0.6 * rib
    stalk = np.clip((PETIOLE_V - v) / 0.06, 0.0, 1.0)[..., None]
    stalk = stalk * (0.35 + 0.65 * np.exp(-((u / 0.7) ** 2)))[..., None]
    if kind.cell in (3, 5):
        stalk = stalk * 0.5
    colour = colour * (1 - stalk) + np.array(kind.stalk_rgb) * stalk * (1 + 0.05 * blotch)
    return colour


@lru_cache(maxsize=4)
def build_leaf_atlas(seed: int) -> npt.NDArray[np.float32]:
    """Build the leaf surfaces (species, height, width, 3), 0 to 255, in the order of the cells."""
    rng = np.random.default_rng([seed, 77])
    cells = [_draw_leaf_cell(rng, kind) for kind in SPECIES.values()]
    return np.clip(np.stack(cells), 0.0, 255.0).astype(np.float32)
