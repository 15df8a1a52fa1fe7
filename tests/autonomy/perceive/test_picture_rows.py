"""Rows are found in pictures of one camera by their vanishing point, spacing and foot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.perceive.picture_rows import PictureRows, find_rows, measure_contrast
from agribot.core.messages import FloatArray
from tests.autonomy.perceive.drawn_rows import draw_cover, make_rows

DOWN, SPACING, PICTURES = -0.08, 0.55, 6


Found = tuple[list[PictureRows], list[PictureRows], FloatArray]


def draw_set(rng: np.random.Generator) -> list[PictureRows]:
    """Draw the rows of pictures of one camera that weaves along them."""
    return [
        make_rows(rng.uniform(0.35, 0.65), DOWN, rng.uniform(0.3, 0.7), SPACING)
        for _ in range(PICTURES)
    ]


def find_lean_deg(rows: PictureRows, foot: float) -> float:
    return math.degrees(math.atan((foot - rows.across_ratio) / (1.0 - rows.down_ratio)))


@pytest.fixture(scope="module")
def found() -> Found:
    rng = np.random.default_rng(3)
    true = draw_set(rng)
    contrasts = [measure_contrast(draw_cover(rows, rng)) for rows in true]
    return true, *find_rows(contrasts, rng)


def test_lines_of_rows_are_found_where_they_cross_the_lower_edge(found: Found) -> None:
    for true, seen in zip(*found[:2], strict=True):
        off = seen.find_feet() - true.foot_ratio
        assert np.abs(off).min() < 0.06 * SPACING


def test_vanishing_point_and_spacing_are_those_of_the_drawing(found: Found) -> None:
    for true, seen in zip(*found[:2], strict=True):
        assert seen.down_ratio == pytest.approx(DOWN, abs=0.05)
        assert seen.across_ratio == pytest.approx(true.across_ratio, abs=0.05)
        assert seen.spacing_ratio == pytest.approx(SPACING, rel=0.06)


def test_lines_lean_as_the_rows_do_within_three_degrees(found: Found) -> None:
    for true, seen in zip(*found[:2], strict=True):
        foot = seen.find_feet()[np.abs(seen.find_feet() - true.foot_ratio).argmin()]
        lean_deg = find_lean_deg(true, true.foot_ratio)
        assert find_lean_deg(seen, float(foot)) == pytest.approx(lean_deg, abs=3.0)


def test_pictures_of_rows_have_more_evidence_than_they_would_without_rows(found: Found) -> None:
    _, rows, without = found
    assert min(one.evidence for one in rows) > without.max()


def test_lines_of_rows_are_surer_than_those_of_weeds(found: Found) -> None:
    assert min(one.sure for one in found[1]) > 0.9


def test_weeds_without_rows_have_no_more_evidence_than_by_chance() -> None:
    rng = np.random.default_rng(4)
    contrasts = [measure_contrast(draw_cover(None, rng, weeds=150)) for _ in range(PICTURES)]
    rows, without = find_rows(contrasts, rng)
    assert np.median([one.sure for one in rows]) < 0.6
    is_seen = np.array([one.evidence for one in rows]) > np.quantile(without, 0.9)
    assert is_seen.mean() < 0.5


def test_a_few_large_plants_from_close_above_have_no_more_evidence_than_by_chance() -> None:
    rng = np.random.default_rng(5)
    v, u = np.mgrid[0:96, 0:128] / 128.0
    covers = [np.zeros((96, 128)) for _ in range(2 * PICTURES)]
    for cover in covers:
        for down, across in rng.uniform(0.0, (0.75, 1.0), (4, 2)):
            cover[np.hypot(v - down, u - across) < 0.12] = 1.0
    rows, without = find_rows([measure_contrast(cover) for cover in covers], rng)
    is_seen = np.array([one.evidence for one in rows]) > np.quantile(without, 0.9)
    assert is_seen.mean() < 0.5


def test_pixels_on_a_line_are_off_by_nothing_and_midway_by_half_a_spacing() -> None:
    off = make_rows(0.5, 0.0, 0.5, 0.5).measure_off(100, 200)
    assert off[99, 100] == pytest.approx(0.0, abs=0.01)
    assert off[99, 150] == pytest.approx(0.5, abs=0.01)
    assert np.isnan(off[5]).all()


def test_the_same_generator_finds_the_same_rows() -> None:
    cover = draw_cover(make_rows(0.5, DOWN, 0.5, SPACING), np.random.default_rng(1))
    contrasts = [measure_contrast(cover)]
    first, second = (find_rows(contrasts, np.random.default_rng(2)) for _ in range(2))
    assert first[0] == second[0]
    assert (first[1] == second[1]).all()
