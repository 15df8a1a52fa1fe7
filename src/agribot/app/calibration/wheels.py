"""Rolling radius and effective separation of the wheels from driving a figure."""

from __future__ import annotations

import msgspec

from agribot.app.calibration.advice import format_advice
from agribot.app.calibration.drive_fit import DriveFit
from agribot.app.calibration.figure import Gain
from agribot.app.calibration.measured_robot import MOST_RADIUS_RATIO, MOST_YAW_RATIO
from agribot.core.robot import DriveSpec


class WheelsResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result as printed by --json; `settings` are for `agribot run --set`.

    `*_off_ratio` is fitted over described, minus one.
    """

    ok: bool
    reasons: tuple[str, ...]
    fit: DriveFit
    yaw_multiplier: float
    yaw_multiplier_std: float
    described_wheel_radius_m: float
    described_yaw_multiplier: float
    wheel_radius_off_ratio: float
    yaw_multiplier_off_ratio: float
    described_gain: Gain
    original_gain: Gain
    settings: tuple[str, ...]


def yaw_multiplier(drive: DriveSpec, fit: DriveFit) -> tuple[float, float]:
    """Compute the effective separation over the track, and its sigma."""
    return fit.separation_m / drive.track_m, fit.separation_std_m / drive.track_m


def make_wheel_settings(drive: DriveSpec, fit: DriveFit) -> tuple[str, ...]:
    multiplier, _ = yaw_multiplier(drive, fit)
    return (
        f"calibration.wheel_radius_m={fit.wheel_radius_m:.5f}",
        f"calibration.yaw_multiplier={multiplier:.4f}",
    )


def list_complaints(drive: DriveSpec, fit: DriveFit) -> tuple[str, ...]:
    """List why a fit must not be used; no run would begin with wheels that are no such robot's."""
    multiplier, _ = yaw_multiplier(drive, fit)
    found = []
    for what, value, described, most in (
        ("wheel radius", fit.wheel_radius_m, drive.wheel_radius_m, MOST_RADIUS_RATIO),
        ("yaw multiplier", multiplier, drive.yaw_multiplier, MOST_YAW_RATIO),
    ):
        if not 1.0 / most <= value / described <= most:
            found.append(
                f"the {what} would be {value:.4f}, {value / described:.2f} times the "
                f"{described:.4f} of the description, and at most {most:g} times more or less "
                "can be: look for wheels that spin or stand, encoders of another resolution, or "
                "another robot's description"
            )
    return (*fit.complaints(), *found)


def assess_wheels(drive: DriveSpec, fit: DriveFit, described: Gain, original: Gain) -> WheelsResult:
    """Compare the fit with the description."""
    multiplier, multiplier_std = yaw_multiplier(drive, fit)
    reasons = list_complaints(drive, fit)
    return WheelsResult(
        ok=not reasons,
        reasons=reasons,
        fit=fit,
        yaw_multiplier=multiplier,
        yaw_multiplier_std=multiplier_std,
        described_wheel_radius_m=drive.wheel_radius_m,
        described_yaw_multiplier=drive.yaw_multiplier,
        wheel_radius_off_ratio=fit.wheel_radius_m / drive.wheel_radius_m - 1.0,
        yaw_multiplier_off_ratio=multiplier / drive.yaw_multiplier - 1.0,
        described_gain=described,
        original_gain=original,
        settings=make_wheel_settings(drive, fit),
    )


def format_wheels(drive: DriveSpec, result: WheelsResult) -> str:
    fit = result.fit
    lines = [
        "                 fitted     1 sigma   described  off by",
        _format_line(
            "wheel radius", fit.wheel_radius_m, fit.wheel_radius_std_m, drive.wheel_radius_m
        ),
        _format_line(
            "separation", fit.separation_m, fit.separation_std_m, drive.effective_separation_m
        ),
        _format_line(
            "yaw multiplier", result.yaw_multiplier, result.yaw_multiplier_std,
            drive.yaw_multiplier,
        ),
        _format_line("gyro scale", fit.gyro_scale, fit.gyro_scale_std, 1.0),
        f"reached / commanded, as described: speed {result.described_gain.speed:.3f}, "
        f"yaw rate {result.described_gain.yaw_rate:.3f}",
        f"reached / commanded, as set:       speed {result.original_gain.speed:.3f}, "
        f"yaw rate {result.original_gain.yaw_rate:.3f}",
    ]  # fmt: skip
    described = (
        "or set in the xacro files of the robot:",
        f'  <xacro:property name="wheel_radius" value="{fit.wheel_radius_m:.4f}"/>',
        f'  <xacro:property name="yaw_multiplier" value="{result.yaw_multiplier:.3f}"/>',
    )
    lines += format_advice(result.settings, result.reasons, described)
    return "\n".join(lines) + "\n"


def _format_line(name: str, value: float, std: float, described: float) -> str:
    return (
        f"{name:15} {value:8.4f}  +-{std:8.4f}  {described:8.4f}  {value / described - 1.0:+7.1%}"
    )
