"""Sample times, random streams and the compiler's disk cache."""

from __future__ import annotations

import math
from fractions import Fraction

import numba.core.caching
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.core.errors import ConfigError
from agribot.sim.clock import Schedule, round_step_ns
from agribot.sim.jit import compile_exact
from agribot.sim.random_streams import NormalRows, make_stream


@given(
    rate_hz=st.floats(0.1, 190.0).map(lambda r: round(r, 2)),
    step_s=st.sampled_from([0.0005, 0.001, 0.002, 0.003, 0.005]),
)
def test_every_sample_falls_on_the_first_step_at_or_after_its_time(
    rate_hz: float, step_s: float
) -> None:
    step = Fraction(round_step_ns(step_s), 10**9)
    steps = Schedule(rate_hz, round_step_ns(step_s)).pop_due(500)
    for k, at in enumerate(steps, start=1):
        time = Fraction(k) / Fraction(str(rate_hz))
        assert (at - 1) * step < time <= at * step
    assert len(steps) == math.floor(500 * step * Fraction(str(rate_hz)))


def test_thirty_hertz_does_not_drift_on_a_two_millisecond_grid() -> None:
    steps = Schedule(30.0, 2_000_000).pop_due(500 * 3600)
    assert len(steps) == 30 * 3600
    assert steps[-1] == 500 * 3600


def test_due_gives_each_step_once() -> None:
    whole, parts = Schedule(33.3, 2_000_000), Schedule(33.3, 2_000_000)
    pieces = [step for last in range(0, 1001, 7) for step in parts.pop_due(last)]
    assert pieces == whole.pop_due(1001)


def test_rate_above_the_physics_is_refused() -> None:
    with pytest.raises(ConfigError, match="above the 500 Hz"):
        Schedule(501.0, 2_000_000)


def test_streams_differ_by_name_and_by_seed_only() -> None:
    first = make_stream(1, "imu").standard_normal(8)
    assert np.array_equal(first, make_stream(1, "imu").standard_normal(8))
    assert not np.array_equal(first, make_stream(1, "mag").standard_normal(8))
    assert not np.array_equal(first, make_stream(2, "imu").standard_normal(8))


def test_rows_are_the_same_numbers_however_they_are_taken() -> None:
    single, many = NormalRows(make_stream(3, "x"), 5), NormalRows(make_stream(3, "x"), 5)
    one_by_one = np.concatenate([single.take(1).copy() for _ in range(3000)])
    by_seven = np.concatenate([many.take(7).copy() for _ in range(429)])[:3000]
    assert np.array_equal(one_by_one, by_seven)


def test_compiles_where_no_cache_folder_is_writable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.core.caching.CacheImpl, "_locator_classes", [])

    def double(value: float) -> float:
        return 2.0 * value

    with pytest.raises(RuntimeError, match="cannot cache"):
        numba.njit(double, cache=True)
    assert compile_exact(double)(21.0) == 42.0
