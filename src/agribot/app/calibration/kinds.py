"""THE table of calibrations: what each one does, the figure it drives, and how it evaluates it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.app.calibration.camera import assess_row_view, calibrate_camera, observe_figure
from agribot.app.calibration.drive_fit import fit_drive
from agribot.app.calibration.drive_log import DriveLog
from agribot.app.calibration.figure import (
    ALONG_ROW,
    FIGURE,
    REST_S,
    SWINGING,
    TEST_RUN,
    TURNS,
    DriveSamples,
    FigureMotion,
)
from agribot.app.calibration.sensors import (
    calibrate_antenna,
    calibrate_magnetometer,
    measure_compass_errors,
)
from agribot.app.calibration.wheels import list_complaints, make_wheel_settings, yaw_multiplier
from agribot.autonomy.estimate.sensors.mag_fit import MagCalibration
from agribot.core.config import RunConfig
from agribot.core.geo import rpy_from_rotation
from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import RobotSpec

WHEEL_TOLERANCE_RATIO = 0.1  # tolerance of a wheel's speed against the commanded one


ByDirection = tuple[float | None, ...]


class Change(msgspec.Struct, frozen=True, kw_only=True):
    """One number before and after, as it is shown; None: not known."""

    label: str
    unit: str
    before: float | None
    after: float
    std: float | None = None


class CalibrationResult(msgspec.Struct, frozen=True, kw_only=True):
    """`settings` are of the form a.b=c; none where there is nothing to take over.

    `reasons` say why the result must not be used; empty where `ok`. `errors_deg` are those of the
    heading in 36 directions before and after, of a compass only.
    """

    ok: bool
    reasons: tuple[str, ...]
    changes: tuple[Change, ...]
    settings: tuple[str, ...] = ()
    errors_deg: tuple[ByDirection, ByDirection] | None = None


class Kind(NamedTuple):
    """`space_m` is the side of the free square that the figure needs, the robot in its middle."""

    name: str
    title: str
    about: str
    figure: Sequence[FigureMotion]
    space_m: float
    find: Callable[[DriveSamples, RobotSpec, RunConfig], CalibrationResult]
    # Whether it needs pictures of plants: the square is a field, with a row under the robot.
    needs_pictures: bool = False
    shows_directions: bool = False  # whether it shows the directions that the compass has seen

    def suits(self, *, has_compass: bool, has_camera: bool) -> bool:
        """Whether a robot with these devices can be calibrated so."""
        return (has_compass or not self.shows_directions) and (
            has_camera or not self.needs_pictures
        )

    @property
    def ground(self) -> str:
        """The ground that it needs, for people."""
        square = f"{self.space_m:g} m × {self.space_m:g} m of firm, level"
        if self.needs_pictures:
            return f"{square} field around it, and a crop row between its wheels and ahead"
        return f"{square}, free ground around it"

    @property
    def duration_s(self) -> float:
        rests = len(self.figure) + 1
        return sum(motion.duration_s for motion in self.figure) + rests * REST_S


def _find_wheels(driven: DriveSamples, robot: RobotSpec, _: RunConfig) -> CalibrationResult:
    fit, drive = fit_drive(driven.batches, driven.stretches), robot.drive
    multiplier, multiplier_std = yaw_multiplier(drive, fit)
    reasons = list_complaints(drive, fit)
    return CalibrationResult(
        ok=not reasons,
        reasons=reasons,
        changes=(
            Change(label="Wheel radius", unit="m", before=drive.wheel_radius_m,
                   after=fit.wheel_radius_m, std=fit.wheel_radius_std_m),
            Change(label="Effective separation", unit="m", before=drive.effective_separation_m,
                   after=fit.separation_m, std=fit.separation_std_m),
            Change(label="Yaw multiplier", unit="", before=drive.yaw_multiplier,
                   after=multiplier, std=multiplier_std),
            Change(label="Gyro scale, for information", unit="", before=1.0,
                   after=fit.gyro_scale, std=fit.gyro_scale_std),
        ),
        settings=make_wheel_settings(drive, fit),
    )  # fmt: skip


def _find_magnetometer(driven: DriveSamples, _: RobotSpec, config: RunConfig) -> CalibrationResult:
    result, believed = calibrate_magnetometer(driven, 0.0), config.estimate
    fitted = result.fit.calibration
    used = MagCalibration(offset_t=believed.mag_offset_t, shape=believed.mag_shape)
    before, after = (measure_compass_errors(driven, iron) for iron in (used, fitted))
    offsets = [
        Change(label=f"Hard iron {side}", unit="uT", before=before_t * 1e6, after=after_t * 1e6)
        for side, before_t, after_t in zip(
            ("ahead", "left"), used.offset_t, fitted.offset_t, strict=True
        )
    ]
    scatter = Change(
        label="Heading against the gyro, 1 sigma", unit="deg",
        before=math.degrees(before.scatter_rad), after=math.degrees(after.scatter_rad),
    )  # fmt: skip
    seen = Change(label="Directions seen, of 36", unit="", before=None, after=result.fit.sectors)
    return CalibrationResult(
        ok=result.ok,
        reasons=result.reasons,
        changes=(scatter, *offsets, seen),
        settings=result.settings,
        errors_deg=(_to_degrees(before.by_direction()), _to_degrees(after.by_direction())),
    )


def _to_degrees(angles_rad: Iterable[float | None]) -> ByDirection:
    return tuple(None if rad is None else math.degrees(rad) for rad in angles_rad)


def _find_antenna(driven: DriveSamples, robot: RobotSpec, _: RunConfig) -> CalibrationResult:
    result = calibrate_antenna(driven, robot)
    fit = result.fit
    return CalibrationResult(
        ok=result.ok,
        reasons=result.reasons,
        changes=(
            Change(label="Ahead of the turning centre", unit="m", before=result.described_x_m,
                   after=fit.x_m, std=fit.std_m),
            Change(label="Left of the turning centre", unit="m", before=result.described_y_m,
                   after=fit.y_m, std=fit.std_m),
        ),
        settings=result.settings,
    )  # fmt: skip


def _find_camera(driven: DriveSamples, robot: RobotSpec, config: RunConfig) -> CalibrationResult:
    result = calibrate_camera(observe_figure(driven, robot, config), one_way=True)
    fit, link = result.fit, robot.camera.link if robot.camera else ""
    before_rad = rpy_from_rotation(robot.base_from_link(link)[:3, :3])
    height_m = float(robot.body_from_link(link)[2, 3])
    turned = [
        Change(
            label=label,
            unit="deg",
            before=math.degrees(was_rad),
            after=math.degrees(rad),
            std=math.degrees(std_rad),
        )
        for label, was_rad, rad, std_rad in zip(
            ("Rolled right", "Pitched down", "Turned left"),
            before_rad,
            result.camera_rpy_rad,
            (fit.roll_std_rad, fit.pitch_std_rad, fit.yaw_std_rad),
            strict=True,
        )
    ]
    return CalibrationResult(
        ok=result.ok,
        reasons=result.reasons,
        changes=(
            *turned,
            Change(label="Height over the ground", unit="m", before=height_m,
                   after=height_m + fit.height_m, std=fit.height_std_m),
            Change(label="Plants seem to move by", unit="m", before=fit.scatter_before_m,
                   after=fit.scatter_m),
            Change(label="Plants followed", unit="", before=None, after=fit.tracks),
        ),
        settings=result.settings,
    )  # fmt: skip


def _find_row_view(driven: DriveSamples, robot: RobotSpec, config: RunConfig) -> CalibrationResult:
    """Compare with where the rows are; there is nothing to take over."""
    result = assess_row_view(observe_figure(driven, robot, config))
    fit = result.fit
    return CalibrationResult(
        ok=result.ok,
        reasons=result.reasons,
        changes=(
            Change(label="Rows seen aside by", unit="m", before=None, after=fit.offset_bias_m,
                   std=fit.offset_bias_std_m),
            Change(label="Rows seen turned by", unit="deg", before=None,
                   after=math.degrees(fit.heading_bias_rad),
                   std=math.degrees(fit.heading_bias_std_rad)),
            Change(label="Pictures with a row", unit="%", before=None,
                   after=100.0 * fit.lines / fit.pictures),
        ),
    )  # fmt: skip


def _find_motors(driven: DriveSamples, robot: RobotSpec, _: RunConfig) -> CalibrationResult:
    """Compare every wheel over the middle half of each leg with the command."""
    log, ratios = DriveLog(driven.batches, driven.stretches), []
    for motion, stretch in zip(TEST_RUN, driven.stretches, strict=True):
        quarter_s = (stretch.end_s - stretch.start_s) / 4.0
        rolled_rad = log.wheels_rad(stretch.start_s + quarter_s, stretch.end_s - quarter_s)
        commanded_rad = motion.v_mps / robot.drive.wheel_radius_m * 2.0 * quarter_s
        ratios.append(rolled_rad / commanded_rad)
    reached = np.array(ratios)  # (legs, wheels)
    worst = reached[np.abs(reached - 1.0).argmax(axis=0), range(len(WHEEL_NAMES))]
    names = [_name_wheel(name) for name in WHEEL_NAMES]
    reasons = tuple(
        f"the {name} wheel reached {ratio:.0%} of the speed commanded, not within "
        f"{WHEEL_TOLERANCE_RATIO:.0%} of it; check motor, driver, encoder and their cables"
        for name, ratio in zip(names, worst.tolist(), strict=True)
        if not abs(ratio - 1.0) <= WHEEL_TOLERANCE_RATIO
    )
    changes = tuple(
        Change(label=f"{name.capitalize()}, reached of commanded", unit="%", before=100.0,
               after=100.0 * ratio)
        for name, ratio in zip(names, worst.tolist(), strict=True)
    )  # fmt: skip
    return CalibrationResult(ok=not reasons, reasons=reasons, changes=changes)


def _name_wheel(wheel: str) -> str:
    side, _, end = wheel.partition("_wheel_")
    return f"{'front' if end == 'F' else 'rear'} {side}"


KINDS = {
    kind.name: kind
    for kind in (
        Kind("drive", "Wheels and turning",
             "Drives five straight legs of 4 m, two turns on the spot and two circles, and fits "
             "wheel radius and effective separation to GNSS and gyro.",
             FIGURE, 10.0, _find_wheels),
        Kind("magnetometer", "Compass",
             "Drives 4 m ahead, turns twice round to both sides and drives back; takes the "
             "robot's own iron out of the compass.",
             TURNS, 10.0, _find_magnetometer, shows_directions=True),
        Kind("antenna", "GNSS antenna",
             "Drives 4 m ahead, turns twice round to both sides and drives back; finds where the "
             "antenna sits. Needs a receiver with corrections.",
             TURNS, 10.0, _find_antenna),
        Kind("camera", "Camera's mount",
             "Drives 9 m along a crop row, swinging its nose to both sides, and back, twice; finds "
             "pitch, yaw, roll and height of the camera from plants that it sees again. Needs a "
             "receiver with corrections.",
             SWINGING, 18.0, _find_camera, needs_pictures=True),
        Kind("row-view", "Rows in the picture",
             "Drives 8 m along a dense row of the field and back, and compares where the camera "
             "sees the row with where it is. Needs a receiver with corrections. Changes nothing.",
             ALONG_ROW, 16.0, _find_row_view, needs_pictures=True),
        Kind("motors", "Motors",
             "Runs all wheels ahead and back for 1 m, with the robot jacked up or on free ground, "
             "and compares each with what was commanded. Changes nothing.",
             TEST_RUN, 4.0, _find_motors),
    )
}  # fmt: skip
