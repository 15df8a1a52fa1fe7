"""Soft soil and clods half as high as the wheels' radius: what holds the robot is no end."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot import load, simulate
from tests import nightly

HARD = ["sim.preset='hard'", "sim.sensors='rtk'", "perception.enabled=false",
        "record.enabled=false"]  # fmt: skip


@pytest.mark.parametrize(
    ("seed", "until_s", "least_m"),
    [
        (102, 20.0, 1.5),
        pytest.param(
            116,
            25.0,
            3.5,
            marks=nightly.by_day("test_a_clod_that_holds_a_wheel_in_a_turn_stops_no_mission"),
        ),
    ],
)
def test_a_clod_that_holds_a_wheel_in_a_turn_stops_no_mission(
    tmp_path: Path, seed: int, until_s: float, least_m: float
) -> None:
    """Its wheels spin for a moment, the receiver is jolted: it is neither stuck nor turned."""
    with simulate(load("farm", [*HARD, f"seed={seed}", f"duration_s={until_s}"]), tmp_path) as run:
        for record in run.ticks():
            assert not record.status.stopped
            assert not record.estimate.contradiction
    assert record.status.s_m > least_m


@nightly.by_day(
    "tests/autonomy/plan/test_freeing.py::"
    "test_held_by_a_clod_it_backs_out_as_it_came_and_does_its_rows",
    "tests/mission/test_protective_stops.py::"
    "test_in_mud_the_robot_tries_to_back_out_and_then_a_person_has_to_look",
)
def test_a_robot_that_is_stuck_in_a_turn_backs_out_and_turns_on(tmp_path: Path) -> None:
    with simulate(load("farm", [*HARD, "seed=305", "duration_s=100"]), tmp_path) as run:
        legs: list[str] = []
        for record in run.ticks():
            assert not record.status.stopped
            if record.status.leg not in legs[-1:]:
                legs.append(record.status.leg)
    assert "backs out to try again" in legs
    assert legs[-1] == "row 1"
