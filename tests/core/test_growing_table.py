"""A table that grows with every tick."""

from __future__ import annotations

import sys

import msgspec
import numpy as np
import pytest

from agribot.core.growing_table import GrowingTable
from agribot.core.histogram import Histogram


def test_what_was_appended_comes_out_row_by_row() -> None:
    table = GrowingTable(3)
    assert table.to_array().shape == (0, 3)
    rows = [(1.0, 2.0, 3.0), (4.0, float("nan"), -6.0)]
    for row in rows:
        table.append(row)
    assert len(table) == 2
    assert np.array_equal(table.to_array(), rows, equal_nan=True)


def test_a_row_of_another_length_is_refused_and_leaves_the_table_as_it_was() -> None:
    table = GrowingTable(2)
    table.append((1.0, 2.0))
    for row in ((), (1.0,), (1.0, 2.0, 3.0)):
        with pytest.raises(ValueError, match="2 columns"):
            table.append(row)
    assert np.array_equal(table.to_array(), [(1.0, 2.0)])


def test_an_array_that_was_given_out_does_not_change_with_the_table() -> None:
    table = GrowingTable(1)
    table.append((1.0,))
    given = table.to_array()
    table.append((2.0,))
    assert given.tolist() == [[1.0]]
    assert table.to_array().tolist() == [[1.0], [2.0]]


def test_an_hour_of_ticks_takes_little_more_than_its_bytes() -> None:
    table, ticks = GrowingTable(9), 3600 * 50
    for tick in range(ticks):
        table.append(float(tick) for _ in range(9))
    assert sys.getsizeof(table._values) < 1.2 * 8 * 9 * ticks


def test_a_histogram_tells_percentiles_to_half_its_width_and_goes_on_after_a_round_trip() -> None:
    values = np.random.default_rng(3).gamma(2.0, 0.01, 4000)
    counts = Histogram(width=0.0005)
    counts.add(values[:1500])
    again = msgspec.json.decode(msgspec.json.encode(counts), type=Histogram)
    again.add(values[1500:])
    for percent in (5.0, 50.0, 95.0):
        exact = float(np.percentile(values, percent))
        assert again.percentile(percent) == pytest.approx(exact, abs=0.0006)
    assert Histogram(width=1.0).percentile(95.0) is None
