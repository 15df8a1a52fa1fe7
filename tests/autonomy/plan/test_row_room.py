"""Rows of the settings need room for the wheels of the robot that straddles them."""

from __future__ import annotations

from unittest.mock import ANY

from agribot.autonomy.plan.tasks.row_task import RowTask
from agribot.core.config import load
from agribot.core.facts import RowsTight
from agribot.description.loader import load_robot
from tests.finding import refused


def test_rows_of_the_settings_that_are_too_narrow_for_the_robot_are_refused_before_the_run() -> (
    None
):
    narrow = load("rows-10x12", ["field.row_pitch_m=0.45"])
    with refused(RowsTight(1, 2, "agribot", 0.45, ANY, ANY, ANY, ANY, ANY)):
        RowTask(narrow, load_robot("agribot"))
    assert len(RowTask(load("rows-10x12", ["field.row_pitch_m=0.57"]), load_robot()).rows) == 10
