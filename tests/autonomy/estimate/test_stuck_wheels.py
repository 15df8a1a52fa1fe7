"""Wheels that turn while something holds the robot, with a receiver without corrections."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import EstimateConfig, FieldConfig
from tests import nightly
from tests.autonomy.estimate.noisy_rover import M8N, record
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import error, play

START = (1.0, 2.0, np.pi / 2)
MARKED = FieldConfig(start_map_m=START[:2], start_yaw_deg=90.0)
STUCK_S = 8.0, 14.0


def held(t_s: float) -> float:
    return 0.0 if STUCK_S[0] < t_s < STUCK_S[1] else 1.0


@pytest.mark.parametrize("v_mps", [0.2, 0.3, 0.4, 0.8])
@nightly.one_by_one("seed", range(4), in_suite=1)
def test_wheels_that_only_claim_to_move_leave_a_pose_that_says_how_far_off_it_is(
    seed: int, v_mps: float
) -> None:
    """Up to 5 m of wheel travel in place; afterwards the robot is free again."""

    def drive(t_s: float) -> tuple[float, float]:
        return (v_mps, 0.0) if t_s > 3.0 else (0.0, 0.0)

    recording = record(drive, 25.0, seed=seed, errors=M8N, start=START, grip=held)
    into = Localizer(EstimateConfig(), MARKED, robot((0.0, 0.0, 0.6)))
    estimates = play(recording, into)
    later = [e for e in estimates if e.t_s > STUCK_S[0] + 3.0]
    off_m = [float(np.hypot(*error(recording, e)[:2])) for e in later]
    assert max(m / e.pos_std_m for m, e in zip(off_m, later, strict=True)) < 2.0
    assert max(off_m) < 1.3 * v_mps + 0.2
    before = [e for e in estimates if 5.0 < e.t_s < STUCK_S[0]]
    assert max(e.pos_std_m for e in before) < 0.15
    assert into.rejected["wheels spin"] >= 1


@nightly.one_by_one("seed", range(10), in_suite=2)
def test_wheels_that_grip_are_not_taken_for_spinning(seed: int) -> None:
    def drive(t_s: float) -> tuple[float, float]:
        """Starts, stops, turns and drives backwards."""
        return (0.0, 0.5, -0.3, 0.8)[int(t_s / 3.0) % 4], (0.0, 0.5, 0.0)[int(t_s / 4.0) % 3]

    into = Localizer(EstimateConfig(), MARKED, robot((0.0, 0.0, 0.6)))
    play(record(drive, 60.0, seed=seed, errors=M8N, start=START), into)
    assert into.rejected["wheels spin"] == 0
