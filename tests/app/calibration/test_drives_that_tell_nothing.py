"""Calibration drives on which the robot stood, slipped, or a sensor said the wrong thing."""

from __future__ import annotations

from collections.abc import Callable
from unittest.mock import ANY

import msgspec
import pytest

from agribot.app.calibration.figure import FIGURE, TURNS, DriveSamples, drive_figure
from agribot.app.calibration.kinds import KINDS
from agribot.core import config
from agribot.core.config import RunConfig
from agribot.core.facts import LegStood, WheelsStoodIn
from agribot.core.messages import SensorBatch
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.sim.platform import SimPlatform
from tests.finding import refused

ROBOT = load_robot("agribot")
Change = Callable[[SensorBatch], SensorBatch]


@pytest.fixture(scope="module")
def settings() -> RunConfig:
    return config.load("farm", ["perception.enabled=false", "sim.sensors=rtk"])


@pytest.fixture(scope="module")
def drives(settings: RunConfig) -> dict[str, DriveSamples]:
    found = {}
    for name, figure in (("drive", FIGURE), ("antenna", TURNS)):
        platform = SimPlatform(settings, ROBOT, load_world("empty"))
        found[name] = drive_figure(platform, ROBOT.drive, None, figure)
        platform.close()
    return found


def roll(ratio: float) -> Change:
    """Multiply the turns of the wheels by `ratio`, as when they spin."""

    def change(batch: SensorBatch) -> SensorBatch:
        wheels = tuple(
            msgspec.structs.replace(
                sample, angle_rad=tuple(ratio * angle for angle in sample.angle_rad)
            )
            for sample in batch.wheels
        )
        return msgspec.structs.replace(batch, wheels=wheels)

    return change


def hold_in_one_place(batch: SensorBatch) -> SensorBatch:
    """The robot is jacked up, or its receiver repeats what it said."""
    fixes = tuple(
        msgspec.structs.replace(fix, lat_deg=21.1, lon_deg=72.7, velocity_mps=None)
        for fix in batch.gnss
    )
    return msgspec.structs.replace(batch, gnss=fixes)


def change(drive: DriveSamples, how: Change) -> DriveSamples:
    return drive._replace(batches=[how(batch) for batch in drive.batches])


def test_wheels_that_turn_under_a_robot_that_stands_measure_nothing(
    drives: dict[str, DriveSamples], settings: RunConfig
) -> None:
    stood = change(drives["drive"], hold_in_one_place)
    with refused(LegStood(ANY, ANY, 0.0, ANY)):
        KINDS["drive"].find(stood, ROBOT, settings)


@pytest.mark.parametrize("ratio", [0.3, 3.0])
def test_wheels_of_another_size_than_any_such_robots_are_not_taken_over(
    drives: dict[str, DriveSamples], settings: RunConfig, ratio: float
) -> None:
    found = KINDS["drive"].find(change(drives["drive"], roll(ratio)), ROBOT, settings)
    assert not found.ok
    assert any("times the 0.0900 of the description" in reason for reason in found.reasons)


def test_without_encoders_the_antenna_is_not_known_to_be_ahead_or_behind(
    drives: dict[str, DriveSamples], settings: RunConfig
) -> None:
    with refused(WheelsStoodIn):
        KINDS["antenna"].find(change(drives["antenna"], roll(0.0)), ROBOT, settings)
