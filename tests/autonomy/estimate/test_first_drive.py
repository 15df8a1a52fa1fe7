"""Sensors that are mounted or described wrongly: named on the first drive, with what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.facts import AntennaElsewhere, CourseOff, Fact, GyroTurns
from agribot.core.messages import (
    ControlMission,
    Estimate,
    GnssHeading,
    SensorBatch,
    Vec3,
)
from tests import nightly
from tests.asking import ask
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Errors, Recording, record, rows
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import batches, localizer
from tests.autonomy.estimate.test_first_heading import straight
from tests.finding import find, holds


def first_complaint(
    recording: Recording, about: type[Fact], into: Localizer | None = None
) -> Estimate:
    """Play until something like this is found."""
    into = into or localizer()
    played = (into.update(batch) for batch in batches(recording))
    return next(
        each for each in played if holds(each.fact, about) or holds(each.contradiction_fact, about)
    )


def turn_compass(recording: Recording, by_deg: float) -> Recording:
    """Mount the magnetometer so that it shows headings `by_deg` too far left."""
    cos, sin = math.cos(math.radians(by_deg)), math.sin(math.radians(by_deg))
    mag = [
        msgspec.structs.replace(each, field_t=(cos * x + sin * y, cos * y - sin * x, z))
        for each in recording.mag
        for x, y, z in [each.field_t]
    ]
    return msgspec.structs.replace(recording, mag=mag)


@pytest.mark.parametrize("by_deg", [45.0, -90.0, 180.0])
@pytest.mark.parametrize(("errors", "most_m"), [(RTK, 0.8), (M8N, 1.6)], ids=["rtk", "m8n"])
def test_a_compass_that_is_far_off_stops_the_robot_on_its_first_metres(
    errors: Errors, most_m: float, by_deg: float
) -> None:
    recording = turn_compass(record(straight, 8.0, seed=1, errors=errors), by_deg)
    found = first_complaint(recording, CourseOff)
    assert not found.ok
    course = find(found.fact, CourseOff)
    assert course.source == "compass"
    assert abs(course.off_rad) == pytest.approx(math.radians(abs(by_deg)), abs=math.radians(12.0))
    assert abs(recording.pose(found.t_s)[1] - 2.0) < most_m


@pytest.mark.parametrize("errors", [RTK, M8N], ids=["rtk", "m8n"])
def test_a_compass_beside_iron_is_not_accused(errors: Errors) -> None:
    iron = msgspec.structs.replace(errors, hard_iron_rad=math.radians(10.0))
    for seed in range(4):
        into = localizer()
        told = [into.update(batch) for batch in batches(record(straight, 8.0, seed, iron))]
        assert told[-1].ok, told[-1].fact
        assert not any(each.contradiction_fact for each in told)


def test_antennas_that_are_swapped_are_named() -> None:
    recording = msgspec.structs.replace(record(straight, 6.0, seed=1, errors=RTK), mag=[])
    into = Localizer(EstimateConfig(), FieldConfig(), msgspec.structs.replace(robot(), mag=None))
    for batch in batches(recording):
        heading = GnssHeading(t_s=batch.t_s - 0.05, yaw_map_rad=-math.pi / 2, std_rad=0.01)
        last = into.update(msgspec.structs.replace(batch, headings=(heading,)))
    assert not last.ok
    course = find(last.fact, CourseOff)
    assert course.source == "second antenna"
    assert abs(course.off_rad) == pytest.approx(math.pi, abs=math.radians(10.0))


def swap_axes(recording: Recording, order: tuple[int, int, int], sign: float) -> Recording:
    def turned(rates: Vec3) -> Vec3:
        x, y, z = (rates[axis] for axis in order)
        return x, y, sign * z

    imu = [
        msgspec.structs.replace(each, gyro_radps=turned(each.gyro_radps)) for each in recording.imu
    ]
    return msgspec.structs.replace(recording, imu=imu)


@pytest.mark.parametrize(
    ("order", "sign"), [((0, 1, 2), -1.0), ((2, 1, 0), 1.0)], ids=["turned over", "x for z"]
)
def test_a_gyro_whose_axes_are_swapped_is_named_in_its_first_turn(
    order: tuple[int, int, int], sign: float
) -> None:
    recording = swap_axes(record(rows, 22.0, seed=1, errors=M8N), order, sign)
    found = first_complaint(recording, GyroTurns)
    assert found.t_s < 17.0  # the turn begins at 15 s


# An antenna in the middle of the robot, and where its description has it.
ASIDE = {"left": (0.0, -0.3), "right": (0.0, 0.3), "ahead": (-0.3, 0.0), "behind": (0.3, 0.0)}


@pytest.mark.parametrize("where", ASIDE)
def test_an_antenna_that_sits_elsewhere_is_named_after_a_turn_to_each_side(where: str) -> None:
    stated_m = (*ASIDE[where], 0.6)
    for errors in (RTK, M8N):
        recording = record(rows, 38.0, seed=1, errors=errors)  # turns end at 20 and 38 s
        found = first_complaint(recording, AntennaElsewhere, localizer(stated_m))
        antenna = find(found.fact, AntennaElsewhere)
        assert antenna.sits == where
        assert antenna.off_m == pytest.approx(0.3, abs=0.06)
        is_paused = found.contradiction_fact is not None
        assert is_paused == (errors is RTK)


def test_a_person_who_has_measured_the_antenna_goes_on() -> None:
    into = localizer((0.0, 0.3, 0.6))
    recording = record(rows, 42.0, seed=1, errors=RTK)
    last = [into.update(batch) for batch in batches(recording)][-1]
    assert isinstance(last.contradiction_fact, AntennaElsewhere)
    resumed = ask(ControlMission(action="resume"), t_s=last.t_s)
    after = into.update(SensorBatch(t_s=last.t_s + 0.02, requests=(resumed,)))
    assert after.contradiction_fact is None


@nightly.all_or_first("seeds", range(20), in_suite=1, unit="seed")
def test_an_antenna_where_it_is_stated_is_not_accused(seeds: Sequence[int]) -> None:
    for seed in seeds:
        for errors in (RTK, M8N):
            into = localizer()
            for batch in batches(record(rows, 45.0, seed=seed, errors=errors)):
                told = into.update(batch)
                assert not holds(told.fact, AntennaElsewhere)
