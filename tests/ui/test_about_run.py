"""What the page gets about the robot before it starts."""

from __future__ import annotations

import msgspec
import pytest

from agribot.core import config
from agribot.description.loader import load_robot
from agribot.ui.robot_side.about_run import expected_rates_hz, shown_robot


@pytest.mark.parametrize(
    ("sensors", "is_described", "has_compass"),
    [("rtk", True, True), ("rtk", False, False), ("rtk-1", True, False)],
)
def test_a_robot_without_a_magnetometer_is_shown_as_one(
    sensors: str, is_described: bool, has_compass: bool
) -> None:
    robot, settings = load_robot("agribot"), config.load("farm", [f"sim.sensors={sensors}"])
    if not is_described:
        robot = msgspec.structs.replace(robot, mag=None)
    assert shown_robot(robot, settings).has_compass == has_compass
    assert ("mag" in expected_rates_hz(robot, settings)) == has_compass
