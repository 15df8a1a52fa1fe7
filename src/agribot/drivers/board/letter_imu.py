"""The IMU lines of the original AGRIBOT's Arduino: `A164B-328C16384D131E-262F3932G`.

A, B, C are the accelerometer and D, E, F the gyro in counts of an MPU-9265 (or 6050), which at
its default ranges counts 16384 per g and 131 per degree a second.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from agribot.core.errors import ConfigError
from agribot.core.messages import ImuSample, Vec3

STANDARD_GRAVITY_MPS2 = 9.80665
COUNTS = 32768  # counts of full scale, either way
LINE = re.compile(rb"A(-?\d{1,5})B(-?\d{1,5})C(-?\d{1,5})D(-?\d{1,5})E(-?\d{1,5})F(-?\d{1,5})G")
LONGEST_LINE = 64
_AXIS = re.compile(r"(-?)([xyz])")

Axes = tuple[tuple[int, float], ...]


class LetterImuDecoder:
    """Finds readings in a stream of bytes, also among bytes of another protocol on the line.

    `axes` says which of the board's axes point forward, left and up; `accel_g` and `gyro_dps` are
    the ranges that the board is set to.
    """

    def __init__(
        self, axes: Axes, refuse: Callable[[str], None], accel_g: float = 2.0,
        gyro_dps: float = 250.0,
    ) -> None:  # fmt: skip
        self._axes, self._refuse = axes, refuse
        self._accel_mps2 = accel_g * STANDARD_GRAVITY_MPS2 / COUNTS
        self._gyro_radps = math.radians(gyro_dps) / COUNTS
        self._waiting = b""

    def feed(self, data: bytes) -> list[ImuSample]:
        waiting = self._waiting + data
        found, end = [], 0
        for match in LINE.finditer(waiting):
            end = match.end()
            counts = [int(text) for text in match.groups()]
            if max(map(abs, counts)) > COUNTS:
                self._refuse(f"{match[0].decode()} has counts beyond {COUNTS}")
                continue
            found.append(
                ImuSample(
                    t_s=0.0,
                    accel_mps2=self._turn(counts[:3], self._accel_mps2),
                    gyro_radps=self._turn(counts[3:], self._gyro_radps),
                )
            )
        self._waiting = waiting[end:][-LONGEST_LINE:]
        return found

    def _turn(self, counts: list[int], scale: float) -> Vec3:
        x, y, z = counts
        return turn_axes((x * scale, y * scale, z * scale), self._axes)


def turn_axes(reading: Vec3, axes: Axes) -> Vec3:
    """Turn a reading from the axes of a board to those of the body."""
    forward, left, up = (sign * reading[axis] for axis, sign in axes)
    return forward, left, up


def read_axes(text: str) -> Axes:
    """Read which axes of a board point forward, left and up, such as `x,-y,-z`.

    Raises: ConfigError: not each axis once, or a mirror.
    """
    matches = [_AXIS.fullmatch(word.strip()) for word in text.split(",")]
    axes = tuple(("xyz".index(m[2]), -1.0 if m[1] else 1.0) for m in matches if m)
    if len(axes) != 3 or len(matches) != 3 or {axis for axis, _ in axes} != {0, 1, 2}:
        raise ConfigError(
            f"axes={text}: not three axes; name x, y and z once each, as in axes=x,-y,-z"
        )
    order = [axis for axis, _ in axes]
    is_even = order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])
    handedness = (1.0 if is_even else -1.0) * math.prod(sign for _, sign in axes)
    if handedness < 0.0:
        raise ConfigError(
            f"axes={text} is a mirror, as no board is mounted; an upside-down one is x,-y,-z"
        )
    return axes
