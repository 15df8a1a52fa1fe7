"""Where the boxes of a graph go: in columns from left to right, with few crossings."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TypeVar

K = TypeVar("K", bound=Hashable)
Edge = tuple[K, K]

_SWEEPS = 8


def find_columns(items: Sequence[K], edges: Iterable[Edge[K]]) -> dict[K, int]:
    """Give each item a column behind all from which an edge leads to it; circles are cut."""
    followers: dict[K, list[K]] = {item: [] for item in items}
    for source, target in edges:
        followers[source].append(target)
    forward = _cut_circles(items, followers)
    columns = dict.fromkeys(items, 0)
    for item in _sort_forward(items, forward):
        for follower in forward[item]:
            columns[follower] = max(columns[follower], columns[item] + 1)
    return columns


def _cut_circles(items: Sequence[K], followers: Mapping[K, list[K]]) -> dict[K, list[K]]:
    """Leave out the edges that lead back to where a walk came from."""
    forward: dict[K, list[K]] = {item: [] for item in items}
    done: set[K] = set()
    for root in items:
        if root in done:
            continue
        way, on_way = [(root, iter(followers[root]))], {root}
        while way:
            item, rest = way[-1]
            follower = next(rest, None)
            if follower is None:
                way.pop()
                on_way.discard(item)
                done.add(item)
            elif follower not in on_way:
                forward[item].append(follower)
                if follower not in done:
                    way.append((follower, iter(followers[follower])))
                    on_way.add(follower)
    return forward


def _sort_forward(items: Sequence[K], forward: Mapping[K, list[K]]) -> list[K]:
    waiting = dict.fromkeys(items, 0)
    for followers in forward.values():
        for follower in followers:
            waiting[follower] += 1
    ready = [item for item in items if not waiting[item]]
    order: list[K] = []
    while ready:
        item = ready.pop(0)
        order.append(item)
        for follower in forward[item]:
            waiting[follower] -= 1
            if not waiting[follower]:
                ready.append(follower)
    return order


def order_columns(columns: Mapping[K, int], edges: Iterable[Edge[K]]) -> list[list[K]]:
    """Sort each column so that neighbours lie near each other (barycentres, back and forth)."""
    rows: list[list[K]] = [[] for _ in range(max(columns.values(), default=-1) + 1)]
    for item, column in columns.items():
        rows[column].append(item)
    near: dict[K, list[K]] = {item: [] for item in columns}
    for source, target in edges:
        near[source].append(target)
        near[target].append(source)
    for sweep in range(_SWEEPS):
        order = range(len(rows)) if sweep % 2 == 0 else range(len(rows) - 1, -1, -1)
        for column in order:
            _sort_column(rows, column, near)
    return rows


def _sort_column(rows: list[list[K]], column: int, near: Mapping[K, list[K]]) -> None:
    places = {item: (i + 0.5) / len(row) for row in rows for i, item in enumerate(row) if row}

    def weigh(item: K) -> float:
        found = [places[other] for other in near[item]]
        return sum(found) / len(found) if found else places[item]

    rows[column].sort(key=weigh)
