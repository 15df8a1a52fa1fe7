"""What an explorer makes of the crop that it sees: rows, their neighbours and paths along them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from agribot.autonomy.plan.explore.beside import Beside
from agribot.autonomy.plan.explore.crop_view import CropView
from agribot.autonomy.plan.explore.first_row import FirstRow
from agribot.autonomy.plan.explore.found_row import FoundRow
from agribot.autonomy.plan.explore.lay import KEPT_M, back_out, lay_on
from agribot.autonomy.plan.ways.curves import Segment, sample
from agribot.core.geo import is_backwards, wrap_rad
from agribot.core.messages import FloatArray, RowLine
from agribot.core.pose import Pose2


def grow(line: Pose2, first_m: float, last_m: float, spacing_m: float = 0.25) -> FloatArray:
    """Cells of round plants of 16 cm along a line."""
    rng = np.random.default_rng(3)
    feet = np.arange(first_m, last_m + 1e-9, spacing_m)
    leaves = rng.uniform(-0.08, 0.08, (len(feet), 60, 2))
    leaves[np.hypot(leaves[..., 0], leaves[..., 1]) > 0.08] = 0.0
    x_m, y_m = line.transform(feet[:, None] + leaves[..., 0], leaves[..., 1])
    return np.column_stack([x_m.ravel(), y_m.ravel()])


@pytest.mark.parametrize("yaw_deg", [0.0, 37.0, 90.0, 171.0])
def test_the_first_row_is_the_line_on_which_plants_stand_close(yaw_deg: float) -> None:
    line = Pose2(3.0, -2.0, math.radians(yaw_deg))
    finder = FirstRow()
    for _ in range(2):
        finder.look(grow(line, 0.0, 1.5))
    found = finder.find()
    assert found is not None
    assert abs(math.sin(found.yaw_rad - line.yaw_rad)) < math.radians(2.0)
    assert line.locate(*found.xy_m)[1] == pytest.approx(0.0, abs=0.03)


def line_of(row: Pose2, pose: Pose2, std_deg: float = 2.0, error_deg: float = 0.0) -> RowLine:
    """What a picture says of a row that is seen from a pose."""
    _, left_m = row.locate(*pose.xy_m)
    heading_rad = wrap_rad(pose.yaw_rad - row.yaw_rad) + math.radians(error_deg)
    return RowLine(t_s=0.0, offset_m=left_m, heading_rad=heading_rad, offset_std_m=0.02,
                   heading_std_rad=math.radians(std_deg))  # fmt: skip


def look_ahead(
    finder: FirstRow, row: Pose2, yaw_deg: float, std_deg: float, error_deg: Sequence[float]
) -> None:
    """Drive towards the end of a row whose wide leaves are in view over 0.8 m, with weeds."""
    leaves = np.mgrid[-0.15:0.65:0.05, -0.22:0.22:0.05].reshape(2, -1)
    for k, error in enumerate(error_deg):
        pose = Pose2(*row.transform(-1.6 + 0.04 * k, 0.05), math.radians(yaw_deg))
        finder.look(np.column_stack(row.transform(*leaves)))
        finder.look_along(line_of(row, pose, std_deg, error), pose)


@pytest.mark.parametrize("yaw_deg", [-15.0, 0.0, 20.0])
def test_the_row_ahead_runs_as_its_pictures_say_not_as_its_leaves_lie(yaw_deg: float) -> None:
    """A metre of a row that is half as wide has no direction of its own."""
    finder, row = FirstRow(), Pose2(2.0, -1.0, 0.0)
    look_ahead(finder, row, yaw_deg, 2.0, [2.0, -2.0, 1.0, -1.0, 0.0])
    found = finder.find()
    assert found is not None
    assert found.yaw_rad == pytest.approx(row.yaw_rad, abs=math.radians(1.0))
    along_m, left_m = row.locate(*found.xy_m)
    assert along_m == pytest.approx(-0.125, abs=0.05), "where its crop begins"
    assert left_m == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(
    ("std_deg", "error_deg"),
    [(9.0, [0.0] * 5), (2.0, [0.0] * 4), (2.0, [8.0, -8.0, 8.0, -8.0, 8.0])],
    ids=["too unsure", "too few", "at odds"],
)
def test_no_row_is_ahead_while_its_pictures_do_not_agree(
    std_deg: float, error_deg: list[float]
) -> None:
    finder = FirstRow()
    look_ahead(finder, Pose2(2.0, -1.0, 0.0), 0.0, std_deg, error_deg)
    assert finder.find() is None


def test_a_line_without_crop_on_it_is_no_row() -> None:
    finder, row = FirstRow(), Pose2(2.0, -1.0, 0.0)
    for _ in range(5):
        finder.look(grow(row, 0.0, 0.1))
        finder.look_along(line_of(row, Pose2(0.5, -1.0, 0.0)), Pose2(0.5, -1.0, 0.0))
    assert finder.find() is None


def test_the_ends_of_neighbouring_rows_are_no_row() -> None:
    finder = FirstRow()
    for _ in range(2):
        for left_m in (-1.0, 0.0, 1.0):
            finder.look(grow(Pose2(1.0, left_m, 0.0), 0.0, 0.5))
    assert finder.find() is None


def test_a_weed_that_is_taken_for_crop_once_is_no_crop() -> None:
    finder = FirstRow()
    finder.look(grow(Pose2(0.0, 0.0, 0.0), 0.0, 2.0))
    assert finder.find() is None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_nearest_row_beside_is_found_at_its_distance(side: float) -> None:
    beside, line = Beside(), Pose2(0.0, 0.0, 0.4)
    seen = np.column_stack(line.transform(*np.mgrid[0:6:0.05, -1.5:1.5:0.05].reshape(2, -1)))
    for _ in range(2):
        for left_m in (0.0, 0.75 * side, 1.45 * side):
            crop = grow(Pose2(*line.transform(0.0, left_m), 0.4), 0.0, 6.0)
            beside.look(line, 0.0, crop, seen)
    found = beside.find(side)
    assert found is not None and found.left_m == pytest.approx(0.75 * side, abs=0.05)
    assert beside.find(-side) is None


def test_single_plants_beside_a_row_are_no_row() -> None:
    beside, line = Beside(), Pose2(0.0, 0.0, 0.0)
    seen = np.column_stack([grid.ravel() for grid in np.mgrid[0:8:0.05, -1.5:1.5:0.05]])
    for _ in range(3):
        beside.look(line, 0.0, grow(Pose2(0.0, 0.8, 0.0), 1.0, 6.0, spacing_m=2.5), seen)
    assert beside.find(1.0) is None


def test_a_row_reaches_from_its_first_to_its_last_plant() -> None:
    line = Pose2(1.0, 1.0, 0.7)
    row = FoundRow(0, line)
    for _ in range(2):
        row.add_crop(CropView(grow(line, 0.0, 4.0), grow(line, -1.0, 6.0)), is_astride=False)
    assert row.first_m == pytest.approx(-0.08, abs=0.1)
    assert row.last_m == pytest.approx(4.08, abs=0.1)
    assert row.std_m < 0.03
    seen = np.column_stack(line.transform(np.arange(0.0, 6.0, 0.02), np.zeros(300)))
    assert row.measure_bare_m(seen, 1.0) == pytest.approx(1.9, abs=0.15)


def test_a_path_goes_over_to_another_line_without_a_bend_at_the_joint() -> None:
    path = sample(Pose2(0.0, 0.0, 0.0), [Segment(10.0, 0.0)])
    line = Pose2(6.0, 0.05, 0.02)
    there = lay_on(path, 6.0, line, 3.0, 4)
    assert float(there.s_m[0]) == pytest.approx(6.0 - KEPT_M, abs=0.03)
    assert np.all(np.diff(there.s_m) > 0.0) and float(np.diff(there.s_m).max()) < 0.03
    joint = int(np.argmax(there.row == 4))
    assert np.abs(np.diff(there.yaw_map_rad))[joint - 2 : joint + 2].max() < 0.01
    assert np.abs(there.curvature_radpm).max() < 0.4
    along_m, left_m = line.locate(*there.xy_map_m[-1])
    assert left_m == pytest.approx(0.0, abs=1e-6) and along_m == pytest.approx(3.0, abs=0.01)


def test_backing_out_leads_over_ground_that_was_driven() -> None:
    way = back_out(Pose2(2.0, 0.0, 0.0), 0.15, 1.8)
    assert float(way.xy_map_m[:, 0].max()) == pytest.approx(2.15)
    assert way.xy_map_m[-1].tolist() == pytest.approx([0.2, 0.0])
    assert np.all(way.yaw_map_rad == 0.0)
    assert not is_backwards(way.xy_map_m, way.yaw_map_rad)[0]
    assert is_backwards(way.xy_map_m, way.yaw_map_rad)[-1]
