"""Stems in the maps of a plant network, and the plant that each pixel of vegetation belongs to.

Stems are peaks of a score, after Zhou et al. 2019, Objects as points. Vegetation points the way to
its own stem, after Neven et al. 2019, Instance segmentation by jointly optimizing spatial
embeddings: plants whose leaves touch come apart. Places are pixels of the class map, u right and v
down from the centre of the top left pixel. Ways are given by cells of 4 px, scores by squares of 2
px; the cell in row r and column c has its centre at u = 4 c + 1.5, v = 4 r + 1.5.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.messages import ByteArray, FloatArray

CELL_PX, SQUARE_PX = 4, 2
# Two stems nearer than this are one plant found twice.
LEAST_GAP_PX = 8.0
# Radius around the stem that a cell points to; a stem farther off is another one.
OWN_STEM_PX = 3.0
# Largest distance from a stem to where its vegetation points: ways err in proportion to themselves.
REACH_PX = 10.0
REACH_RATIO = 0.3

Mask = npt.NDArray[np.bool_]
Owners = npt.NDArray[np.int32]
Indices = npt.NDArray[np.int64]
Value = TypeVar("Value", np.bool_, np.uint8, np.float32)


class PlantMaps(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A plant network's answer on stems, of a class map of (h, w) pixels.

    `stem_score` (2, h/2, w/2), 255 = certain, says how surely a stem stands in each square of
    `SQUARE_PX` pixels: first of a weed, then of a crop plant, in the order of `PlantClass`.
    `way_px` (2, h/4, w/4) is the way, right and down, from the centre of a cell of `CELL_PX` pixels
    of vegetation to the stem of its plant, which may be outside the picture.
    """

    stem_score: ByteArray
    way_px: npt.NDArray[np.float32]


class Stems(NamedTuple):
    """Stems of one picture, the surest first.

    `uv_px` (N, 2) are their places, `kind_scores` (N, 2) the scores as weed and as crop plant, 0
    to 1, and `squares` (N, 2) the rows and columns of their squares.
    """

    uv_px: FloatArray
    kind_scores: FloatArray
    squares: Indices


def find_stems(maps: PlantMaps, least_score: float) -> Stems:
    """Find the stems that score at least `least_score`, 0 to 1, as a weed or as a crop plant.

    The way at a stem's own cell gives its place, where that is about the square.
    """
    score = maps.stem_score.max(axis=0)
    rows, columns = np.nonzero(_find_peaks(score) & (score >= max(1.0, 255.0 * least_score)))
    surest_first = np.argsort(-score[rows, columns].astype(np.int64), kind="stable")
    squares = np.column_stack([rows, columns])[surest_first]
    uv_px = _place(squares, maps)
    kept = _find_apart(uv_px)
    rows, columns = squares.T
    kind_scores = maps.stem_score[:, rows, columns].T.astype(np.float64) / 255.0
    return Stems(uv_px[kept], kind_scores[kept], squares[kept])


def share_kinds(kind_scores: FloatArray) -> FloatArray:
    """Return how likely stems (..., 2) that are there are of weeds and of crops; sums of 1."""
    shares: FloatArray = kind_scores / kind_scores.sum(axis=-1, keepdims=True)
    return shares


def find_owners(maps: PlantMaps, stems: Stems, is_plant: Mask) -> Owners:
    """Find for each pixel (h, w) of vegetation the index of its stem, -1 without one.

    Vegetation without an owner is of an unknown plant: one whose stem is outside the picture, or
    too unlikely a stem. Pixels outside `is_plant` have no owner either.
    """
    height, width = is_plant.shape
    blocks = np.empty((height // CELL_PX, CELL_PX, width // CELL_PX, CELL_PX), dtype=np.int32)
    blocks[...] = find_cell_owners(maps, stems, sum_cells(is_plant))[:, None, :, None]
    owners = blocks.reshape(height, width)
    owners[~is_plant] = -1
    return owners


def find_cell_owners(maps: PlantMaps, stems: Stems, holds_plant: Mask) -> Owners:
    """As `find_owners`, of the cells (h/4, w/4) that hold vegetation."""
    owners = np.full(holds_plant.shape, -1, dtype=np.int32)
    cells = np.argwhere(holds_plant)
    if not len(stems.uv_px) or not len(cells):
        return owners
    way_px = maps.way_px[:, holds_plant].T.astype(np.float64)
    votes_px = find_centres(cells) + way_px
    nearest = _find_nearest(votes_px, stems.uv_px)
    gap_px = np.hypot(*(votes_px - stems.uv_px[nearest]).T)
    is_owned = gap_px <= REACH_PX + REACH_RATIO * np.hypot(*way_px.T)
    owners[holds_plant] = np.where(is_owned, nearest, -1)
    return owners


def sum_cells(values: npt.NDArray[Value]) -> npt.NDArray[Value]:
    """Sum up values of pixels (h, w) to those of cells (h/4, w/4); a mask: whether any is true."""
    rows = values[::CELL_PX].copy()
    for shift in range(1, CELL_PX):
        rows += values[shift::CELL_PX]
    cells = rows[:, ::CELL_PX].copy()
    for shift in range(1, CELL_PX):
        cells += rows[:, shift::CELL_PX]
    return cells


def pool_squares(scores: ByteArray) -> ByteArray:
    """Return the highest score of the squares (h/2, w/2) of each cell, (h/4, w/4)."""
    rows = np.maximum(scores[::2], scores[1::2])
    return np.maximum(rows[:, ::2], rows[:, 1::2])


def find_centres(cells: Indices, size_px: int = CELL_PX) -> FloatArray:
    """Return the centres (N, 2), u and v in pixels, of cells (N, 2), rows and columns."""
    return cells[:, ::-1].astype(np.float64) * size_px + (size_px - 1) / 2.0


def _place(squares: Indices, maps: PlantMaps) -> FloatArray:
    """Return the places (N, 2) of stems in squares (N, 2)."""
    centres_px = find_centres(squares, SQUARE_PX)
    cells = squares * SQUARE_PX // CELL_PX
    pointed_px = find_centres(cells) + maps.way_px[:, cells[:, 0], cells[:, 1]].T
    is_near = np.hypot(*(pointed_px - centres_px).T) <= OWN_STEM_PX
    return np.where(is_near[:, None], pointed_px, centres_px)


def _find_peaks(score: ByteArray) -> Mask:
    """Find the cells (H, W) that no neighbour exceeds; of equal neighbours the first one."""
    height, width = score.shape
    padded = np.zeros((height + 2, width + 2), dtype=score.dtype)
    padded[1:-1, 1:-1] = score
    is_peak = np.ones(score.shape, dtype=bool)
    for row, column in np.ndindex(3, 3):
        neighbour = padded[row : row + height, column : column + width]
        if (row, column) < (1, 1):
            is_peak &= score > neighbour
        elif (row, column) > (1, 1):
            is_peak &= score >= neighbour
    return is_peak


def _find_apart(uv_px: FloatArray) -> Indices:
    """Choose from places (N, 2), the best first, those with no better one within the least gap."""
    by_v = np.argsort(uv_px[:, 1], kind="stable")
    v_px = uv_px[by_v, 1]
    counts = np.searchsorted(v_px, v_px + LEAST_GAP_PX) - np.arange(len(v_px)) - 1
    upper = np.repeat(np.arange(len(v_px)), counts)
    lower = upper + 1 + np.arange(len(upper)) - np.repeat(np.cumsum(counts) - counts, counts)
    pairs = np.sort(np.column_stack([by_v[upper], by_v[lower]]), axis=1)
    gap_px = np.hypot(*(uv_px[pairs[:, 0]] - uv_px[pairs[:, 1]]).T)
    pairs = pairs[gap_px < LEAST_GAP_PX]
    is_kept = [True] * len(uv_px)
    for better, worse in pairs[np.argsort(pairs[:, 0], kind="stable")].tolist():
        if is_kept[better]:
            is_kept[worse] = False
    return np.flatnonzero(is_kept)


def _find_nearest(votes_px: FloatArray, stems_px: FloatArray) -> Indices:
    """Find the stem (M, 2) that is nearest to each vote (N, 2): its index, (N,).

    The squared distance is |vote|^2 - 2 vote . stem + |stem|^2, and its first part is the same
    for all stems.
    """
    middle_px = stems_px.mean(axis=0)
    stems = (stems_px - middle_px).astype(np.float32)
    votes = (votes_px - middle_px).astype(np.float32)
    closeness = votes @ stems.T
    closeness -= 0.5 * (stems**2).sum(axis=1)
    nearest: Indices = closeness.argmax(axis=1)
    return nearest
