"""Which row this is: known by what grows beside it, asked where that fits another row better."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.estimate.filter.field_rows import FieldRows, Rows
from agribot.autonomy.estimate.sensors.mapped_rows import MappedRows
from agribot.autonomy.estimate.witnesses.row_identity import LOOK_M, RowIdentity
from agribot.core.config import FieldConfig
from agribot.core.facts import WhichRow
from agribot.core.messages import FloatArray
from agribot.core.pose import Pose2
from tests.autonomy.estimate.paper_cover import Grows, Mask, cover_from

FIELD = FieldConfig(
    first_row_start_map_m=(0.0, 0.0), row_yaw_deg=0.0, row_length_m=12.0, row_count=10
)
ROWS = FieldRows(FIELD)  # row k at y = -k, from x = 0 to 12
STEP_M = 0.05


class Field:
    """Ten rows, with gaps and weeds taken for crop; the robot may be rows aside of its pose."""

    def __init__(self, rows: Rows = ROWS, gap_m: tuple[float, float] = (0.0, 0.0)) -> None:
        self.rows, self.gap_m = rows, gap_m
        self.stray: Grows = lambda x, y: np.zeros(np.broadcast(x, y).shape, dtype=bool)
        self.identity = RowIdentity(0.9)

    def grows(self, x_m: FloatArray, y_m: FloatArray) -> Mask:
        is_row = (np.abs(y_m - np.round(y_m)) < 0.1) & (y_m < 0.5) & (y_m > -9.5)
        is_gap = (x_m > self.gap_m[0]) & (x_m < self.gap_m[1])
        crop: Mask = (is_row & (x_m > 0.0) & (x_m < 12.0) & ~is_gap) | self.stray(x_m, y_m)
        return crop

    def drive(self, row: int, aside: int = 0, *, back: bool = False, way_m: float = 14.0) -> float:
        """Drive a row as believed, `aside` rows to its right; how far it came until it asked."""
        yaw_rad = math.pi if back else 0.0
        for step in range(int(way_m / STEP_M)):
            x_m = 13.0 - step * STEP_M if back else step * STEP_M - 1.0
            true = Pose2(x_m, -float(row + aside) + 0.02, yaw_rad)
            believed = Pose2(x_m, -float(row) + 0.02, yaw_rad)
            self.identity.look(cover_from(true, self.grows), believed, self.rows)
            if self.identity.doubt:
                return step * STEP_M
        return math.inf


def test_in_its_rows_a_robot_never_asks_and_grows_sure() -> None:
    field = Field()
    for row in range(10):
        assert field.drive(row, back=bool(row % 2)) == math.inf
    assert field.identity.certainty > 0.999


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize(("row", "aside", "side"), [(0, 1, "right"), (9, -1, "left")])
def test_crop_beside_the_outermost_row_where_none_is_to_be_asks_within_two_metres(
    row: int, aside: int, side: str, back: bool
) -> None:
    field = Field()
    assert field.drive(row, aside, back=back) < 2.0
    doubt = field.identity.doubt
    assert isinstance(doubt, WhichRow) and (doubt.rows, doubt.side) == (1, side)


def test_bare_ground_in_the_first_row_with_crop_beside_it_asks() -> None:
    field = Field()
    assert field.drive(0, -1) < 1.0 + 4 * LOOK_M
    doubt = field.identity.doubt
    assert isinstance(doubt, WhichRow) and (doubt.rows, doubt.side) == (1, "left")


def test_a_row_in_the_middle_of_a_field_looks_like_the_next() -> None:
    field = Field()
    assert field.drive(4, 1) == math.inf
    assert field.identity.certainty == pytest.approx(0.98, abs=0.01)


@pytest.mark.parametrize("row", [0, 1, 9])
def test_five_metres_without_plants_are_a_gap_and_no_other_row(row: int) -> None:
    field = Field(gap_m=(4.0, 9.0))
    assert field.drive(row) == math.inf


def test_a_few_weeds_taken_for_crop_beside_the_first_row_are_no_row() -> None:
    field = Field()
    field.stray = lambda x, y: (np.abs(y - 1.0) < 0.1) & (np.abs(x - 5.0) < 0.3)
    assert field.drive(0) == math.inf


def test_once_a_person_has_told_the_row_it_asks_no_more() -> None:
    field = Field()
    field.drive(0, 1)
    field.identity.confirm_row()
    assert not field.identity.doubt
    assert field.drive(0, 1, way_m=6.0) == math.inf


def test_rows_of_a_map_are_told_apart_too() -> None:
    drawn = MappedRows([((0.0, -float(row)), (12.0, -float(row))) for row in range(10)])
    assert Field(drawn).drive(0) == math.inf
    assert Field(drawn).drive(0, 1) < 2.0


def test_plants_far_apart_and_a_lone_row_say_nothing() -> None:
    sparse = MappedRows([((0.0, -float(row)), (12.0, -float(row))) for row in range(10)], 2.0)
    lone = MappedRows([((0.0, 0.0), (12.0, 0.0))])
    assert Field(sparse).drive(0, 1) == math.inf
    assert Field(lone).drive(0, 1) == math.inf
