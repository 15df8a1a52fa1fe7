"""A drive under one command."""

from __future__ import annotations

import numpy as np

from agribot.core.messages import DriveCommand, FloatArray
from agribot.sim.physics import Physics


def hold(
    physics: Physics, v_mps: float, yaw_rate_radps: float, seconds: float, steps: int = 10
) -> FloatArray:
    """All rows of the history while a command is held, twenty milliseconds at a time."""
    rows = []
    for _ in range(round(seconds / 0.02)):
        physics.command(DriveCommand(v_mps=v_mps, yaw_rate_radps=yaw_rate_radps))
        rows.append(physics.advance(steps)[1:].copy())
    return np.concatenate(rows)
