"""Wheels that turn while something holds the robot, with a receiver without corrections."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.config import EstimateConfig, FieldConfig
from agribot.estimate.localizer import Localizer
from tests.estimate.noisy_rover import M8N, record
from tests.estimate.paper_robot import robot
from tests.estimate.playback import error, play

START = (1.0, 2.0, np.pi / 2)
MARKED = FieldConfig(start_map_m=START[:2], start_yaw_deg=90.0)
STUCK_S = 8.0, 14.0


def along_a_wall(t_s: float) -> tuple[float, float]:
    return (0.5, 0.0) if t_s > 3.0 else (0.0, 0.0)


def held(t_s: float) -> float:
    return 0.0 if STUCK_S[0] < t_s < STUCK_S[1] else 1.0


@pytest.mark.parametrize("seed", range(6))
def test_the_bias_of_the_receiver_does_not_hide_how_far_the_wheels_only_claimed(seed: int) -> None:
    """3 m of wheel travel in place: the pose may be off, but not more than it says."""
    recording = record(along_a_wall, 25.0, seed=seed, errors=M8N, start=START, grip=held)
    into = Localizer(EstimateConfig(), MARKED, robot((0.0, 0.0, 0.6)))
    estimates = play(recording, into)
    later = [e for e in estimates if e.t_s > STUCK_S[0] + 3.0]
    sigmas = [np.hypot(*error(recording, e)[:2]) / e.pos_std_m for e in later]
    assert max(sigmas) < 2.0
    before = [e for e in estimates if 5.0 < e.t_s < STUCK_S[0]]
    assert max(e.pos_std_m for e in before) < 0.15
    assert min(e.pos_std_m for e in later) > 0.4
