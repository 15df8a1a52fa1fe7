"""Faults of what feels the robot's own motion: magnetometer, IMU, encoders; and of its devices."""

from __future__ import annotations

import math
from collections import deque

import msgspec
import numpy as np

from agribot.core.messages import (
    WHEEL_NAMES,
    BatterySample,
    BumperSample,
    CameraFrame,
    ImuSample,
    MagSample,
    SensorBatch,
    Vec3,
    WheelSample,
)
from agribot.sim.faults.schedule import ROUNDING_S, Fault
from agribot.sim.sensors.battery import EMPTY_V, FULL_V

MOTOR_T_PER_NM = 2e-6  # near a motor; the presets have 0.4 uT, a mast away
EMPTY_RATIO = 0.05


class MotorField:
    """The field of motor currents at the magnetometer, in proportion to the torque."""

    def __init__(self, fault: Fault, rng: np.random.Generator) -> None:
        self._fault = fault
        axis = rng.standard_normal(3)
        self._t_per_nm = MOTOR_T_PER_NM * axis / np.linalg.norm(axis)
        self._torque_nm = 0.0

    def alter(self, batch: SensorBatch) -> SensorBatch:
        for sample in batch.wheels:
            self._torque_nm = sum(map(abs, sample.effort_nm or ()))
        x, y, z = (self._torque_nm * self._t_per_nm).tolist()
        return _add_field(batch, self._fault, (x, y, z))


class Magnet:
    """A field that turns with the robot, level with it."""

    def __init__(self, fault: Fault, rng: np.random.Generator) -> None:
        self._fault = fault
        direction_rad = float(rng.uniform(-math.pi, math.pi))
        self._ahead, self._left = math.cos(direction_rad), math.sin(direction_rad)

    def alter(self, batch: SensorBatch) -> SensorBatch:
        size_t = 1e-6 * self._fault.find_number(batch.t_s)
        return _add_field(batch, self._fault, (size_t * self._ahead, size_t * self._left, 0.0))


def _add_field(batch: SensorBatch, fault: Fault, more_t: Vec3) -> SensorBatch:
    def add(sample: MagSample) -> MagSample:
        x, y, z = sample.field_t
        field_t = x + more_t[0], y + more_t[1], z + more_t[2]
        return msgspec.structs.replace(sample, field_t=field_t)

    mag = tuple(add(sample) if fault.is_on(sample.t_s) else sample for sample in batch.mag)
    return msgspec.structs.replace(batch, mag=mag)


class GyroBias:
    """A yaw rate that is not there."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault

    def alter(self, batch: SensorBatch) -> SensorBatch:
        imu = tuple(self._turn(s) if self._fault.is_on(s.t_s) else s for s in batch.imu)
        return msgspec.structs.replace(batch, imu=imu)

    def _turn(self, sample: ImuSample) -> ImuSample:
        x, y, z = sample.gyro_radps
        return msgspec.structs.replace(
            sample, gyro_radps=(x, y, z + self._fault.find_number(sample.t_s))
        )


class FrozenImu:
    """The last numbers again and again."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._last: ImuSample | None = None

    def alter(self, batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, imu=tuple(map(self._hold, batch.imu)))

    def _hold(self, sample: ImuSample) -> ImuSample:
        if self._last is None or not self._fault.is_on(sample.t_s):
            self._last = sample
        return msgspec.structs.replace(self._last, t_s=sample.t_s)


class Late:
    """Samples of one sensor that arrive late, in their order; at the fault's end all at once."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._waiting: deque[ImuSample | CameraFrame] = deque()

    def alter(self, batch: SensorBatch) -> SensorBatch:
        field = "imu" if self._fault.kind.part == "imu" else "frames"
        arrived: list[ImuSample | CameraFrame] = []
        for sample in getattr(batch, field):
            if self._fault.is_on(sample.t_s):
                self._waiting.append(sample)
            else:
                arrived.append(sample)
        due: list[ImuSample | CameraFrame] = []
        is_over = not self._fault.is_on(batch.t_s)
        while self._waiting and (is_over or self._is_due(batch.t_s)):
            due.append(self._waiting.popleft())
        return msgspec.structs.replace(batch, **{field: (*due, *arrived)})

    def _is_due(self, now_s: float) -> bool:
        return self._waiting[0].t_s + self._fault.find_number(now_s) <= now_s + ROUNDING_S


class Miscount:
    """Encoders that count a part of the truth, or against it: `ratios` of the four wheels.

    What was counted wrongly stays in the angles when the fault ends.
    """

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._ratios = [
            -1.0 if not fault.wheel else float(name != fault.wheel) for name in WHEEL_NAMES
        ]
        self._true: list[float] | None = None
        self._off = [0.0] * 4

    def alter(self, batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, wheels=tuple(map(self._count, batch.wheels)))

    def _count(self, sample: WheelSample) -> WheelSample:
        true = list(sample.angle_rad)
        before, self._true = self._true or true, true
        speeds = sample.speed_radps
        if self._fault.is_on(sample.t_s):
            for k, ratio in enumerate(self._ratios):
                self._off[k] += (ratio - 1.0) * (true[k] - before[k])
            a, b, c, d = (v * ratio for v, ratio in zip(speeds, self._ratios, strict=True))
            speeds = a, b, c, d
        if not any(self._off):
            return msgspec.structs.replace(sample, speed_radps=speeds)
        a, b, c, d = (angle + off for angle, off in zip(true, self._off, strict=True))
        return msgspec.structs.replace(sample, angle_rad=(a, b, c, d), speed_radps=speeds)


class EmptyBattery:
    """A charge of 5 %, and the open-circuit voltage that belongs to it."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault

    def alter(self, batch: SensorBatch) -> SensorBatch:
        battery = tuple(self._drain(s) if self._fault.is_on(s.t_s) else s for s in batch.battery)
        return msgspec.structs.replace(batch, battery=battery)

    def _drain(self, sample: BatterySample) -> BatterySample:
        lost_ratio = max(sample.charge_ratio - EMPTY_RATIO, 0.0)
        return msgspec.structs.replace(
            sample,
            charge_ratio=sample.charge_ratio - lost_ratio,
            voltage_v=sample.voltage_v - lost_ratio * (FULL_V - EMPTY_V),
        )


class Touch:
    """The bumper in front closes, in every tick."""

    def __init__(self, fault: Fault, front_m: float) -> None:
        self._fault, self._front_m = fault, front_m

    def alter(self, batch: SensorBatch) -> SensorBatch:
        if not self._fault.is_on(batch.t_s):
            return batch
        touch = BumperSample(t_s=batch.t_s, x_body_m=self._front_m, y_body_m=0.0)
        return msgspec.structs.replace(batch, bumper=(*batch.bumper, touch))
