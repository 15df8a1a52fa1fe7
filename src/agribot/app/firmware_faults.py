"""Faults of motors, encoders and line where the motor board is real firmware.

They act where they would in a machine: at the output stages, at the encoders' pins, and on the
bytes of the line, whose checksums then have to notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from agribot.core.messages import WHEEL_NAMES, Four
from agribot.core.robot import DriveSpec

if TYPE_CHECKING:
    from agribot.sim.faults.schedule import Fault

# What is done to samples on the simulator's own board, and here to what makes them.
BELOW_THE_SAMPLES = ("wheels.stuck", "wheels.reversed", "board.silent", "link.noise")
FRAMES = 2  # that the board sends in a hundredth of a second


class LineNoise:
    """The fault `link.noise` on the bytes of one line: a share of the frames has a false bit."""

    def __init__(self, faults: Sequence[Fault], rng: np.random.Generator) -> None:
        self._faults = tuple(fault for fault in faults if fault.name == "link.noise")
        self._rng = rng

    def carry(self, data: bytes, frames: int, t_s: float) -> bytes:
        """Return what arrives of the bytes of so many frames."""
        share = sum(fault.number for fault in self._faults if fault.is_on(t_s))
        if not (share and data):
            return data
        spoilt = bytearray(data)
        for _ in range(int(self._rng.binomial(frames, min(share, 1.0)))):
            spoilt[int(self._rng.integers(len(spoilt)))] ^= 1 << int(self._rng.integers(8))
        return bytes(spoilt)


class BoardFaults:
    """What is on at `t_s`, which whoever owns it sets."""

    def __init__(self, faults: Sequence[Fault], drive: DriveSpec, rng: np.random.Generator) -> None:
        self._faults, self._noise = tuple(faults), LineNoise(faults, rng)
        self._runaway_radps = drive.max_speed_mps / drive.wheel_radius_m
        self.t_s = 0.0

    @property
    def is_silent(self) -> bool:
        """Whether no byte comes, nor goes."""
        return any(fault.name == "board.silent" for fault in self._on())

    @property
    def runaway_radps(self) -> float | None:
        """How fast broken output stages let the motors run, None where they obey."""
        is_on = any(fault.name == "motor.runaway" for fault in self._on())
        return self._runaway_radps if is_on else None

    def show(self, speed_radps: Four) -> Four:
        """Return the speeds that the encoders show."""
        shown = list(speed_radps)
        for fault in self._on():
            if fault.name == "wheels.reversed":
                shown = [-speed for speed in shown]
            if fault.name == "wheels.stuck":
                shown[WHEEL_NAMES.index(fault.wheel)] = 0.0
        a, b, c, d = shown
        return a, b, c, d

    def carry(self, data: bytes) -> bytes:
        """Return what arrives of the board's bytes, or at the board."""
        return b"" if self.is_silent else self._noise.carry(data, FRAMES, self.t_s)

    def _on(self) -> list[Fault]:
        return [fault for fault in self._faults if fault.is_on(self.t_s)]
