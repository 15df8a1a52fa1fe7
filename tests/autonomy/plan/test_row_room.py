"""Rows of the settings need room for the wheels of the robot that straddles them."""

from __future__ import annotations

import pytest

from agribot.autonomy.plan.tasks.row_task import RowTask
from agribot.core.config import load
from agribot.core.errors import MissionError
from agribot.description.loader import load_robot


def test_rows_of_the_settings_that_are_too_narrow_for_the_robot_are_refused_before_the_run() -> (
    None
):
    narrow = load("rows-10x12", ["field.row_pitch_m=0.45"])
    with pytest.raises(MissionError, match=r"rows 1 and 2 are 0\.45 m apart, .* for agribot: its"):
        RowTask(narrow, load_robot("agribot"))
    assert len(RowTask(load("rows-10x12", ["field.row_pitch_m=0.57"]), load_robot()).rows) == 10
