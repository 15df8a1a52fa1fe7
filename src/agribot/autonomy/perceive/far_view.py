"""The ground that a front camera sees as far as rows can be separated, and how they lie on it.

Rows are parallel and equally spaced: on the ground they are a comb of lines, given by direction,
place and spacing. The ground is that of a camera at any of some tilts, as a robot on rough ground
has them.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray

Comparison = npt.NDArray[np.float32]
Index = npt.NDArray[np.intp]

# Height of foliage, which is seen from above: a leaf at height h seems to lie h / H of its way
# farther off.
FOLIAGE_M = 0.08
CELLS = 64  # rows and columns in which a picture is looked at
# A camera that sees level ground farther than this at its upper edge sees rows run away from it.
LEAST_FAR_M = 3.0
LEAST_SINK_RATIO = 0.14  # least sink of a ray per metre ahead; farther off rows are too fine
LEAST_TILTED_RATIO = 0.05  # the same of a camera that is tilted up
SIDE_M, BINS = 4.0, 320  # reach to both sides, and places across the rows in which cover is counted
PLACES_M = ((np.arange(BINS) + 0.5) / BINS * 2.0 - 1.0) * SIDE_M  # middles, left positive
PLANTS = 400.0  # independent ones as which a picture counts
# Harmonics of a comb, and the heights of its teeth.
HARMONICS, HEIGHTS = np.arange(1, 4), np.array([1.0, 0.7, 0.4])
PHASES = np.linspace(0.0, 1.0, 32, endpoint=False)  # phases of a comb, in spacings
TURNS = 2.0 * np.pi * HARMONICS[:, None] * PHASES
TEETH = np.concatenate([np.cos(TURNS), np.sin(TURNS)]) * np.tile(HEIGHTS, 2)[:, None]


class RowGrid(NamedTuple):
    """Combs to compare with: tilts of the camera, directions of rows, and their spacings."""

    tilts_rad: FloatArray
    yaws_rad: FloatArray
    spacings_m: FloatArray


COARSE_TILTS_RAD = np.radians(np.linspace(-6.0, 6.0, 7))
COARSE_YAWS_RAD = np.radians(np.linspace(-30.0, 30.0, 31))
ANY_SPACING_M = np.geomspace(0.25, 1.0, 26)
KNOWN_SPACING_RATIO = np.geomspace(0.78, 1.28, 9)  # ratios to the spacing of the field's rows


class Comb(NamedTuple):
    """A comb of parallel rows; `left_m` is how far left of the body's origin one passes."""

    tilt_rad: float
    yaw_rad: float
    spacing_m: float
    left_m: float
    bend_per_m: float


class Compared(NamedTuple):
    """Correlations (tilts, yaws, spacings) with combs at their best phase, and where they lie.

    `left_m` is how far left of the body's origin a line of the comb passes.
    """

    score: Comparison
    left_m: Comparison


class FarGround(NamedTuple):
    """Places (N,) of the body frame that cells show at one tilt, and how much each counts."""

    x_m: FloatArray
    y_m: FloatArray
    weight: FloatArray
    cell: Index


class FarView:
    """The view of one camera, made once: the ground of its cells at each tilt."""

    def __init__(
        self,
        rays_body: FloatArray,
        camera_m: FloatArray,
        spacing_m: float | None = None,
        tilts_rad: FloatArray = COARSE_TILTS_RAD,
        *,
        is_mounted: bool = True,
    ) -> None:
        """Take the directions (CELLS, CELLS, 3) into which cells look at no tilt; NaN looks none.

        Rows of the field are `spacing_m` apart, None where that is not known. A mounted camera is
        tilted a little only: tilts are compared by the same cells, or the one that sees least of
        the far rows, which fit worst, would seem best.
        """
        self.camera_m, self.spacing_m = camera_m, spacing_m
        spacings_m = ANY_SPACING_M if spacing_m is None else spacing_m * KNOWN_SPACING_RATIO
        self.coarse = RowGrid(tilts_rad, COARSE_YAWS_RAD, spacings_m)
        ahead, left, up = rays_body.reshape(-1, 3).T
        away = np.hypot(ahead, left)
        self._cell = np.flatnonzero(-up > LEAST_SINK_RATIO * away if is_mounted else away >= 0.0)
        self._ahead, self._left, self._down = (part[self._cell] for part in (ahead, left, -up))
        # Far rows of plants are as many as near ones, in fewer lines of the picture.
        self._weight = away[self._cell] / self._down if is_mounted else None
        self._grounds = [self.find_ground(float(tilt_rad)) for tilt_rad in tilts_rad]
        self._bins = [_find_bins(ground, COARSE_YAWS_RAD) for ground in self._grounds]

    @classmethod
    def open(
        cls,
        x_m: npt.NDArray[np.floating],
        y_m: npt.NDArray[np.floating],
        range_m: npt.NDArray[np.floating],
        camera_m: FloatArray,
        spacing_m: float | None = None,
    ) -> Self | None:
        """Open the view of a camera whose pixels (h, w) see these places; None if it looks down."""
        farthest_m = np.nan_to_num(range_m[0], nan=math.inf)
        if min(x_m.shape) < CELLS or float(np.median(farthest_m)) < LEAST_FAR_M:
            return None
        rows, columns = (
            ((np.arange(CELLS) + 0.5) * size / CELLS).astype(np.intp) for size in x_m.shape
        )
        at = np.ix_(rows, columns)
        places_m = [x_m[at], y_m[at], np.zeros((CELLS, CELLS))]
        return cls(np.stack(places_m, axis=-1).astype(np.float64) - camera_m, camera_m, spacing_m)

    def find_ground(self, tilt_rad: float) -> FarGround:
        """Find the ground of the cells where the camera looks further down by a tilt."""
        cos, sin = math.cos(tilt_rad), math.sin(tilt_rad)
        ahead = cos * self._ahead - sin * self._down
        sink = sin * self._ahead + cos * self._down
        away = np.hypot(ahead, self._left)
        reach = (float(self.camera_m[2]) - FOLIAGE_M) / np.maximum(sink, LEAST_TILTED_RATIO * away)
        place_m = ahead * reach + self.camera_m[0], self._left * reach + self.camera_m[1]
        if self._weight is not None:
            return FarGround(*place_m, self._weight, self._cell)
        is_seen = sink > LEAST_SINK_RATIO * away
        x_m, y_m, weight = (part[is_seen] for part in (*place_m, away * reach))
        return FarGround(x_m, y_m, weight, self._cell[is_seen])

    def sum_by_row(self, contrast: FloatArray, comb: Comb) -> tuple[FloatArray, FloatArray]:
        """Sum contrast by its place across a comb: places (BINS,) in spacings from its line."""
        ground = self.find_ground(comb.tilt_rad)
        bins = _find_bins(ground, np.array([comb.yaw_rad]), comb.bend_per_m)
        return (PLACES_M - comb.left_m) / comb.spacing_m, _sum_across(contrast, ground, bins)[0]

    def compare(self, contrast: FloatArray) -> Compared:
        """Correlate a contrast (CELLS, CELLS) with the combs of `coarse`."""
        pairs = zip(self._grounds, self._bins, strict=True)
        sums = [_sum_across(contrast, ground, bins) for ground, bins in pairs]
        return _correlate(np.stack(sums), self.coarse.spacings_m)

    def compare_fine(
        self, contrast: FloatArray, grid: RowGrid, bend_per_m: float = 0.0
    ) -> Compared:
        """Correlate with combs of a grid; rows bend left by `bend_per_m` radians a metre."""
        sums = []
        for tilt_rad in grid.tilts_rad:
            ground = self.find_ground(float(tilt_rad))
            bins = _find_bins(ground, grid.yaws_rad, bend_per_m)
            sums.append(_sum_across(contrast, ground, bins))
        return _correlate(np.stack(sums), grid.spacings_m)


def _find_bins(ground: FarGround, yaws_rad: FloatArray, bend_per_m: float = 0.0) -> Index:
    """Find the bin (yaws, N) of each place across rows of each direction."""
    cos, sin = np.cos(yaws_rad)[:, None], np.sin(yaws_rad)[:, None]
    left_m = cos * ground.y_m - sin * ground.x_m - bend_per_m * ground.x_m**2 / 2.0
    bins: Index = ((left_m / SIDE_M + 1.0) * (BINS / 2)).clip(0, BINS - 1).astype(np.intp)
    own: Index = bins + BINS * np.arange(len(yaws_rad))[:, None]
    return own


def _sum_across(contrast: FloatArray, ground: FarGround, bins: Index) -> FloatArray:
    """Sum contrast by its place across rows, (yaws, BINS), so that a comb in full sums to 1."""
    value = contrast.ravel()[ground.cell]
    power = float((value**2 * ground.weight).sum() * ground.weight.sum())
    share = value * ground.weight / math.sqrt(power + 1e-12)
    shares: FloatArray = np.broadcast_to(share, bins.shape).ravel()
    table: FloatArray = np.zeros((len(bins), BINS))
    table += np.bincount(bins.ravel(), shares, table.size).reshape(table.shape)
    table[:, [0, -1]] = 0.0  # the same in all columns farther aside
    return table


def _correlate(sums: FloatArray, spacings_m: FloatArray) -> Compared:
    """Correlate sums (tilts, yaws, BINS) with the teeth of each spacing at the best phase."""
    turns = 2.0 * np.pi * PLACES_M[:, None, None] * HARMONICS / spacings_m[:, None]
    waves = np.concatenate([np.cos(turns), np.sin(turns)], axis=2).reshape(BINS, -1)
    parts = (sums @ waves).reshape(*sums.shape[:2], len(spacings_m), -1)
    teeth = parts @ TEETH
    best = teeth.argmax(axis=3)
    score = np.take_along_axis(teeth, best[..., None], axis=3)[..., 0]
    left_m = PHASES[best] * spacings_m
    return Compared(score.astype(np.float32), left_m.astype(np.float32))
