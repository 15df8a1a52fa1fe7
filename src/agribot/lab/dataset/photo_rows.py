"""The row as teacher, for photographs from straight above: by a row and a network, without a mask.

A network that has never seen a field calls some of its weeds crops. Where one row of crop runs
through a photograph, what grows beside it is weed, whatever the network says; on it, the network's
word counts where it is sure. What stands at the edge of the row teaches nothing. The labels are for
learning, never for judging.
Source: Lottes and Stachniss 2017 (IROS), where the row teaches; Lee 2013 (ICML workshops), where a
network's sure answers do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.lab.dataset.classes import UNLABELLED

RowDirection = Literal["down", "across"]
Numbers = TypeVar("Numbers", bound=np.generic)
Indices = npt.NDArray[np.intp]
DIRECTIONS: tuple[RowDirection, ...] = ("down", "across")

# Largest angles of the rows of a set to its direction, and of each row to the others.
SET_TURNS_RAD = np.radians(np.linspace(-15.0, 15.0, 13))
ROW_TURNS_RAD = np.radians(np.linspace(-5.0, 5.0, 5))
# BINS across the row; BANDS are the widths, in bins, of rows of seedlings up to large plants. A set
# takes the narrowest band with at least ENOUGH_ROWS of the rows that the best band finds.
BINS, BANDS, ENOUGH_ROWS = 160, (11, 23, 47), 0.6
# A row holds at least this share of all detected crop, and this multiple of what evenly spread
# crop would leave in its band; beyond APART_BINS no band holds MOST_IN_SECOND of its crop.
LEAST_IN_ROW, LEAST_GATHERED, MOST_IN_SECOND, APART_BINS = 0.4, 2.0, 0.5, 33
HALF_ROW_RATIO = (0.02, 0.2)
EDGE_RATIO = 0.25  # the row ends where the profile across it falls to this part of its height
REACH_RATIO = 1.6  # reach of the row's leaves from its line, in half widths
SURE = round(0.6 * 255)  # least confidence of the network


class PhotoRow(NamedTuple):
    """The line of a row that runs down a picture.

    `across_ratio` is the share of the picture's width to the left of it, at half of its height;
    `turn_rad` how far it leans, positive to the right on its way down.
    """

    across_ratio: float
    turn_rad: float


class RowSearch(NamedTuple):
    """The line along which most crop stands, which share of all crop, and whether it is a row."""

    row: PhotoRow
    share: float
    is_row: bool


def turn(pixels: npt.NDArray[Numbers], direction: RowDirection) -> npt.NDArray[Numbers]:
    """Turn a map (H, W) of a set whose rows run in a direction so that they run down, and back."""
    return pixels if direction == "down" else pixels.T


def score_crop(classes: ClassMap) -> FloatArray:
    """Score how likely each pixel (H, W) is crop, 0 to 1; a doubtful weed may be one."""
    sure = classes.confidence / 255.0
    is_crop, is_weed = (classes.class_id == kind for kind in (PlantClass.CROP, PlantClass.WEED))
    return np.where(is_crop, sure, np.where(is_weed, 1.0 - sure, 0.0))


def search_row(
    score: FloatArray, band: int = BANDS[0], turns_rad: FloatArray = SET_TURNS_RAD
) -> RowSearch:
    """Search the row, `band` BINS wide, that runs down a picture by its scores (H, W) for crop.

    It is one if it gathers enough of the crop, and no second one beside it nearly as much.
    """
    total = float(score.sum())
    best, in_band = RowSearch(PhotoRow(0.5, 0.0), 0.0, is_row=False), np.zeros(BINS)
    for turn_rad in turns_rad.tolist():
        sums = _sum_across(score, PhotoRow(0.0, turn_rad))
        around = np.convolve(sums, np.ones(band), mode="same") / max(total, 1.0)
        peak = int(around.argmax())
        if around[peak] > best.share:
            row = PhotoRow((peak + 0.5) / BINS, turn_rad)
            best, in_band = RowSearch(row, float(around[peak]), is_row=False), around
    is_away = np.abs(np.arange(BINS) + 0.5 - best.row.across_ratio * BINS) > max(APART_BINS, band)
    is_single = not (in_band[is_away] >= MOST_IN_SECOND * best.share).any()
    is_gathered = best.share >= max(LEAST_IN_ROW, LEAST_GATHERED * band / BINS)
    return best._replace(is_row=is_gathered and is_single)


def choose_band(rows: Mapping[int, int]) -> int:
    """Choose the band of a set by how many of its pictures show a row in each: a narrow one."""
    least = ENOUGH_ROWS * max(rows.values())
    return min(band for band, count in rows.items() if count >= least)


class PhotoRowProfile:
    """Crop across the rows of many pictures: `add` each, then ask for `half_ratio`."""

    def __init__(self) -> None:
        self._sums = np.zeros(BINS)

    def add(self, score: FloatArray, row: PhotoRow) -> None:
        self._sums += _sum_across(score, row, both_sides=True)

    def find_half_ratio(self) -> float:
        """Find how far from its line the plants of the row stand, as a share of the picture.

        Raises: ConfigError: no crop at all.
        """
        covered = ndimage.uniform_filter1d(self._sums, 3)
        if not covered.any():
            raise ConfigError(
                "the network finds no crop in these pictures; choose another with --model"
            )
        between = float(np.median(covered[BINS // 4 : BINS // 2]))
        edge = between + EDGE_RATIO * (float(covered.max()) - between)
        is_beyond = (covered <= edge) & (np.arange(BINS) > covered.argmax())
        half = float(is_beyond.argmax()) / BINS
        return min(max(half, HALF_ROW_RATIO[0]), HALF_ROW_RATIO[1])


def label_by_row(
    kind: ByteArray, confidence: ByteArray, row: PhotoRow, half_ratio: float
) -> ByteArray:
    """Label the pixels (H, W) of a picture whose row runs down: a PlantClass, or UNLABELLED.

    `kind` and `confidence` (H, W) are what a network says, as of `ClassMap`.
    """
    is_sure = confidence >= SURE
    rows, columns = np.arange(kind.shape[0])[:, None], np.arange(kind.shape[1])[None, :]
    off = np.abs(_find_across(rows, columns, kind.shape, row))
    is_plant = kind != PlantClass.SOIL
    label = np.full(kind.shape, UNLABELLED, dtype=np.uint8)
    label[is_sure & ~is_plant] = PlantClass.SOIL
    on_row, beside = off <= half_ratio, off > REACH_RATIO * half_ratio
    label[is_plant & beside] = PlantClass.WEED
    label[is_sure & (kind == PlantClass.WEED)] = PlantClass.WEED
    label[is_sure & on_row & (kind == PlantClass.CROP)] = PlantClass.CROP
    return label


def _find_across(
    rows: Indices, columns: Indices, shape: tuple[int, ...], row: PhotoRow
) -> FloatArray:
    """Find how far right of a row's line pixels of a picture lie, as shares of its width."""
    down = rows - (shape[0] - 1) / 2.0
    across: FloatArray = (columns + 0.5 - math.tan(row.turn_rad) * down) / shape[1]
    return across - row.across_ratio


def _sum_across(score: FloatArray, row: PhotoRow, *, both_sides: bool = False) -> FloatArray:
    """Sum scores (H, W) in BINS from 0 to 1 to the right of a line, or to both of its sides."""
    rows, columns = np.nonzero(score)
    across = _find_across(rows, columns, score.shape, row)
    across = np.abs(across) if both_sides else across
    is_inside = (across >= 0.0) & (across < 1.0)
    bins = (across[is_inside] * BINS).astype(np.int64)
    sums: FloatArray = np.bincount(bins, score[rows, columns][is_inside], BINS).astype(np.float64)
    return sums
