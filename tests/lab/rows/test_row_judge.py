"""Networks judged on photographs of drawn rows, whose right answer geometry gives."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.core.messages import PlantClass
from agribot.lab.dataset.pictures import PictureError
from agribot.lab.rows.conditions import find_condition
from agribot.lab.rows.figures import RowFigures
from agribot.lab.rows.judge import PictureJudge, RowJudge
from agribot.lab.rows.labelled import RowPhoto, find_gaps, find_regions, read_lines
from agribot.lab.rows.lines import (
    JUDGED_AT_PX,
    FoundLine,
    LineFinder,
    LineScores,
    PhotoCameras,
    trace_lines,
)
from tests.lab.rows.drawn_rows import (
    HORIZON_PX,
    SIDE_PX,
    SPACING,
    ColourNetwork,
    draw_field,
    draw_labels,
    place_row,
)

ROWS = (-1.0, 0.0, 1.0)
WEEDS = (-0.5, 0.5)


def lines_of(rows: tuple[float, ...]) -> np.ndarray:
    return np.asarray(draw_labels(rows)) > 127


def judge(
    network: ColourNetwork, weeds: tuple[float, ...] = WEEDS, *, by_place: bool = True
) -> RowJudge:
    image_rgb, lines = draw_field(ROWS, weeds), lines_of(ROWS)
    cameras = PhotoCameras([trace_lines(lines)] if by_place else [])
    seen = network.segment(image_rgb)
    classes = PictureClasses(seen.class_id, seen.confidence)
    total = RowJudge()
    total.add(PictureJudge(cameras).judge("0", "", RowPhoto(image_rgb, lines), classes))
    return total


def test_perfect_names_have_a_balance_of_one() -> None:
    summary = judge(ColourNetwork()).summarise()
    assert summary["on_rows"] == {"crop": 1.0, "weed": 0.0, "soil": 0.0}
    assert summary["between_rows"] == {"crop": 0.0, "weed": 1.0, "soil": 0.0}
    assert summary["balanced"] == 1.0


def test_a_network_that_calls_every_plant_crop_has_a_balance_of_a_half() -> None:
    summary = judge(ColourNetwork(weed=PlantClass.CROP), by_place=False).summarise()
    assert summary["between_rows"] == {"crop": 1.0, "weed": 0.0, "soil": 0.0}
    assert summary["balanced"] == 0.5


def test_place_names_weeds_between_rows_that_a_network_is_sure_are_crop() -> None:
    summary = judge(ColourNetwork(weed=PlantClass.CROP)).summarise()
    assert summary["on_rows"]["crop"] == 1.0
    assert summary["between_rows"]["weed"] > 0.95


def test_a_plant_that_is_called_soil_counts_as_wrong() -> None:
    summary = judge(ColourNetwork(weed=PlantClass.SOIL)).summarise()
    assert summary["between_rows"] == {"crop": 0.0, "weed": 0.0, "soil": 1.0}
    assert summary["balanced"] == 0.5


def test_without_a_plant_between_rows_nothing_is_said_of_weeds() -> None:
    summary = judge(ColourNetwork(), weeds=()).summarise()
    assert summary["between_rows"] == {"crop": None, "weed": None, "soil": None}
    assert summary["balanced"] is None


def test_plants_within_six_pixels_of_a_line_are_on_a_row() -> None:
    lines = np.zeros((SIDE_PX, SIDE_PX), dtype=bool)
    lines[:, 200] = True
    everywhere = np.full((SIDE_PX, SIDE_PX, 3), (40, 160, 40), dtype=np.uint8)
    on_rows = find_regions(RowPhoto(everywhere, lines)).on_rows
    assert np.flatnonzero(on_rows[300]).tolist() == list(range(194, 207))
    assert not on_rows[:154].any()
    assert on_rows[154].any()


def test_the_middle_28_percent_of_a_gap_lie_between_rows() -> None:
    lines = np.zeros((SIDE_PX, SIDE_PX), dtype=bool)
    lines[:, [100, 200, 260]] = True
    columns = np.flatnonzero(find_gaps(lines)[300])
    # The gap of 60 px on the right is too narrow.
    assert columns.tolist() == list(range(136, 164))


def test_soil_is_no_plant_at_a_tenth_of_excess_green() -> None:
    lines = np.ones((SIDE_PX, SIDE_PX), dtype=bool)
    at_tenth = np.full((SIDE_PX, SIDE_PX, 3), (90, 110, 100), dtype=np.uint8)
    assert not find_regions(RowPhoto(at_tenth, lines)).on_rows.any()
    at_tenth[..., 1] = 112
    assert find_regions(RowPhoto(at_tenth, lines)).on_rows[200:].all()


def test_lines_are_traced_with_their_place_and_slope() -> None:
    traced = trace_lines(lines_of(ROWS))
    assert [line.at_px for line in traced] == pytest.approx(
        [place_row(row, JUDGED_AT_PX) for row in ROWS], abs=1.0
    )
    assert [line.slope for line in traced] == pytest.approx([-SPACING, 0.0, SPACING], abs=0.01)


def test_the_horizon_is_where_the_rows_meet() -> None:
    traced = trace_lines(lines_of(ROWS))
    camera = PhotoCameras([traced]).find(traced)
    assert camera is not None
    assert camera.horizon_px == pytest.approx(HORIZON_PX, abs=6.0)
    assert camera.spacing_px == pytest.approx(SPACING * (JUDGED_AT_PX - HORIZON_PX), rel=0.01)


def test_a_single_row_shows_no_camera() -> None:
    traced = trace_lines(lines_of((0.0,)))
    assert PhotoCameras([traced]).find(traced) is None


@pytest.mark.parametrize("row", [0.0, 0.2])
def test_the_found_line_lies_on_the_crop(row: float) -> None:
    traced = trace_lines(lines_of(ROWS))
    camera = PhotoCameras([traced]).find(traced)
    assert camera is not None
    seen = ColourNetwork().segment(draw_field((row,)))
    found = LineFinder().find(PictureClasses(seen.class_id, seen.confidence), camera).line
    assert found is not None
    assert found.line.at_px == pytest.approx(place_row(row, JUDGED_AT_PX), abs=4.0)
    assert found.line.angle_rad == pytest.approx(math.atan(row * SPACING), abs=math.radians(1.5))
    assert abs(found.line.at_px - place_row(row, JUDGED_AT_PX)) <= 2.0 * found.at_std_px


def test_a_found_line_is_held_against_the_nearest_row() -> None:
    traced = trace_lines(lines_of(ROWS))
    camera = PhotoCameras([traced]).find(traced)
    assert camera is not None
    scores = LineScores()
    beside = traced[2]._replace(at_px=traced[2].at_px + 20.0)
    scores.add(traced, camera, FoundLine(beside, angle_std_rad=0.01, at_std_px=9.0))
    scores.add(traced, camera, None)
    assert scores.summarise() == {
        "found": 0.5,
        "angle_deg_median": 0.0,
        "angle_deg_p95": 0.0,
        "offset_ratio_median": pytest.approx(20.0 / camera.spacing_px),
        "angle_within_2_sigma": 1.0,
        "offset_within_2_sigma": 0.0,
    }


@pytest.mark.parametrize(
    ("label", "words"),
    [
        (Image.new("L", (256, 256)), "shows no line"),
        (Image.new("L", (256, 256), 255), "is white over 100%"),
        (draw_labels(ROWS).resize((256, 192)), "256 x 192 pixels, its photograph 512 x 512"),
    ],
)
def test_labels_that_are_no_lines_are_refused(
    label: Image.Image, words: str, tmp_path: Path
) -> None:
    label.save(tmp_path / "0.png")
    with pytest.raises(PictureError, match=words):
        read_lines(tmp_path / "0.png", (SIDE_PX, SIDE_PX, 3))


@pytest.mark.parametrize(
    ("name", "condition"),
    [("shadow_012.jpg", "shadow"), ("late-sun-3.png", "late-sun"), ("17.jpg", ""), ("a.jpg", "")],
)
def test_a_condition_stands_before_the_number_of_a_picture(name: str, condition: str) -> None:
    assert find_condition(Path(name), {}) == condition


def test_a_table_states_conditions_that_names_do_not() -> None:
    assert find_condition(Path("17.jpg"), {"17": "shadow"}) == "shadow"


def test_a_card_states_the_figures_of_rows() -> None:
    text = RowFigures(about="drawn rows", **judge(ColourNetwork()).summarise()).markdown()
    assert "## Crop rows on 1 photographs, balanced 1.000" in text
    assert "on drawn rows." in text
    assert "| on rows | 1.000 | 0.000 | 0.000 |" in text
    assert "| between rows | 0.000 | 1.000 | 0.000 |" in text
    assert "Row line found in 100.0% of the pictures; angle off by 0.2 deg" in text
