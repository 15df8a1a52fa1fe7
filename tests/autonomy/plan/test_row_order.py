"""Rows side by side are known by their order, whatever the pose has drifted by meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.plan.explore.beside import Neighbour
from agribot.autonomy.plan.explore.crop_view import CropView
from agribot.autonomy.plan.explore.found_row import FoundRow
from agribot.autonomy.plan.explore.row_order import RowOrder, Side
from agribot.core.messages import FloatArray, RowLine
from agribot.core.pose import Pose2

PITCH_M, LENGTH_M, STD_M = 1.0, 6.0, 0.5
PIECES = tuple(range(24))


class Field:
    """Rows at `left_m` of the first; the receiver drifts to the left with every row."""

    def __init__(self, left_m: list[float], drift_m: float, pos_std_m: float = STD_M) -> None:
        self.left_m, self.drift_m, self.pos_std_m = left_m, drift_m, pos_std_m
        self.order, self.off_m = RowOrder(), 0.0
        self.truth: dict[int, float] = {0: 0.0}
        self.order.begin(FoundRow(0, Pose2(0.0, 0.0, 0.0)))

    def drive(self, row: FoundRow) -> None:
        """Drive a row where it truly stands, and see what stands to both sides of it."""
        true_m = self.truth[row.index]
        along_m = np.arange(0.0, LENGTH_M, 0.05)
        crop: FloatArray = np.column_stack([along_m, np.full(len(along_m), true_m + self.off_m)])
        for x_m in np.arange(0.0, LENGTH_M, 0.2).tolist():
            pose = Pose2(x_m, true_m + self.off_m, 0.0)
            sight = RowLine(
                t_s=0.0, offset_m=0.0, heading_rad=0.0, offset_std_m=0.01, heading_std_rad=0.01
            )
            line = row.add_line(sight, pose)
            for _ in range(3):
                row.add_crop(CropView(crop, crop), line, is_astride=True)
        row.pos_std_m = self.pos_std_m
        row.finish()
        known = {each.index for each in self.order.rows}
        seen: dict[Side, Neighbour | None] = {1: None, -1: None}
        for left_m in self.left_m:
            apart_m = left_m - true_m
            side: Side = 1 if apart_m > 0.0 else -1
            nearest = seen[side]
            if 0.0 < abs(apart_m) < 1.5 and (nearest is None or abs(apart_m) < abs(nearest.left_m)):
                seen[side] = Neighbour(apart_m, PIECES)
        self.order.add_beside(row, seen)
        for each in self.order.rows:
            if each.index not in known:
                at_m = each.line_at(3.0).y_m - self.off_m
                self.truth[each.index] = min(self.left_m, key=lambda m: abs(m - at_m))
        self.off_m += self.drift_m

    def drive_all(self) -> None:
        while left := [row for row in self.order.rows if not row.is_driven]:
            self.drive(min(left, key=lambda row: abs(row.index)))


@pytest.mark.parametrize("drift_m", [0.0, 0.08, -0.15])
def test_every_row_is_counted_once_while_the_pose_drifts_by_more_than_a_row(drift_m: float) -> None:
    field = Field([-PITCH_M * k for k in range(-3, 7)], drift_m)
    field.drive_all()
    assert len(field.order.rows) == 10
    assert [field.truth[row.index] for row in field.order.rows] == [float(k) for k in range(-6, 4)]
    assert abs(field.off_m) == pytest.approx(abs(10 * drift_m))


def test_rows_are_drawn_side_by_side_as_they_were_seen_not_as_the_receiver_drifted() -> None:
    field = Field([-PITCH_M * k for k in range(10)], 0.1)
    field.drive_all()
    field.order.settle()
    drawn = [row.line_at(3.0).y_m for row in field.order.rows]
    assert np.diff(drawn) == pytest.approx(PITCH_M, abs=0.01)
    true = [field.truth[row.index] for row in field.order.rows]
    assert np.mean(np.subtract(drawn, true)) == pytest.approx(0.45, abs=0.02)  # mean of the drift


def test_a_receiver_that_knows_its_place_better_than_the_camera_is_believed() -> None:
    field = Field([0.0, 1.0], 0.1, pos_std_m=0.003)
    field.drive_all()
    drawn = [row.line_at(3.0).y_m for row in field.order.rows]
    assert drawn == pytest.approx([0.0, 1.1], abs=0.01)


def test_a_row_that_was_overlooked_is_put_between_its_neighbours() -> None:
    rows = [0.0, 0.5, 1.0]
    field = Field([0.0, 1.0], 0.0)
    field.drive(field.order.rows[0])
    field.left_m = rows
    field.drive(next(row for row in field.order.rows if not row.is_driven))
    assert [field.truth[row.index] for row in field.order.rows] == rows


def test_what_was_no_row_leaves_its_neighbours_as_far_apart_as_they_are() -> None:
    field = Field([0.0, 1.0, 2.0], 0.0)
    field.drive_all()
    order = field.order
    order.remove(order.rows[1])
    field.left_m = [0.0, 2.0]
    order.add_beside(order.rows[0], {1: Neighbour(2.0, PIECES), -1: None})
    assert [field.truth[row.index] for row in order.rows] == [0.0, 2.0]
