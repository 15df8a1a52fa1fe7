"""Log samples as the batches that the robot's filter takes, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from agribot.app.localization.imu_mount import ImuMount
from agribot.app.localization.log import LogEntry, TwistSample
from agribot.core.messages import (
    BaseFix,
    GnssFix,
    GnssHeading,
    ImuSample,
    MagSample,
    SensorBatch,
    Vec3,
    WheelSample,
)
from agribot.core.robot import DriveSpec

TICK_S = 0.02
# A gap of the odometry over which its last speed says nothing, s.
LONGEST_STEP_S = 1.0
_FIELDS: dict[type, str] = {
    GnssFix: "gnss", GnssHeading: "headings", BaseFix: "base", ImuSample: "imu", MagSample: "mag",
    WheelSample: "wheels",
}  # fmt: skip


class TwistWheels:
    """Wheels that turn as a base says it moves: their angles are its speeds summed up."""

    def __init__(self, drive: DriveSpec) -> None:
        self._drive = drive
        self._left_rad = self._right_rad = 0.0
        self._last: tuple[float, float, float] | None = None

    def turn(self, t_s: float, sample: TwistSample) -> WheelSample:
        left, right = self._drive.wheel_speeds_radps(sample.v_mps, sample.yaw_rate_radps)
        if self._last is not None and 0.0 < t_s - self._last[0] < LONGEST_STEP_S:
            last_s, last_left, last_right = self._last
            self._left_rad += (left + last_left) / 2.0 * (t_s - last_s)
            self._right_rad += (right + last_right) / 2.0 * (t_s - last_s)
        self._last = t_s, left, right
        angles = (self._right_rad, self._left_rad, self._right_rad, self._left_rad)
        return WheelSample(t_s=t_s, angle_rad=angles, speed_radps=(right, left, right, left))


def make_batches(
    entries: Iterable[LogEntry],
    start_s: float,
    mounts: tuple[ImuMount, ImuMount],
    drive: DriveSpec,
) -> Iterator[SensorBatch]:
    """Make the batches of all ticks with samples, in body axes, times from `start_s` on.

    `mounts` are those of IMU and magnetometer.
    """
    wheels = TwistWheels(drive)
    waiting: dict[str, list[Any]] = {}
    tick = 0
    for entry in entries:
        if entry.sample is None:
            continue
        t_s = entry.stamp_s - start_s
        due = math.ceil(t_s / TICK_S)
        if due > tick and waiting:
            yield _make_batch(tick, waiting)
            waiting = {}
        tick = max(tick, due)
        sample = _place(entry.sample, t_s, mounts, wheels)
        waiting.setdefault(_FIELDS[type(sample)], []).append(sample)
    if waiting:
        yield _make_batch(tick, waiting)


def _make_batch(tick: int, samples: dict[str, list[Any]]) -> SensorBatch:
    parts: dict[str, Any] = {name: tuple(each) for name, each in samples.items()}
    return SensorBatch(t_s=tick * TICK_S, **parts)


def _place(
    sample: Any, t_s: float, mounts: tuple[ImuMount, ImuMount], wheels: TwistWheels
) -> msgspec.Struct:
    """Put a sample on the run's clock and into the body's axes."""
    if isinstance(sample, TwistSample):
        return wheels.turn(t_s, sample)
    mount, mag_mount = mounts
    if isinstance(sample, ImuSample):
        accel: Vec3 | None = None
        if sample.accel_mps2 is not None:
            x, y, z = mount.turn(sample.accel_mps2)
            accel = (x * mount.accel_sign, y * mount.accel_sign, z * mount.accel_sign)
        return ImuSample(t_s=t_s, gyro_radps=mount.turn(sample.gyro_radps), accel_mps2=accel)
    if isinstance(sample, MagSample):
        return MagSample(t_s=t_s, field_t=mag_mount.turn(sample.field_t))
    placed: msgspec.Struct = msgspec.structs.replace(sample, t_s=t_s)
    return placed
