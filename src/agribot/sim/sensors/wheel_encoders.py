"""Wheel encoders: whole ticks, and the speed from their difference."""

from __future__ import annotations

import math

from agribot.core.messages import WHEEL_NAMES, FloatArray, Four, MiddleWheel, WheelSample
from agribot.core.robot import DriveSpec
from agribot.sim.sensors.presets import WheelErrors
from agribot.sim.state import EFFORT, FAULT, HISTORY_COLUMNS, MIDDLE_COLUMNS, WHEEL_ANGLE

# Efforts, targets and faults lie side by side in the history.
BOARD_COLUMNS = slice(EFFORT.start, FAULT.stop)


class WheelEncoders:
    """The encoder sits on the motor, so the gear multiplies its resolution at the wheel."""

    def __init__(
        self, errors: WheelErrors, drive: DriveSpec, middle_wheels: tuple[str, ...] = ()
    ) -> None:
        ticks = drive.encoder_ticks_per_rev * drive.gear_ratio
        self._tick_rad = math.tau / ticks if errors.quantised else 0.0
        self._angle_rad: Four = (0.0, 0.0, 0.0, 0.0)
        self._t_s = 0.0
        self._middle = middle_wheels
        self._middle_rad = [0.0] * len(self._middle)

    def sample(self, t_s: float, row: FloatArray) -> WheelSample:
        """Return the reading for one row of the physics history."""
        a, b, c, d = row[WHEEL_ANGLE].tolist()
        tick = self._tick_rad
        if tick:
            a = math.floor(a / tick) * tick
            b = math.floor(b / tick) * tick
            c = math.floor(c / tick) * tick
            d = math.floor(d / tick) * tick
        last_a, last_b, last_c, last_d = self._angle_rad
        e, f, g, h, p, q, r, s, *faults = row[BOARD_COLUMNS].tolist()
        rate = 1.0 / (t_s - self._t_s)
        middle, middle_faults = self._read_middle(row, rate) if self._middle else ((), ())
        self._angle_rad, self._t_s = (a, b, c, d), t_s
        return WheelSample(
            t_s=t_s,
            angle_rad=(a, b, c, d),
            speed_radps=(
                (a - last_a) * rate, (b - last_b) * rate,
                (c - last_c) * rate, (d - last_d) * rate,
            ),
            effort_nm=(e, f, g, h),
            target_radps=(p, q, r, s),
            faults=(*(_list_faulty(faults) if any(faults) else ()), *middle_faults),
            middle=middle,
        )  # fmt: skip

    def _read_middle(
        self, row: FloatArray, rate: float
    ) -> tuple[tuple[MiddleWheel, ...], tuple[str, ...]]:
        """Return the wheels between the corners, and the names of those at fault."""
        columns = row[HISTORY_COLUMNS:].reshape(MIDDLE_COLUMNS, -1).tolist()
        angles_rad, _speeds, efforts_nm, _targets, faults = columns
        tick = self._tick_rad
        if tick:
            angles_rad = [math.floor(angle / tick) * tick for angle in angles_rad]
        read = tuple(
            MiddleWheel(angle_rad=angle, speed_radps=(angle - last) * rate, effort_nm=effort)
            for angle, last, effort in zip(angles_rad, self._middle_rad, efforts_nm, strict=True)
        )
        self._middle_rad = angles_rad
        return read, tuple(name for name, fault in zip(self._middle, faults, strict=True) if fault)


def _list_faulty(faults: list[float]) -> tuple[str, ...]:
    return tuple(name for name, fault in zip(WHEEL_NAMES, faults, strict=True) if fault)
