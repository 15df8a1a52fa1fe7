"""Faults of the line between sensors and computer, of the board's side of it, and of the clock."""

from __future__ import annotations

import struct
from typing import Any, TypeVar

import msgspec
import numpy as np

from agribot.core.messages import SensorBatch
from agribot.sim.faults.schedule import Fault

# Lines, and the numbers in their messages.
NUMBERS = {
    "wheels": ("angle_rad", "speed_radps"),
    "imu": ("gyro_radps", "accel_mps2"),
    "mag": ("field_t",),
    "gnss": ("lat_deg", "lon_deg", "alt_m", "pos_std_m"),
    "headings": ("yaw_map_rad",),
    "battery": ("voltage_v", "charge_ratio"),
}
STAMPED = ("wheels", "imu", "mag", "gnss", "frames", "requests", "notes", "base", "headings",
           "bumper", "battery", "board", "hand", "gnss_status", "contactor")  # fmt: skip
Stamped = TypeVar("Stamped", bound=msgspec.Struct)


class NoisyLink:
    """A share of all messages is hit: half of these are lost, in the others one bit is false.

    There is no checksum: what the bit stood for decides whether the number is a little off,
    absurd, or none at all.
    """

    def __init__(self, fault: Fault, rng: np.random.Generator) -> None:
        self._fault, self._rng = fault, rng

    def alter(self, batch: SensorBatch) -> SensorBatch:
        heard = {
            field: tuple(
                heard for sample in getattr(batch, field) for heard in self._send(sample, numbers)
            )
            for field, numbers in NUMBERS.items()
        }
        return msgspec.structs.replace(batch, **heard)

    def _send(self, sample: Any, numbers: tuple[str, ...]) -> tuple[Any, ...]:
        if not self._fault.is_on(sample.t_s):
            return (sample,)
        share, draw = self._fault.find_number(sample.t_s), float(self._rng.random())
        if draw >= share:
            return (sample,)
        return () if draw < 0.5 * share else (self._spoil(sample, numbers),)

    def _spoil(self, sample: Any, numbers: tuple[str, ...]) -> Any:
        field = numbers[int(self._rng.integers(len(numbers)))]
        value, bit = getattr(sample, field), int(self._rng.integers(64))
        if not isinstance(value, tuple):
            return msgspec.structs.replace(sample, **{field: flip_bit(value, bit)})
        index = int(self._rng.integers(len(value)))
        spoilt = tuple(flip_bit(v, bit) if k == index else v for k, v in enumerate(value))
        return msgspec.structs.replace(sample, **{field: spoilt})


def flip_bit(value: float, bit: int) -> float:
    """Flip one bit of an IEEE 754 double, 0 being the least of the mantissa, 63 the sign."""
    (word,) = struct.unpack(">Q", struct.pack(">d", value))
    (flipped,) = struct.unpack(">d", struct.pack(">Q", word ^ (1 << bit)))
    return float(flipped)


class SilentBoard:
    """The board sends no wheel sample; that it ignores commands too is `BodyFaults`' part."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault

    def alter(self, batch: SensorBatch) -> SensorBatch:
        wheels = tuple(s for s in batch.wheels if not self._fault.is_on(s.t_s))
        return msgspec.structs.replace(batch, wheels=wheels)


class SteppedClock:
    """Shift all time stamps by the fault's value, those of the ticks too."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault

    def alter(self, batch: SensorBatch) -> SensorBatch:
        stamps = {
            field: tuple(self._move(sample) for sample in getattr(batch, field))
            for field in STAMPED
        }
        return msgspec.structs.replace(self._move(batch), **stamps)

    def _move(self, value: Stamped) -> Stamped:
        t_s: float = getattr(value, "t_s")  # noqa: B009  the bound names no field
        if not self._fault.is_on(t_s):
            return value
        return msgspec.structs.replace(value, t_s=t_s + self._fault.number)
