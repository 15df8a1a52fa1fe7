"""The figure that a calibration drives: straight legs, turns on the spot, arcs, and rests."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import msgspec

from agribot.errors import PlatformError
from agribot.estimate.drive_fit import DriveFit
from agribot.estimate.drive_log import DriveLog, Stretch
from agribot.messages import DriveCommand, RobotCommand, SensorBatch
from agribot.platform import Platform
from agribot.robot import DriveSpec

REST_S = 3.0
LEG_M, LEG_MPS = 4.0, 0.4
SPIN_RAD, SPIN_RADPS = 2.0 * math.tau, 0.8
ARC_RAD, ARC_MPS, ARC_RADPS = math.tau, 0.3, 0.4
# A motion that takes so much longer than commanded has failed; the told geometry needs 1.9.
PATIENCE = 4.0


class Motion(NamedTuple):
    """A command and how far it is held: metres by the wheels, or radians by the gyro."""

    name: str
    v_mps: float
    yaw_rate_radps: float
    travel: float

    @property
    def is_leg(self) -> bool:
        return self.yaw_rate_radps == 0.0


# Twice around to both sides, between legs that tell the heading by GNSS.
TURNS = (
    Motion("leg 1, ahead", LEG_MPS, 0.0, LEG_M),
    Motion("spin left", 0.0, SPIN_RADPS, SPIN_RAD),
    Motion("spin right", 0.0, -SPIN_RADPS, SPIN_RAD),
    Motion("leg 2, back", -LEG_MPS, 0.0, LEG_M),
)
# Turns to both sides cancel; a leg after each of them sees its angle by GNSS.
FIGURE = (
    Motion("leg 1, ahead", LEG_MPS, 0.0, LEG_M),
    Motion("spin left", 0.0, SPIN_RADPS, SPIN_RAD),
    Motion("leg 2, back", -LEG_MPS, 0.0, LEG_M),
    Motion("spin right", 0.0, -SPIN_RADPS, SPIN_RAD),
    Motion("leg 3, ahead", LEG_MPS, 0.0, LEG_M),
    Motion("arc left", ARC_MPS, ARC_RADPS, ARC_RAD),
    Motion("leg 4, back", -LEG_MPS, 0.0, LEG_M),
    Motion("arc right", ARC_MPS, -ARC_RADPS, ARC_RAD),
    Motion("leg 5, ahead", LEG_MPS, 0.0, LEG_M),
)


class Drive(NamedTuple):
    batches: list[SensorBatch]
    stretches: list[Stretch]


class Gain(msgspec.Struct, frozen=True, kw_only=True):
    """Speed and yaw rate that were reached, relative to what was commanded."""

    speed: float
    yaw_rate: float


Tape = Callable[[], tuple[float, float]]


def drive_figure(
    platform: Platform,
    drive: DriveSpec,
    tape: Tape | None = None,
    figure: Sequence[Motion] = FIGURE,
) -> Drive:
    """Drive a figure on any platform; `tape` tells a place, if somebody marks the legs' ends.

    Raises: PlatformError: a motion does not come to its end.
    """
    driven = Drive([], [])
    _hold(platform, driven, DriveCommand(), REST_S)
    for motion in figure:
        from_m = tape() if tape else (0.0, 0.0)
        start_s = driven.batches[-1].t_s
        _move(platform, driven, drive, motion)
        end_s = driven.batches[-1].t_s
        _hold(platform, driven, DriveCommand(), REST_S)
        to_m = tape() if tape else (0.0, 0.0)
        driven.stretches.append(
            Stretch(
                name=motion.name,
                start_s=start_s,
                end_s=end_s,
                is_leg=motion.is_leg,
                distance_m=math.dist(from_m, to_m) if tape and motion.is_leg else None,
            )
        )
    return driven


def gain(driven: Drive, fit: DriveFit) -> Gain:
    """Mean over the middle half of each leg and turn, by the fitted geometry and gyro."""
    log = DriveLog(driven.batches, driven.stretches)
    speeds, rates = [], []
    for motion, stretch in zip(FIGURE, driven.stretches, strict=True):
        quarter_s = (stretch.end_s - stretch.start_s) / 4.0
        between = stretch.start_s + quarter_s, stretch.end_s - quarter_s
        if motion.is_leg:
            rolled_m = fit.wheel_radius_m * log.rolled_rad(*between)[0]
            speeds.append(rolled_m / (motion.v_mps * 2.0 * quarter_s))
        else:
            turned_rad = fit.gyro_scale * log.turned_rad(*between)
            rates.append(turned_rad / (motion.yaw_rate_radps * 2.0 * quarter_s))
    return Gain(speed=sum(speeds) / len(speeds), yaw_rate=sum(rates) / len(rates))


def _hold(platform: Platform, driven: Drive, command: DriveCommand, seconds: float) -> None:
    end_s = seconds + (driven.batches[-1].t_s if driven.batches else 0.0)
    while not driven.batches or driven.batches[-1].t_s < end_s:
        _tick(platform, driven, command)


def _move(platform: Platform, driven: Drive, drive: DriveSpec, motion: Motion) -> None:
    command = DriveCommand(v_mps=motion.v_mps, yaw_rate_radps=motion.yaw_rate_radps)
    rate = abs(motion.v_mps if motion.is_leg else motion.yaw_rate_radps)
    limit_s = driven.batches[-1].t_s + PATIENCE * motion.travel / rate
    travelled, last_s = 0.0, driven.batches[-1].t_s
    while travelled < motion.travel:
        batch = _tick(platform, driven, command)
        dt_s, last_s = batch.t_s - last_s, batch.t_s
        if motion.is_leg and batch.wheels:
            mean_radps = sum(batch.wheels[-1].speed_radps) / 4.0
            travelled += abs(mean_radps) * drive.wheel_radius_m * dt_s
        elif batch.imu:
            mean_radps = sum(sample.gyro_radps[2] for sample in batch.imu) / len(batch.imu)
            travelled += abs(mean_radps) * dt_s
        if batch.t_s > limit_s:
            platform.write(RobotCommand(t_s=batch.t_s))
            raise PlatformError(
                f"'{motion.name}' got to {travelled:.2f} of {motion.travel:.2f} "
                f"{'m' if motion.is_leg else 'rad'} in {PATIENCE:g} times the time it needs; "
                "check motors, encoders and gyro, and that nothing stands in the way"
            )


def _tick(platform: Platform, driven: Drive, command: DriveCommand) -> SensorBatch:
    batch = platform.read()
    driven.batches.append(batch)
    platform.write(RobotCommand(t_s=batch.t_s, drive=command))
    return batch
