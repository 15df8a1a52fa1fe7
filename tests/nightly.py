"""What `make nightly` runs and `make test` does not: the same tests with other counts, and tests
whose behaviour a cheaper one proves by day.

A statistic over few seeds finds a gross fault, the one over all of them a small one; so a band
is computed for its count (`mean_square_band`), never widened by hand.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import pytest
from scipy.special import chdtri


def all_or_first(
    name: str, values: Iterable[Any], in_suite: int, unit: str = "seeds"
) -> pytest.MarkDecorator:
    """Parametrise a test over a collection: the first `in_suite` values, and nightly all."""
    every = tuple(values)
    return pytest.mark.parametrize(
        name,
        [
            pytest.param(every[:in_suite], id=f"{in_suite} {unit}"),
            pytest.param(every, id=f"{len(every)} {unit}", marks=pytest.mark.nightly),
        ],
    )


def one_by_one(name: str, values: Sequence[Any], in_suite: int) -> pytest.MarkDecorator:
    """Parametrise a test over single values; those beyond `in_suite` are nightly."""
    return pytest.mark.parametrize(
        name,
        [
            *values[:in_suite],
            *(pytest.param(v, marks=pytest.mark.nightly) for v in values[in_suite:]),
        ],
    )


def by_day(*tests: str) -> pytest.MarkDecorator:
    """Leave a test to the night, because `tests` prove its behaviour by day in a cheaper form.

    Each of them is a name of the same file, or `tests/folder/test_file.py::test_name`;
    tests/test_own_rules.py proves that it exists and runs by day.
    """
    return pytest.mark.nightly(by_day=tests)


def mean_square_band(count: int, freedom: int = 1, share: float = 0.95) -> tuple[float, float]:
    """Where the mean of `count` normalised squared errors lies with the probability `share`.

    Each error has `freedom` dimensions, so that the ideal is `freedom`: chi2(count * freedom).
    """
    beyond = (1.0 + share) / 2.0, (1.0 - share) / 2.0  # probabilities of a larger sum
    low, high = chdtri(count * freedom, beyond)
    return float(low) / count, float(high) / count
