"""The row of a comb that the robot follows: the nearest to its way that bears plants.

Rows are not drilled equally far apart, and beside a field no row stands: the comb says where
to look, the row's own plants say where it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from agribot.autonomy.perceive.far_view import HARMONICS, HEIGHTS, PLANTS, Comb, FarView
from agribot.core.messages import FloatArray

LEAST_BORNE_RATIO = 0.25  # least contrast over that of the best row; less is no row
MOST_TURNS = 1.5  # farthest row from the robot's way, in spacings
# Errors of a row's place between its neighbours that are tried, and their 1 sigma, in spacings.
ERRORS, ERROR_STD = np.linspace(-0.25, 0.25, 21), 0.05


class OwnRow(NamedTuple):
    """A row whose line in the comb passes `left_m` left of the body's origin.

    Its plants stand `aside_m` farther left.
    """

    left_m: float
    aside_m: float


def find_own_row(contrast: FloatArray, view: FarView, comb: Comb, ahead_m: float) -> OwnRow:
    """Find the row of a comb in a contrast (CELLS, CELLS) that is nearest to the way at `ahead_m`.

    Where no near one bears plants, it is the nearest line.
    """
    places, sums = view.sum_by_row(contrast, comb)
    turns = np.round(places)
    shares = sums * _measure_teeth(places)
    left_m = -np.sin(comb.yaw_rad) * ahead_m - comb.bend_per_m * ahead_m**2 / 2.0
    turn = _find_turn(turns, shares, float(left_m - comb.left_m) / comb.spacing_m)
    is_own = turns == turn
    tried = _measure_teeth((places[is_own] - turn)[:, None] - ERRORS)
    score = (float(shares[~is_own].sum()) + sums[is_own] @ tried).clip(0.0)
    weighed = 0.5 * PLANTS * score**2 - 0.5 * (ERRORS / ERROR_STD) ** 2
    likely = np.exp(weighed - weighed.max())
    error = float(likely @ ERRORS) / float(likely.sum())
    return OwnRow(comb.left_m + turn * comb.spacing_m, error * comb.spacing_m)


def _measure_teeth(places: FloatArray) -> FloatArray:
    """Measure how high the teeth of a comb are at places (...) in spacings from a line."""
    teeth: FloatArray = np.cos(2.0 * np.pi * places[..., None] * HARMONICS) @ HEIGHTS
    return teeth


def _find_turn(turns: FloatArray, shares: FloatArray, way: float) -> float:
    """Find which row, counted from the comb's line, is nearest to the way and bears plants."""
    first = turns.min()
    borne = np.bincount((turns - first).astype(np.intp), shares)
    rows = first + np.arange(len(borne))
    bears = (borne >= LEAST_BORNE_RATIO * borne.max()) & (np.abs(rows - way) <= MOST_TURNS)
    near = rows[bears] if bears.any() else rows
    return float(near[np.abs(near - way).argmin()])
