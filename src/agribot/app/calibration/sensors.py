"""Calibrate the magnetometer and the GNSS antenna from a turn on the spot."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.app.calibration.advice import format_advice
from agribot.app.calibration.antenna_fit import AntennaFit, fit_antenna
from agribot.app.calibration.drive_log import DriveLog
from agribot.app.calibration.figure import DriveSamples
from agribot.autonomy.estimate.sensors.compass import level_field, yaw_of
from agribot.autonomy.estimate.sensors.mag_fit import (
    SECTORS,
    MagCalibration,
    MagFit,
    MagFitted,
    sector_of,
)
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import NoEllipse, NoMagnetometer
from agribot.core.messages import FloatArray, SensorBatch, Vec3
from agribot.core.robot import RobotSpec
from agribot.record.replay import read_config, read_ticks

GRAVITY_SHARE = 0.02  # share of one accelerometer reading in the direction of up


class MagResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result as printed by --json; `settings` are for `agribot run --set`."""

    ok: bool
    reasons: tuple[str, ...]
    fit: MagFitted
    settings: tuple[str, ...]


class AntennaResult(msgspec.Struct, frozen=True, kw_only=True):
    ok: bool
    reasons: tuple[str, ...]
    fit: AntennaFit
    described_x_m: float
    described_y_m: float
    settings: tuple[str, ...]


def calibrate_magnetometer(driven: DriveSamples, declination_rad: float) -> MagResult:
    """Fit with headings by the gyro from the start: the ellipse needs no others."""
    log = DriveLog(driven.batches, driven.stretches)
    start_s = driven.stretches[0].start_s
    headings = ((batch, log.turned_rad(start_s, batch.t_s)) for batch in driven.batches)
    return _fit_headings(headings, declination_rad)


def calibrate_recorded_magnetometer(path: Path) -> MagResult:
    """Fit with the estimated headings of a mission; one with headland turns has enough."""
    config: RunConfig = read_config(path)
    headings = (
        (tick.batch, tick.estimate.yaw_map_rad) for tick in read_ticks(path) if tick.estimate.ok
    )
    return _fit_headings(headings, math.radians(config.field.declination_deg or 0.0))


def _fit_headings(
    headings: Iterable[tuple[SensorBatch, float]], declination_rad: float
) -> MagResult:
    fit, up = MagFit(), np.array([0.0, 0.0, 1.0])
    for batch, yaw_rad in headings:
        for imu in batch.imu:
            if imu.accel_mps2 is None:
                continue
            up = (1.0 - GRAVITY_SHARE) * up + GRAVITY_SHARE * np.array(imu.accel_mps2) / 9.81
        x, y, z = (up / np.linalg.norm(up)).tolist()
        up_body: Vec3 = (x, y, z)
        for sample in batch.mag:
            level_t = level_field(sample.field_t, up_body)
            if level_t is not None:
                fit.add(level_t, math.pi / 2.0 - declination_rad - yaw_rad)
    fitted = fit.solve()
    if not fit.count:
        raise MissionError(NoMagnetometer())
    if fitted is None:
        raise MissionError(NoEllipse(fit.count, fit.sectors))
    iron, reasons = fitted.calibration, fitted.complaints()
    offset = ",".join(f"{value:.3e}" for value in iron.offset_t)
    shape = ",".join(f"{value:.4f}" for value in iron.shape)
    settings = (f"estimate.mag_offset_t=[{offset}]", f"estimate.mag_shape=[{shape}]")
    return MagResult(ok=not reasons, reasons=reasons, fit=fitted, settings=settings)


class CompassErrors(NamedTuple):
    """Errors of single readings against the gyro, (N,), without their common part."""

    turned_rad: FloatArray
    error_rad: FloatArray

    @property
    def scatter_rad(self) -> float:
        """1 sigma."""
        return float(np.sqrt(np.mean(self.error_rad**2)))

    def by_direction(self) -> tuple[float | None, ...]:
        """Average in each direction, radians; None where there was no reading."""
        sectors = np.array([sector_of(math.pi / 2.0 - yaw_rad) for yaw_rad in self.turned_rad])
        means = (self.error_rad[sectors == index] for index in range(SECTORS))
        return tuple(float(of.mean()) if len(of) else None for of in means)


def measure_compass_errors(driven: DriveSamples, iron: MagCalibration) -> CompassErrors:
    log, start_s = DriveLog(driven.batches, driven.stretches), driven.stretches[0].start_s
    samples = [sample for batch in driven.batches for sample in batch.mag]
    turned_rad = np.array([log.turned_rad(start_s, sample.t_s) for sample in samples])
    seen_rad = [yaw_of(iron.correct(sample.field_t[:2]), 0.0) for sample in samples]
    unit = np.exp(1j * (np.array(seen_rad) - turned_rad))
    error_rad: FloatArray = np.angle(unit / np.mean(unit))
    return CompassErrors(turned_rad, error_rad)


def calibrate_antenna(driven: DriveSamples, robot: RobotSpec) -> AntennaResult:
    fit = fit_antenna(DriveLog(driven.batches, driven.stretches), driven.stretches)
    x_m, y_m, _ = robot.body_from_link(robot.gnss.link)[:3, 3].tolist()
    reasons = fit.complaints()
    return AntennaResult(
        ok=not reasons,
        reasons=reasons,
        fit=fit,
        described_x_m=x_m,
        described_y_m=y_m,
        settings=(f"calibration.antenna_m=[{fit.x_m:.4f},{fit.y_m:.4f}]",),
    )


def format_magnetometer(result: MagResult) -> str:
    fit = result.fit
    lines = [
        f"field {fit.field_t * 1e6:.1f} uT, hard iron "
        f"{math.hypot(*fit.calibration.offset_t) / fit.field_t:.1%} of it, ellipse "
        f"{fit.calibration.shape}",
        f"headings good to {math.degrees(fit.std_rad):.2f} degrees, single readings scatter by "
        f"{math.degrees(fit.scatter_rad):.2f}, {fit.sectors} of 36 directions seen",
    ]
    return "\n".join([*lines, *format_advice(result.settings, result.reasons)]) + "\n"


def format_antenna(result: AntennaResult) -> str:
    fit = result.fit
    lines = [
        f"antenna {fit.x_m:+.3f} m ahead and {fit.y_m:+.3f} m left of the turning centre, "
        f"+-{fit.std_m:.3f} m, from {fit.fixes} fixes that scatter by {fit.scatter_m:.3f} m",
        f"described: {result.described_x_m:+.3f} m ahead, {result.described_y_m:+.3f} m left",
    ]
    described = ("or set the origin of the antenna's joint in the robot's xacro files",)
    lines += format_advice(result.settings, result.reasons, described)
    return "\n".join(lines) + "\n"
