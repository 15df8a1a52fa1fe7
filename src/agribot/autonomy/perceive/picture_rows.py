"""Rows of crop in photographs of several rows in perspective, without calibration or labels.

Rows are parallel on the ground, so that their lines meet in one vanishing point and cross the lower
edge of the picture at equal distances. Each picture is compared with combs of such lines; what all
pictures of one camera agree on (its horizon, where it looks, how far apart the rows are) then
weighs the combs of each (empirical Bayes). All lengths are shares of the picture's width or height.
Source: Barnard 1983 (vanishing points by accumulation); Robbins 1956 (empirical Bayes).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray

Comparison = npt.NDArray[np.float32]

CELLS = 96  # rows and columns in which a picture is looked at
# Combs of lines: heights of the lower edge below the horizon, across of the vanishing point, and
# distances of two lines on the lower edge.
DEPTH_RATIOS = np.geomspace(0.8, 1.9, 26)
ACROSS_RATIOS = np.linspace(-0.2, 1.2, 36)
SPACING_RATIOS = np.geomspace(0.2, 1.2, 36)
# Harmonics of a comb, and the heights of its teeth.
HARMONICS, HEIGHTS = np.arange(1, 4), np.array([1.0, 0.7, 0.4])
PHASES = np.linspace(0.0, 1.0, 48, endpoint=False)  # phases of a comb, in spacings
FAR_RATIO = 0.12  # distance from the horizon below which rows are too fine
WINDOW_RATIO = 0.5  # width over which cover is compared with its surroundings
FLAT_CONTRAST = 0.1  # least contrast of cover
BANDS = 3  # bands of a picture that are shifted aside; a plant from close above lies in one of them
FOOT_RATIO, FOOT_BINS = 4.0, 512  # reach of feet of pixels beside the vanishing point
# Independent plants as which a picture counts; rounds of learning what pictures share; its width in
# steps of the grids across and of spacings; the share of pictures that may be unlike the others.
PLANTS, ROUNDS, SHARED_STEPS, UNLIKE_RATIO = 400.0, 6, (1.5, 2.5), 0.1
# Standard deviation of a picture's horizon from that of all, and the least log-likelihood of one.
HORIZON_STD_RATIO, LEAST_DOUBT = 0.04, -4.0


# Errors within which a line is right, at a share of the picture's height.
SURE_RAD, SURE_RATIO, JUDGED_AT_RATIO = np.radians(5.0), 0.2, 2.0 / 3.0


class PictureRows(NamedTuple):
    """Rows whose lines meet at (`across_ratio`, `down_ratio`) of a picture's width and height.

    They cross its lower edge at `foot_ratio` of its width and every `spacing_ratio` from there.
    `score` is the correlation of plants with the lines, 0 to 1; `evidence` weighs it with what all
    pictures show, in natural logarithms. `sure` is how likely the line nearest to the middle of the
    lower edge lies within SURE_RAD and SURE_RATIO of a spacing of the true one.
    """

    across_ratio: float
    down_ratio: float
    foot_ratio: float
    spacing_ratio: float
    score: float
    evidence: float
    sure: float = 1.0

    def find_feet(self) -> FloatArray:
        """Find where lines cross the lower edge and its continuation, from left to right."""
        count = np.arange(-12.0, 13.0)
        feet: FloatArray = self.foot_ratio + count * self.spacing_ratio
        return feet

    def measure_off(self, height: int, width: int) -> FloatArray:
        """Measure how far each pixel (height, width) is from the nearest line, in spacings.

        NaN near and above the horizon.
        """
        down = (np.arange(height)[:, None] + 0.5) / height - self.down_ratio
        across = (np.arange(width)[None, :] + 0.5) / width - self.across_ratio
        depth = np.where(down > FAR_RATIO, down, np.nan)
        foot = self.across_ratio + across * (1.0 - self.down_ratio) / depth
        turns = (foot - self.foot_ratio) / self.spacing_ratio
        off: FloatArray = np.abs(turns - np.round(turns))
        return off


class Grid(NamedTuple):
    """Combs to compare with: depths of the lower edge, vanishing points across, spacings."""

    depths: FloatArray
    acrosses: FloatArray
    spacings: FloatArray

    @property
    def shape(self) -> tuple[int, int, int]:
        return len(self.depths), len(self.acrosses), len(self.spacings)


COARSE = Grid(DEPTH_RATIOS, ACROSS_RATIOS, SPACING_RATIOS)


class _Compared(NamedTuple):
    """Correlations of a picture with the combs of a grid, and the phases at which they hold."""

    score: Comparison
    phase: Comparison


def find_rows(
    contrasts: Sequence[FloatArray], rng: np.random.Generator
) -> tuple[list[PictureRows], FloatArray]:
    """Find the rows of pictures of one camera, each as `measure_contrast` measures it.

    Returns: the rows of each, and the evidence that each would have without rows: that of the same
    picture in bands that are shifted aside by `rng`.
    """
    compared = [_compare(contrast, COARSE) for contrast in contrasts]
    prior = _learn_shared(np.stack([one.score for one in compared]))
    rows = [_refine(*pair, prior) for pair in zip(contrasts, compared, strict=True)]
    without = np.stack([_compare(_shift_bands(one, rng), COARSE).score for one in contrasts])
    # Pictures without rows share something by chance, too.
    by_chance = _learn_shared(without)
    return rows, np.array([float(_weigh(score, by_chance).max()) for score in without])


def measure_contrast(cover: FloatArray, count: int = CELLS) -> FloatArray:
    """Measure how a cover (H, W) with plants differs from that beside it, in (count, count) cells.

    Every line of the picture counts alike, however large its plants look.
    """
    down, across = (_make_means(size, count) for size in cover.shape)
    cells = down @ cover @ across.T
    contrast = cells - cells @ _make_windows(count)
    contrast -= contrast.mean(axis=1, keepdims=True)
    measured: FloatArray = contrast / (contrast.std(axis=1, keepdims=True) + FLAT_CONTRAST)
    return measured


def _make_means(size: int, cells: int) -> FloatArray:
    """Make the matrix (cells, size) that averages pixels in equal cells."""
    edges, pixels = np.linspace(0.0, size, cells + 1), np.arange(size)
    end = np.minimum(edges[1:, None], pixels + 1.0)
    overlap = end - np.maximum(edges[:-1, None], pixels)
    means: FloatArray = overlap.clip(0.0) * (cells / size)
    return means


def _make_windows(count: int) -> FloatArray:
    """Make the matrix that averages each cell of a line with those beside it."""
    cells = np.arange(count)
    is_near = np.abs(cells[:, None] - cells) <= WINDOW_RATIO * count / 2.0
    windows: FloatArray = is_near / is_near.sum(axis=0)
    return windows


def _compare(contrast: FloatArray, grid: Grid) -> _Compared:
    """Correlate a picture with each comb of a grid at its best phase."""
    score, phase = np.zeros(grid.shape, np.float32), np.zeros(grid.shape, np.float32)
    waves = _make_waves(grid.spacings)
    turns = np.exp(-2j * np.pi * HARMONICS[:, None] * PHASES) * HEIGHTS[:, None]
    for i, depth in enumerate(grid.depths.tolist()):
        for j, sums in enumerate(_sum_by_foot(contrast, depth, grid.acrosses)):
            teeth = np.real((sums @ waves).reshape(-1, len(HARMONICS)) @ turns)
            score[i, j], phase[i, j] = teeth.max(axis=1), PHASES[teeth.argmax(axis=1)]
    return _Compared(score, phase)


def _make_waves(spacings: FloatArray) -> npt.NDArray[np.complex128]:
    """Make the waves of each spacing over the bins of feet, (FOOT_BINS, spacings * HARMONICS)."""
    feet = ((np.arange(FOOT_BINS) + 0.5) / FOOT_BINS * 2.0 - 1.0) * FOOT_RATIO
    turns = feet[:, None, None] * HARMONICS / spacings[None, :, None]
    waves: npt.NDArray[np.complex128] = np.exp(2j * np.pi * turns).reshape(FOOT_BINS, -1)
    return waves


def _sum_by_foot(contrast: FloatArray, depth: float, acrosses: FloatArray) -> FloatArray:
    """Sum contrast by where lines from vanishing points through it meet the lower edge.

    Lines of the picture count by one over their depth, as many rows of plants fit there.
    Returns: (acrosses, FOOT_BINS), so normalised that a comb that fits in full sums to about 1.
    """
    middles = (np.arange(CELLS) + 0.5) / CELLS
    below = middles - 1.0 + depth
    is_near = below > FAR_RATIO
    weight = 1.0 / below[is_near, None]
    power = float((contrast[is_near] ** 2 * weight).sum() * weight.sum() * CELLS)
    weighted = (contrast[is_near] * weight / np.sqrt(power + 1e-12)).ravel()
    scale = depth / below[is_near, None]
    sums = np.empty((len(acrosses), FOOT_BINS))
    for j, across in enumerate(acrosses.tolist()):
        bins = ((middles - across) * scale / FOOT_RATIO + 1.0) * (FOOT_BINS / 2)
        bins = bins.clip(0, FOOT_BINS - 1).astype(np.intp).ravel()
        sums[j] = np.bincount(bins, weighted, FOOT_BINS)
    sums[:, [0, -1]] = 0.0
    return sums


def _weigh(score: Comparison, prior: FloatArray) -> FloatArray:
    """Weigh combs: the log-likelihood of a correlation of PLANTS points, and what is shared."""
    weighed: FloatArray = 0.5 * PLANTS * score.clip(0.0) ** 2 + np.log(prior * prior.size)
    return weighed


def _learn_shared(scores: Comparison) -> FloatArray:
    """Learn how likely combs are in any picture of the camera from all of them (N, *grid)."""
    unlike = _learn_horizon(scores)[:, None, None] * np.ones(scores.shape[1:])
    unlike /= unlike.sum()
    prior = unlike
    for _ in range(ROUNDS):
        share = np.zeros_like(prior)
        for score in scores:
            share += _find_likely(_weigh(score, prior))
        smooth = _smooth(share.sum(axis=0)) * unlike
        prior = (1.0 - UNLIKE_RATIO) * smooth / smooth.sum() + UNLIKE_RATIO * unlike
    return prior


def _learn_horizon(scores: Comparison) -> FloatArray:
    """Learn how likely depths of the lower edge below the one horizon of all pictures are."""
    total = np.zeros(len(DEPTH_RATIOS))
    for score in scores:
        likely = _find_likely(0.5 * PLANTS * score.clip(0.0) ** 2).sum(axis=(1, 2))
        total += np.log(likely / likely.max()).clip(LEAST_DOUBT)
    off = (DEPTH_RATIOS - DEPTH_RATIOS[total.argmax()]) / HORIZON_STD_RATIO
    near: FloatArray = np.exp(-0.5 * off**2) + 1e-12
    return near


def _smooth(share: FloatArray) -> FloatArray:
    """Smooth over SHARED_STEPS of both axes (acrosses, spacings)."""
    for axis, steps in enumerate(SHARED_STEPS):
        off = np.arange(share.shape[axis])[:, None] - np.arange(share.shape[axis])
        near = np.exp(-0.5 * (off / steps) ** 2)
        share = np.moveaxis(np.tensordot(near, share, (1, axis)), 0, axis)
    return share


def _find_likely(weighed: FloatArray) -> FloatArray:
    """Find the share of each comb in all by their log-likelihoods."""
    likely = np.exp(weighed - weighed.max())
    shares: FloatArray = likely / likely.sum()
    return shares


def _refine(contrast: FloatArray, compared: _Compared, prior: FloatArray) -> PictureRows:
    """Take the likeliest comb of a picture, and the best one around it between the grid's steps."""
    weighed = _weigh(compared.score, prior)
    best = np.unravel_index(int(weighed.argmax()), weighed.shape)
    fine = Grid(*(_split(axis, int(k)) for axis, k in zip(COARSE, best, strict=True)))
    around = _compare(contrast, fine)
    k = np.unravel_index(int(_weigh(around.score, _interpolate(prior, fine)).argmax()), fine.shape)
    depth, across, spacing = (float(axis[i]) for axis, i in zip(fine, k, strict=True))
    rows = PictureRows(
        across_ratio=across,
        down_ratio=1.0 - depth,
        foot_ratio=across + float(around.phase[k]) * spacing,
        spacing_ratio=spacing,
        score=float(around.score[k]),
        evidence=float(weighed[best]),
    )
    return rows._replace(sure=_find_sure_share(rows, compared.phase, _find_likely(weighed)))


def _interpolate(prior: FloatArray, fine: Grid) -> FloatArray:
    """Interpolate a prior of the coarse grid at the steps of a fine one."""
    depths, acrosses, spacings = (
        np.array([np.interp(steps, axis, unit) for unit in np.eye(len(axis))])
        for steps, axis in zip(fine, COARSE, strict=True)
    )
    between: FloatArray = np.einsum(
        "ia,jb,kc,ijk->abc", depths, acrosses, spacings, prior, optimize=True
    )
    return between * (prior.size / between.size)


def _find_sure_share(rows: PictureRows, phase: Comparison, share: FloatArray) -> float:
    """Find the share of all combs with a line where the one nearest to the middle of a comb is."""
    feet = rows.find_feet()
    foot = float(feet[np.abs(feet - 0.5).argmin()])
    slope = (foot - rows.across_ratio) / (1.0 - rows.down_ratio)
    at = foot + slope * (JUDGED_AT_RATIO - 1.0)
    depth, across, spacing = np.meshgrid(*COARSE, indexing="ij")
    nearer = (JUDGED_AT_RATIO - 1.0 + depth) / depth
    first = across + phase * spacing * nearer
    others = first + np.round((at - first) / (spacing * nearer)) * spacing * nearer
    slopes = (others - across) / (JUDGED_AT_RATIO - 1.0 + depth)
    apart = rows.spacing_ratio * (JUDGED_AT_RATIO - rows.down_ratio) / (1.0 - rows.down_ratio)
    is_right = np.abs(np.arctan(slopes) - np.arctan(slope)) < SURE_RAD
    is_right &= np.abs(others - at) < SURE_RATIO * apart
    return float(share[is_right].sum())


def _split(axis: FloatArray, k: int) -> FloatArray:
    """Split the steps beside a value of a grid's axis."""
    low, high = axis[max(k - 1, 0)], axis[min(k + 1, len(axis) - 1)]
    return np.linspace((low + axis[k]) / 2.0, (high + axis[k]) / 2.0, 5)


def _shift_bands(contrast: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Shift bands of lines aside, each by its own, so that nothing runs down the picture."""
    edges = np.linspace(0, CELLS, BANDS + 1).astype(int)
    bands = [contrast[a:b] for a, b in itertools.pairwise(edges)]
    return np.concatenate([np.roll(band, int(rng.integers(CELLS)), axis=1) for band in bands])
