"""Inputs that fall silent, a robot that is tipped, and a program that stands still."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from unittest.mock import ANY

import pytest

from agribot.app.simulated_run import simulate
from agribot.core.config import load
from agribot.core.facts import ClockJumped, Fact, InputSilent, Tilted
from agribot.core.messages import TickRecord
from agribot.core.platform import TrueState
from tests.finding import holds, is_like

FROM_S = 6.0  # on the way to the first row
QUICK = ["perception.enabled=false", "record.enabled=false", "sim.sensors='rtk'", "seed=1"]
Seen = list[tuple[TickRecord, TrueState]]


def drive(out: Path, fault: str, seconds: float, *more: str) -> Seen:
    """Drive the farm until `seconds` after a fault; return the ticks and the truth in each."""
    settings = load(
        "farm", [*QUICK, f"faults={fault}@{FROM_S}", f"duration_s={FROM_S + seconds}", *more]
    )
    with simulate(settings, out) as run:
        return [(record, run.simulator.truth()) for record in run.ticks()]


def stop_of(seen: Seen) -> tuple[float, Fact | None, float]:
    """When after the fault the robot was stopped, why, and how far it rolled from there."""
    stopped = [each for each in seen if each[0].status.stopped]
    first, last = stopped[0], seen[-1]
    way_m = math.dist((first[1].x_map_m, first[1].y_map_m), (last[1].x_map_m, last[1].y_map_m))
    return first[0].batch.t_s - FROM_S, first[0].status.stopped_fact, way_m


def test_safety_inputs_that_fall_silent_stop_a_robot_that_must_have_them(tmp_path: Path) -> None:
    seen = drive(tmp_path / "run", "inputs.silent", 2.0, 'safety.must_report=["red button"]')
    after_s, why, way_m = stop_of(seen)
    assert 0.3 < after_s < 0.4
    assert is_like(why, InputSilent("red button", 0.35, ANY), within=0.055)
    assert way_m < 0.15
    assert all(record.batch.wheels for record, _ in seen), "the rest goes on"
    silent = [record for record, _ in seen if record.batch.t_s > FROM_S + 0.05]
    assert not any(record.batch.battery for record in silent)


def test_a_robot_that_is_tipped_beyond_the_limit_stops_and_says_how_far(tmp_path: Path) -> None:
    seen = drive(tmp_path / "run", "robot.tipped=42", 4.0)
    after_s, why, way_m = stop_of(seen)
    assert 1.0 < after_s < 4.0
    assert is_like(why, Tilted(0.65, ANY), within=0.055)
    assert way_m < 0.3
    pitch_rad = [getattr(truth, "pitch_rad") for _, truth in seen]  # noqa: B009  of the simulator
    assert min(pitch_rad) == pytest.approx(-math.radians(42.0), abs=0.15)
    assert abs(pitch_rad[0]) < 0.05


def test_a_robot_that_is_tipped_within_the_limit_drives_on(tmp_path: Path) -> None:
    seen = drive(tmp_path / "run", "robot.tipped=10", 3.0)
    assert not any(holds(record.status.stopped_fact, Tilted) for record, _ in seen)


def test_a_program_that_stands_still_leaves_the_wheels_to_the_boards_timeout(
    tmp_path: Path,
) -> None:
    seen = drive(tmp_path / "run", "program.stalled=3", 4.0)
    times_s = [record.batch.t_s for record, _ in seen]
    gap_s, k = max((b - a, k) for k, (a, b) in enumerate(itertools.pairwise(times_s)))
    assert gap_s == pytest.approx(3.0, abs=0.05)
    (before, here), (back, there) = seen[k], seen[k + 1]
    assert before.command.drive.v_mps > 0.2
    assert here.v_mps > 0.15 and abs(there.v_mps) < 0.01
    way_m = math.dist((here.x_map_m, here.y_map_m), (there.x_map_m, there.y_map_m))
    assert 0.05 < way_m < 0.4  # 0.5 s at 0.4 m/s, and what braking takes
    assert len(back.batch.wheels) > 100, "what was measured meanwhile is there"
    assert holds(back.fact, ClockJumped)
