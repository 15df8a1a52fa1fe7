"""Covering arrays: few rows in which all pairs of values of two factors occur."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Value = TypeVar("Value")
Row = tuple[Value, ...]
Pair = tuple[int, Value, int, Value]


def cover_pairs(
    factors: Sequence[Sequence[Value]], is_allowed: Callable[[Row[Value]], bool]
) -> tuple[Row[Value], ...]:
    """List rows in which each pair of values that some allowed row has occurs at least once.

    Each pair of the first two factors has one row; its other values are those with the most pairs
    that no row before has, and of these the least used.
    """
    rows = list_all(factors, is_allowed)
    missing = {pair for row in rows for pair in _list_pairs(row)}
    groups: dict[Row[Value], list[Row[Value]]] = defaultdict(list)
    for row in rows:
        groups[row[:2]].append(row)
    uses: Counter[tuple[int, Value]] = Counter()
    chosen: list[Row[Value]] = []

    def rate(row: Row[Value]) -> tuple[int, int]:
        new = sum(pair in missing for pair in _list_pairs(row))
        return new, -sum(uses[place] for place in enumerate(row[2:], 2))

    def take(group: Sequence[Row[Value]]) -> None:
        chosen.append(max(group, key=rate))
        missing.difference_update(_list_pairs(chosen[-1]))
        uses.update(enumerate(chosen[-1]))

    for group in groups.values():
        take(group)
    while missing:
        take(rows)
    return tuple(chosen)


def list_all(
    factors: Sequence[Sequence[Value]], is_allowed: Callable[[Row[Value]], bool]
) -> list[Row[Value]]:
    """List all allowed rows."""
    return [row for row in itertools.product(*factors) if is_allowed(row)]


def _list_pairs(row: Row[Value]) -> Iterator[Pair[Value]]:
    for (i, a), (k, b) in itertools.combinations(enumerate(row), 2):
        yield i, a, k, b
