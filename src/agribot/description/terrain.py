"""Uneven ground: height maps of files, and two landscapes from a seed.

`python -m agribot.description.terrain` writes the height maps of the package again; a test
holds the samples.
"""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from agribot.core.errors import DescriptionError, add_advice
from agribot.core.geo import inverse
from agribot.core.messages import FloatArray
from agribot.core.world import HeightField
from agribot.description.package import ROOT
from agribot.description.pictures import FULL_SCALE, read_grey

MAX_SAMPLES = 4097  # samples along one side
# Centre of the arcs of the hills' crop rows, North and West of the heights' middle.
HILL_TOP_XY_M = (-4.0, 3.0 - 1.0 + 1.0 / 0.03)
SWELL_M = 0.5
# The errors of numpy.load on damaged files; it takes some for archives and some for Python 2's.
NOT_NPY = (OSError, ValueError, TypeError, AttributeError, KeyError, OverflowError, SyntaxError,
           EOFError, tokenize.TokenError, zipfile.BadZipFile)  # fmt: skip


def make_volcano(
    seed: int, samples: int = 257, size_m: float = 150.0, top_m: float = 50.0
) -> FloatArray:
    """Make a cone with a crater, gullies and rough lava, (samples, samples), rows to the North.

    The foot is level at 0 and the rim at about `top_m`.
    """
    rng = np.random.default_rng([seed, 41])
    at_m = np.linspace(-size_m / 2.0, size_m / 2.0, samples)
    x, y = np.meshgrid(at_m, at_m)
    angle, reach = np.arctan2(y, x), np.hypot(x, y) / (size_m / 2.0)
    wobble = sum(
        rng.normal(0.0, 0.05 / k) * np.cos(k * angle + rng.uniform(0.0, math.tau))
        for k in range(1, 6)
    )
    reach = reach * (1.0 + wobble)
    rim, foot = 0.16, 0.95
    flank = np.clip((foot - reach) / (foot - rim), 0.0, 1.0) ** 2.0
    crater = 0.78 + 0.22 * np.clip(reach / rim, 0.0, 1.0) ** 2
    cone = np.where(reach < rim, crater, flank)
    gullies = np.abs(np.cos(9 * angle + rng.uniform(0.0, math.tau) + 2.0 * reach)) ** 0.7
    cone -= 0.035 * gullies * np.clip(4.0 * flank * (1.0 - flank), 0.0, 1.0)
    height = cone + 0.012 * _make_noise(rng, samples, 4) * np.clip(1.5 * flank, 0.0, 1.0)
    height -= height.min()
    rise: FloatArray = height * (top_m / float(height.max()))
    return rise


def make_hills(
    seed: int, samples: int = 129, size_m: float = 48.0, slope_deg: float = 10.0
) -> FloatArray:
    """Make the flank of a round hill with long gentle swells, (samples, samples), from 0 up.

    Contour lines are arcs about HILL_TOP_XY_M, in the frame of the heights.
    """
    at_m = np.linspace(-size_m / 2.0, size_m / 2.0, samples)
    x, y = np.meshgrid(at_m, at_m)
    away_m = np.hypot(x - HILL_TOP_XY_M[0], y - HILL_TOP_XY_M[1])
    swell = _make_noise(np.random.default_rng([seed, 42]), samples, 2)
    height = SWELL_M * (swell / float(np.ptp(swell))) - math.tan(math.radians(slope_deg)) * away_m
    rise: FloatArray = height - height.min()
    return rise


def _make_noise(rng: np.random.Generator, samples: int, cycles: int) -> FloatArray:
    """Make smooth random heights of about unit spread: a few waves in all directions."""
    at = np.linspace(0.0, math.tau, samples)
    x, y = np.meshgrid(at, at)
    total = np.zeros((samples, samples))
    for _ in range(24):
        heading, wave = rng.uniform(0.0, math.tau), cycles * float(rng.uniform(0.5, 2.0))
        along = x * math.cos(heading) + y * math.sin(heading)
        total += np.cos(wave * along + rng.uniform(0.0, math.tau)) / wave
    return total / float(total.std())


def load_heights(path: Path) -> FloatArray:
    """Load a height map (rows, columns) as ratios 0 to 1 of its full scale, rows to the North.

    Pictures have North at the top; .npy files hold metres, rows to the North, and stay metres.
    Raises: DescriptionError: nothing that can be read, not finite, or too large.
    """
    heights = _read_samples(path) if path.suffix == ".npy" else read_grey(path, MAX_SAMPLES)
    if heights.ndim != 2 or not 2 <= min(heights.shape) <= max(heights.shape) <= MAX_SAMPLES:
        raise DescriptionError(
            f"{path.name} has {heights.shape} samples; a height map needs 2 x 2 to "
            f"{MAX_SAMPLES} x {MAX_SAMPLES}"
        )
    return heights


def _read_samples(path: Path) -> FloatArray:
    try:  # mapped, so that a wrong size in the file's head does not fill the memory
        heights = np.load(path, mmap_mode="r", allow_pickle=False)
        if heights.size > MAX_SAMPLES**2 or not np.isfinite(heights).all():
            raise ValueError(
                f"{heights.shape} samples, or some that are not finite; save finite heights, at "
                f"most {MAX_SAMPLES} on a side"
            )
        metres: FloatArray = np.asarray(heights, dtype=np.float64)
    except NOT_NPY as error:
        fact = f"{path.name} holds no heights: {error}"
        raise DescriptionError(add_advice(fact, "save them with numpy.save")) from error
    return metres


def encode_png(heights_m: FloatArray) -> bytes:
    """Encode heights (rows, columns) as a 16-bit PNG, North at the top, scaled to the highest."""
    from PIL import Image

    scaled = np.flipud(heights_m) * (FULL_SCALE / float(heights_m.max()))
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(np.round(scaled).astype(np.uint16))).save(file, "PNG")
    return file.getvalue()


def place_heights(
    heights_m: FloatArray, size_m: tuple[float, float], map_from_field: FloatArray
) -> HeightField:
    """Place heights (rows, columns) over a rectangle about a frame's origin, as terrain.

    The result lies along the map's axes; `map_from_field` is (4, 4).
    A frame that is turned by quarter turns keeps its samples; any other is resampled.
    """
    rows, columns = heights_m.shape
    half = np.array(size_m) / 2.0
    corners = np.array([[x, y, 0.0, 1.0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    low, high = (pick((map_from_field @ corners.T)[:2], axis=1) for pick in (np.min, np.max))
    step_m = float(min(size_m[0] / (columns - 1), size_m[1] / (rows - 1)))
    x_m = low[0] + step_m * np.arange(math.floor((high[0] - low[0]) / step_m + 1.001))
    y_m = low[1] + step_m * np.arange(math.floor((high[1] - low[1]) / step_m + 1.001))
    grid_x, grid_y = np.meshgrid(x_m, y_m)
    field_from_map = inverse(map_from_field)
    u = field_from_map[0, 0] * grid_x + field_from_map[0, 1] * grid_y + field_from_map[0, 3]
    v = field_from_map[1, 0] * grid_x + field_from_map[1, 1] * grid_y + field_from_map[1, 3]
    column = (u + half[0]) / size_m[0] * (columns - 1)
    row = (v + half[1]) / size_m[1] * (rows - 1)
    return HeightField(
        height_m=_interpolate(heights_m, row, column) + map_from_field[2, 3],
        x_min_m=round(float(low[0]), 9),
        y_min_m=round(float(low[1]), 9),
        resolution_m=step_m,
    )


def sample_height(field: HeightField, x_map_m: float, y_map_m: float) -> float:
    """Return the height of the terrain below a place; outside it is level."""
    row = np.array([(y_map_m - field.y_min_m) / field.resolution_m])
    column = np.array([(x_map_m - field.x_min_m) / field.resolution_m])
    return float(_interpolate(field.height_m, row, column)[0])


def _interpolate(grid: FloatArray, row: FloatArray, column: FloatArray) -> FloatArray:
    """Interpolate a grid at fractional rows and columns, held at the edges."""
    row = np.clip(np.where(np.abs(row - np.round(row)) < 1e-9, np.round(row), row), 0, None)
    column = np.clip(
        np.where(np.abs(column - np.round(column)) < 1e-9, np.round(column), column), 0, None
    )
    r = np.minimum(row.astype(int), grid.shape[0] - 2)
    c = np.minimum(column.astype(int), grid.shape[1] - 2)
    v, u = np.minimum(row - r, 1.0), np.minimum(column - c, 1.0)
    low = grid[r, c] * (1.0 - u) + grid[r, c + 1] * u
    high = grid[r + 1, c] * (1.0 - u) + grid[r + 1, c + 1] * u
    values: FloatArray = low * (1.0 - v) + high * v
    return values


LANDSCAPES: dict[str, Callable[[], FloatArray]] = {
    "volcano": lambda: make_volcano(7),
    "hills": lambda: make_hills(3),
}


def find_landscape_file(name: str) -> Path:
    return ROOT / "models" / name / f"{name}.png"


if __name__ == "__main__":
    for _name, _make in LANDSCAPES.items():
        find_landscape_file(_name).parent.mkdir(parents=True, exist_ok=True)
        find_landscape_file(_name).write_bytes(encode_png(_make()))
