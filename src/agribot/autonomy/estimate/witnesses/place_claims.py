"""Independent claims of where the robot is, held against each other.

Each pair is compared by its squared normalised distance. Of three or more claims the odd one is
found by exclusion: the others agree with each other, and together contradict it.
Source: fault detection and exclusion by comparing solutions without one source each; Brown 1992,
"A baseline GPS RAIM scheme and a note on the equivalence of three RAIM methods", Navigation 39(3).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from agribot.core.facts import PlaceSource, StartAside
from agribot.core.messages import FloatArray

# Largest distance of two claims, in joint sigmas.
AGREE_SIGMA = 4.0
# 1 sigma along the rows of a claim that is about the place across them, m.
UNKNOWN_M = 1e3
# Pairs that contradict each other without a third claim. Fixes and rows in view are compared by the
# agreement of the rows; a robot may have been moved to its mark since it was left.
PAIRS: frozenset[tuple[PlaceSource, PlaceSource]] = frozenset(
    {("gnss", "mark"), ("gnss", "left"), ("rows", "mark")}
)
DIRECTIONS = (
    "east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east",
)  # fmt: skip


class PlaceClaim(NamedTuple):
    """A place in the map, East + i North, with its covariance.

    `right` is the direction across the rows, of unit length, where only that part is known.
    """

    sources: tuple[PlaceSource, ...]
    place_m: complex
    cov_m2: FloatArray
    right: complex | None = None


def claim_place(source: PlaceSource, place_m: complex, std_m: float) -> PlaceClaim:
    """Make the claim of a place that is known equally well in every direction."""
    return PlaceClaim((source,), place_m, std_m**2 * np.eye(2))


def claim_across(source: PlaceSource, place_m: complex, std_m: float, right: complex) -> PlaceClaim:
    """Make the claim of a place across the rows."""
    across = np.array([right.real, right.imag])
    along = np.array([-right.imag, right.real])
    cov_m2 = std_m**2 * np.outer(across, across) + UNKNOWN_M**2 * np.outer(along, along)
    return PlaceClaim((source,), place_m, cov_m2, right)


def find_disagreement(claims: Sequence[PlaceClaim]) -> StartAside | None:
    """Find the claim that the others contradict, or else two that contradict each other.

    A robot that was left elsewhere than all others have it was moved.
    """
    odd = [(one, joined) for one in claims if (joined := _find_accuser(one, claims)) is not None]
    if len(odd) == 1:
        one, joined = odd[0]
        return None if one.sources == ("left",) else _accuse(one, joined)
    pairs = [(a, b) for a in claims for b in claims if (*a.sources, *b.sources) in PAIRS]
    worst = max(pairs, key=lambda pair: _distance2(*pair), default=None)
    return None if worst is None or _agree(*worst) else _accuse(*worst)


def _find_accuser(one: PlaceClaim, claims: Sequence[PlaceClaim]) -> PlaceClaim | None:
    """Join the other claims where two or more agree and contradict this one; None elsewhere."""
    others = [other for other in claims if other is not one]
    if len(others) < 2 or not all(_agree(*pair) for pair in combinations(others, 2)):
        return None
    joined = _join(others)
    return None if _agree(one, joined) else joined


def _join(claims: Sequence[PlaceClaim]) -> PlaceClaim:
    """Take the mean of claims, weighted by what each knows."""
    weights = [np.linalg.inv(claim.cov_m2) for claim in claims]
    cov_m2 = np.linalg.inv(sum(weights))
    sums = sum(weight @ _pair(claim.place_m) for weight, claim in zip(weights, claims, strict=True))
    sources = tuple(source for claim in claims for source in claim.sources)
    return PlaceClaim(sources, complex(*(cov_m2 @ sums)), cov_m2)


def _agree(one: PlaceClaim, other: PlaceClaim) -> bool:
    return _distance2(one, other) <= AGREE_SIGMA**2


def _distance2(one: PlaceClaim, other: PlaceClaim) -> float:
    off_m = _pair(one.place_m - other.place_m)
    return float(off_m @ np.linalg.solve(one.cov_m2 + other.cov_m2, off_m))


def _accuse(one: PlaceClaim, other: PlaceClaim) -> StartAside:
    """Make the fact of how far one claim is from another, where both know it."""
    off_m = one.place_m - other.place_m
    for right in (one.right, other.right):
        if right is not None:
            off_m = (off_m * right.conjugate()).real * right
    towards = _pair(off_m) / abs(off_m)
    limit_m = AGREE_SIGMA * math.sqrt(towards @ (one.cov_m2 + other.cov_m2) @ towards)
    return StartAside(
        abs(off_m), _name_direction(off_m), limit_m, accuser=one.sources[0], against=other.sources
    )


def _name_direction(off_m: complex) -> str:
    """Name the nearest of eight directions; north is the imaginary axis."""
    return DIRECTIONS[round(cmath.phase(off_m) / (math.pi / 4.0)) % 8]


def _pair(vector_m: complex) -> FloatArray:
    return np.array([vector_m.real, vector_m.imag])
