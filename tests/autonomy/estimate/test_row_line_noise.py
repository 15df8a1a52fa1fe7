"""How much row lines scatter is learnt from the lines themselves, whatever they state."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from agribot.autonomy.estimate.sensors.row_line_noise import RowLineNoise
from agribot.core.facts import RowHeadingsScatter, RowLinesScatter
from agribot.core.messages import RowLine

STATED_M, STATED_RAD, STEP_S = 0.015, math.radians(0.7), 0.07
Aside = Callable[[float], float]


def line(t_s: float, std_m: float = STATED_M) -> RowLine:
    return RowLine(
        t_s=t_s, offset_m=0.0, heading_rad=0.0, offset_std_m=std_m, heading_std_rad=STATED_RAD
    )


def look(
    off_times: float = 1.0,
    turned_times: float = 1.0,
    aside_m: Aside = lambda t_s: 0.0,
    step_s: float = STEP_S,
    outlier_ratio: float = 0.0,
    seed: int = 0,
) -> RowLineNoise:
    """Eight seconds of lines with `off_times` and `turned_times` the noise they state."""
    rng, noise = np.random.default_rng(seed), RowLineNoise()
    for t_s in np.arange(0.0, 8.0, step_s).tolist():
        off_m = aside_m(t_s) + rng.normal(0.0, off_times * STATED_M)
        turned_rad = rng.normal(0.0, turned_times * STATED_RAD)
        if rng.random() < outlier_ratio:
            off_m, turned_rad = off_m + rng.normal(0.0, 0.3), turned_rad + rng.normal(0.0, 0.14)
        noise.add(line(t_s), float(off_m), float(turned_rad))
    return noise


@pytest.mark.parametrize("times", [2.7, 6.0])
def test_noise_beyond_what_is_stated_is_learnt_for_offset_and_heading(times: float) -> None:
    believed = look(times, times).widen(line(9.0))
    assert believed.offset_std_m == pytest.approx(times * STATED_M, rel=0.3)
    assert believed.heading_std_rad == pytest.approx(times * STATED_RAD, rel=0.3)


def test_the_floor_of_an_offset_counts_as_stated() -> None:
    """Lines that claim half a millimetre are believed to six millimetres anyhow."""
    noise, rng = RowLineNoise(), np.random.default_rng(1)
    for t_s in np.arange(0.0, 8.0, STEP_S).tolist():
        off_m, turned_rad = rng.normal(0.0, (0.006, STATED_RAD)).tolist()
        noise.add(line(t_s, 5e-4), off_m, turned_rad)
    sure = line(9.0, 5e-4)
    assert noise.widen(sure) is sure


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(
    "aside_m",
    [
        lambda t_s: 0.0,
        lambda t_s: 0.3,  # a camera that looks aside,
        lambda t_s: 0.05 * t_s,  # one that slides off,
        lambda t_s: 0.2 if t_s > 4.0 else 0.0,  # and one that is knocked
    ],
)
def test_what_lasts_is_no_noise(aside_m: Aside, seed: int) -> None:
    told = line(9.0)
    assert look(aside_m=aside_m, seed=seed).widen(told) is told


def test_every_tenth_line_that_is_an_outlier_makes_the_others_no_worse() -> None:
    told = line(9.0)
    assert all(look(outlier_ratio=0.1, seed=seed).widen(told) is told for seed in range(20))


def test_lines_that_are_far_apart_in_time_are_no_neighbours() -> None:
    told = line(999.0)
    assert look(10.0, 10.0, step_s=0.6).widen(told) is told


def test_lines_that_scatter_are_named_with_what_they_state() -> None:
    aside = look(4.0).fault
    assert isinstance(aside, RowLinesScatter)
    assert aside.std_m == pytest.approx(0.06, abs=0.005)
    assert aside.stated_m == 0.015
    turned = look(1.0, 4.0).fault
    assert isinstance(turned, RowHeadingsScatter)
    assert math.degrees(turned.std_rad) == pytest.approx(2.8, rel=0.3)
    assert math.degrees(turned.stated_rad) == pytest.approx(0.7)
    assert not look(1.0, 1.0).fault
