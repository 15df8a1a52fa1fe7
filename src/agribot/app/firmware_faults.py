"""Faults of motors, encoders, battery and lines where the motor board is real firmware.

They act where they would in a machine: at the output stages, at the pins of encoders and battery,
and on the bytes of the line, whose checksums and clocks then have to notice.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from agribot.core.messages import WHEEL_NAMES, Four
from agribot.core.robot import DriveSpec
from agribot.drivers.board.board_codec import unstuff
from agribot.drivers.board.board_protocol import BoardImu
from agribot.sim.faults.motors import list_torque_shares

if TYPE_CHECKING:
    from agribot.sim.faults.schedule import Fault

ROUNDING_S = 1e-9

# Faults of samples on the simulator's own board, and here of the parts that make them.
BELOW_THE_SAMPLES = ("wheels.stuck", "wheels.reversed", "board.silent", "link.noise", "imu.late",
                     "imu.unplugged", "button.pressed", "board.hung", "inputs.silent")  # fmt: skip
EMPTY = "battery.empty"
EMPTYING_VPS = 0.03  # an empty pack that still feeds falls on, until the board lets go
FRAMES = 2  # frames that the board sends in a hundredth of a second


class LineNoise:
    """The fault `link.noise` on the bytes of one line: a share of the frames has a false bit."""

    def __init__(self, faults: Sequence[Fault], rng: np.random.Generator) -> None:
        self._faults = tuple(fault for fault in faults if fault.name == "link.noise")
        self._rng = rng

    def carry(self, data: bytes, frames: int, t_s: float) -> bytes:
        """Return what arrives of the bytes of `frames` frames."""
        share = sum(fault.find_number(t_s) for fault in self._faults if fault.is_on(t_s))
        if not (share and data):
            return data
        spoilt = bytearray(data)
        for _ in range(int(self._rng.binomial(frames, min(share, 1.0)))):
            spoilt[int(self._rng.integers(len(spoilt)))] ^= 1 << int(self._rng.integers(8))
        return bytes(spoilt)


class LateFrames:
    """The fault `imu.late` on the board's line: frames of the IMU wait, with their true stamps."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = tuple(fault for fault in faults if fault.name == "imu.late")
        self._cut = b""  # the begin of a frame
        self._waiting: deque[tuple[float, bytes]] = deque()  # due at, frame

    def carry(self, data: bytes, t_s: float) -> bytes:
        """Return what arrives of the board's bytes at a time."""
        on = (fault.find_number(t_s) for fault in self._faults if fault.is_on(t_s))
        late_s = max(on, default=0.0)
        if not (late_s or self._waiting or self._cut):
            return data
        *frames, self._cut = (self._cut + data).split(b"\0")
        arrived = bytearray()
        while self._waiting and (self._waiting[0][0] <= t_s + ROUNDING_S or not late_s):
            arrived += self._waiting.popleft()[1]
        for frame in frames:
            if late_s and _is_imu(frame):
                self._waiting.append((t_s + late_s, frame + b"\0"))
            else:
                arrived += frame + b"\0"
        return bytes(arrived)


def _is_imu(frame: bytes) -> bool:
    body = unstuff(frame)
    return body is not None and body[:1] == bytes((BoardImu.number,))


class BoardFaults:
    """The faults that are on at `t_s`, which the owner sets."""

    def __init__(
        self, faults: Sequence[Fault], drive: DriveSpec, rng: np.random.Generator, weak_wheel: str
    ) -> None:
        """`weak_wheel` is the one that `motor.weak` affects."""
        self._faults, self._noise = tuple(faults), LineNoise(faults, rng)
        self._late, self._weak_wheel = LateFrames(faults), weak_wheel
        self._most_a = drive.wheel_torque_nm / drive.torque_constant_nmpa
        self._runaway_radps = drive.max_speed_mps / drive.wheel_radius_m
        self.t_s = 0.0
        self._hung_s: set[float] = set()

    @property
    def is_silent(self) -> bool:
        """Whether no byte comes, nor goes."""
        return any(fault.name == "board.silent" for fault in self._on())

    @property
    def is_button_pressed(self) -> bool:
        return any(fault.name == "button.pressed" for fault in self._on())

    @property
    def are_inputs_silent(self) -> bool:
        """Whether red button, bumper, battery and motors are not reported."""
        return any(fault.name == "inputs.silent" for fault in self._on())

    @property
    def has_imu(self) -> bool:
        """Whether the chip has contact."""
        return not any(fault.name == "imu.unplugged" for fault in self._on())

    def take_hangs(self) -> int:
        """Return how often the program is to hang since the last call."""
        begun_s = {fault.begin_s for fault in self._on() if fault.name == "board.hung"}
        new_s, self._hung_s = begun_s - self._hung_s, begun_s
        return len(new_s)

    @property
    def runaway_radps(self) -> float | None:
        """Speed that broken output stages let the motors reach, None where they obey."""
        is_on = any(fault.name == "motor.runaway" for fault in self._on())
        return self._runaway_radps if is_on else None

    def limit_currents(self, current_a: Sequence[float]) -> list[float]:
        """Return what flows through the motors: a broken one lets through less, or nothing."""
        shares = list_torque_shares(self._on(), self.t_s, self._weak_wheel)
        return [
            max(min(amperes, shares[name] * self._most_a), -shares[name] * self._most_a)
            if shares[name] < 1.0
            else amperes
            for name, amperes in zip(WHEEL_NAMES, current_a, strict=True)
        ]

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

    def drain(self, voltage_v: float) -> float:
        """Return the battery's voltage at the board's pin, as that of an empty one falls on."""
        since_s = [self.t_s - fault.begin_s for fault in self._on() if fault.name == EMPTY]
        return max(voltage_v - EMPTYING_VPS * max(since_s, default=0.0), 0.0)

    def bring(self, data: bytes) -> bytes:
        """Return what arrives of the board's bytes."""
        return self._carry(self._late.carry(data, self.t_s))

    def send(self, data: bytes) -> bytes:
        """Return what arrives at the board."""
        return self._carry(data)

    def _carry(self, data: bytes) -> bytes:
        return b"" if self.is_silent else self._noise.carry(data, FRAMES, self.t_s)

    def _on(self) -> list[Fault]:
        return [fault for fault in self._faults if fault.is_on(self.t_s)]
