"""What the camera shows of the row under the robot, and of none beside it."""

from __future__ import annotations

import pytest

from agribot.autonomy.estimate.sensors.row_sight import SILENT_S, RowSight
from agribot.core.config import FieldConfig
from tests.autonomy.estimate.test_row_lines import Robot


def test_a_row_is_seen_for_a_metre_behind_the_last_of_its_crop() -> None:
    sight = RowSight(FieldConfig(plant_spacing_m=0.25))
    sight.observe(0.0, 0)
    assert sight.is_seen(0.1) is False
    sight.observe(0.1, 1)
    assert sight.is_seen(0.1) is True
    sight.move(0.9)
    sight.observe(1.0, 1)
    assert sight.is_seen(1.0) is True
    sight.move(-0.2)  # way is way
    assert sight.is_seen(1.0) is False


def test_plants_far_apart_carry_the_row_to_the_next_of_them() -> None:
    sight = RowSight(FieldConfig(plant_spacing_m=2.0))
    sight.observe(0.0, 1)
    sight.move(2.9)
    assert sight.is_seen(0.0) is True
    sight.move(0.2)
    assert sight.is_seen(0.0) is False


def test_without_pictures_nobody_looks() -> None:
    sight = RowSight(FieldConfig())
    assert sight.is_seen(0.0) is None
    sight.observe(5.0, 1)
    assert sight.is_seen(5.0 + SILENT_S - 0.1) is True
    assert sight.is_seen(5.0 + SILENT_S + 0.1) is None


@pytest.mark.parametrize(("offset_m", "fits"), [(0.05, True), (0.95, False), (0.4, False)])
def test_only_a_line_under_the_robot_that_is_believed_speaks_for_its_row(
    offset_m: float, fits: bool
) -> None:
    """The robot is on row 4; at 0.95 m it sees the next one, at 0.4 m a line of no row."""
    robot = Robot(5.0, 4.0, 0.0)
    robot.see(offset_m=offset_m)
    assert robot._lines.fitted == fits
