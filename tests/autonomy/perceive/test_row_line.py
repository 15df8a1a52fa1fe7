"""The row line out of class maps: a drawn row whose offset, heading and ends are known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.row_line import find_row_line
from agribot.core.messages import FloatArray, PlantClass, RowLine
from tests import nightly
from tests.autonomy.perceive.drawn_field import GROUND, MAP_SHAPE, Disc, draw

SPACING_M = 0.25


def row_discs(
    rng: np.random.Generator,
    offset_m: float,
    heading_rad: float,
    *,
    from_m: float = -1.0,
    to_m: float = 4.0,
    gap_ratio: float = 0.1,
    scatter_m: float = 0.02,
    bend_m: float = math.inf,
    least_radius_m: float = 0.06,
    most_radius_m: float = 0.12,
) -> list[Disc]:
    """Crop plants `from_m` to `to_m` ahead along a row that the robot stands left of."""
    discs: list[Disc] = []
    for along_m in np.arange(from_m, to_m + 1e-6, SPACING_M):
        inner = from_m + 1e-6 < along_m < to_m - SPACING_M / 2.0
        if inner and rng.uniform() < gap_ratio:
            continue
        left_m = -offset_m + rng.normal(0.0, scatter_m) + along_m**2 / (2.0 * bend_m)
        at_m = along_m + rng.normal(0.0, 0.01)
        cos, sin = math.cos(-heading_rad), math.sin(-heading_rad)
        radius_m = rng.uniform(least_radius_m, most_radius_m)
        discs.append(
            (cos * at_m - sin * left_m, sin * at_m + cos * left_m, radius_m, PlantClass.CROP)
        )
    return discs


def strays(rng: np.random.Generator, count: int, plant: PlantClass) -> list[Disc]:
    return [
        (rng.uniform(0.4, 2.4), rng.uniform(-0.9, 0.9), rng.uniform(0.01, 0.05), plant)
        for _ in range(count)
    ]


def seen(discs: list[Disc]) -> RowLine | None:
    return find_row_line(draw(*discs), GROUND, 1.0)


def errors(
    line: RowLine, offset_m: float, heading_rad: float, bend_m: float = math.inf
) -> tuple[float, float]:
    """Errors of offset and heading, in sigmas, against the row where the line is stated."""
    assert line.offset_m is not None
    assert line.heading_rad is not None
    ahead_m = line.at_ahead_m
    there_m = offset_m + ahead_m * math.sin(heading_rad) - ahead_m**2 / (2.0 * bend_m)
    there_rad = heading_rad - ahead_m / bend_m
    return (
        (line.offset_m - there_m) / line.offset_std_m,
        (line.heading_rad - there_rad) / line.heading_std_rad,
    )


def many(seeds: Sequence[int], **kind: float) -> FloatArray:
    """Errors in sigmas of lines in fields with gaps, weeds and weeds taken for crop: (N, 2)."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        offset_m, heading_rad = rng.normal(0.0, 0.08), rng.normal(0.0, math.radians(6.0))
        discs = row_discs(rng, offset_m, heading_rad, **kind)
        discs += strays(rng, 6, PlantClass.WEED) + strays(rng, 2, PlantClass.CROP)
        line = seen(discs)
        if line is not None:
            found.append(errors(line, offset_m, heading_rad, kind.get("bend_m", math.inf)))
    return np.array(found)


def grown_over(offset_m: float, rng: np.random.Generator) -> ClassMap:
    """A row whose plants are as wide as two of their distances, with half a metre of soil beside.

    They stand by their height: that is what their leaves look like, and not discs of that size.
    """
    discs = row_discs(rng, offset_m, 0.0, least_radius_m=0.26, most_radius_m=0.29)
    return draw(*discs, height_ratio=0.14)


def test_a_row_that_has_closed_is_found_by_its_edges_and_its_line_lies_where_it_stands() -> None:
    rng = np.random.default_rng(1)
    offsets_m = rng.uniform(-0.1, 0.1, 20)
    lines = [find_row_line(grown_over(offset_m, rng), GROUND, 1.0) for offset_m in offsets_m]
    found = [(line, off_m) for line, off_m in zip(lines, offsets_m, strict=True) if line]
    assert len(found) >= 18
    errors_m = [
        line.offset_m - off_m + line.at_ahead_m * math.tan(line.heading_rad)
        for line, off_m in found
        if line.offset_m is not None and line.heading_rad is not None
    ]
    assert abs(np.mean(errors_m)) < 0.02
    assert np.std(errors_m) < 0.04


@nightly.all_or_first("seeds", range(60), in_suite=15)
@pytest.mark.parametrize("kind", [{}, {"gap_ratio": 0.3}, {"bend_m": 30.0}])
def test_lines_are_as_good_as_they_say_with_gaps_weeds_and_bends(
    kind: dict[str, float], seeds: Sequence[int]
) -> None:
    sigmas = many(seeds, **kind)
    assert len(sigmas) >= 0.75 * len(seeds)
    nees = (sigmas**2).mean(axis=0)
    # Better than stated is allowed.
    assert (nees < nightly.mean_square_band(len(seeds), share=0.998)[1]).all()
    assert (nees > 0.15).all()
    assert (np.abs(sigmas) < 4.0).all()


@pytest.mark.parametrize("heading_deg", [-20.0, 0.0, 20.0])
@pytest.mark.parametrize("offset_m", [-0.2, 0.0, 0.2])
def test_the_line_lies_where_the_row_stands(offset_m: float, heading_deg: float) -> None:
    heading_rad = math.radians(heading_deg)
    # Turned away, the robot stands so that the row crosses the middle of its view.
    offset_m -= 1.1 * math.sin(heading_rad)
    rng = np.random.default_rng(5)
    line = seen(row_discs(rng, offset_m, heading_rad, scatter_m=0.0, gap_ratio=0.0))
    assert line is not None
    assert line.offset_m is not None
    there_m = offset_m + line.at_ahead_m * math.sin(heading_rad)
    assert line.offset_m == pytest.approx(there_m, abs=0.025)
    assert line.heading_rad == pytest.approx(heading_rad, abs=math.radians(2.5))
    assert line.start_ahead_m is None
    assert line.end_ahead_m is None


@pytest.mark.parametrize("at_m", [1.15, 1.3])
def test_the_last_plant_before_bare_ground_is_the_end_of_the_row(at_m: float) -> None:
    rng = np.random.default_rng(2)
    line = seen(row_discs(rng, 0.03, 0.05, to_m=at_m, from_m=at_m - 2.0, gap_ratio=0.0))
    assert line is not None
    assert line.end_ahead_m == pytest.approx(at_m, abs=2.0 * line.range_std_m)
    assert line.start_ahead_m is None


def test_the_first_plant_after_bare_ground_is_the_start_of_the_row() -> None:
    rng = np.random.default_rng(3)
    line = seen(row_discs(rng, 0.0, 0.0, from_m=1.3, gap_ratio=0.0))
    assert line is not None
    assert line.start_ahead_m == pytest.approx(1.3, abs=2.0 * line.range_std_m)
    assert line.end_ahead_m is None


def test_weeds_beyond_the_last_crop_leave_the_end_of_the_row_open() -> None:
    rng = np.random.default_rng(2)
    discs = row_discs(rng, 0.0, 0.0, to_m=1.2, gap_ratio=0.0)
    assert seen([*discs, (1.6, 0.02, 0.06, PlantClass.WEED)]).end_ahead_m is None  # type: ignore[union-attr]


@pytest.mark.parametrize("plant", list(PlantClass))
def test_a_picture_of_nothing_but_one_class_shows_no_row(plant: PlantClass) -> None:
    class_map = ClassMap(
        class_id=np.full(MAP_SHAPE, plant, dtype=np.uint8),
        confidence=np.full(MAP_SHAPE, 255, dtype=np.uint8),
        scale_px=(1.25, 1.25),
    )
    assert find_row_line(class_map, GROUND, 0.0) is None


def test_a_plant_or_two_are_no_row() -> None:
    assert seen([(1.0, 0.0, 0.1, PlantClass.CROP)]) is None
    assert seen([(0.8, 0.0, 0.06, PlantClass.CROP), (1.7, 0.3, 0.06, PlantClass.CROP)]) is None


def test_weeds_strewn_about_are_no_row() -> None:
    lines = [seen(strays(np.random.default_rng(seed), 5, PlantClass.CROP)) for seed in range(30)]
    assert sum(line is not None for line in lines) == 0
