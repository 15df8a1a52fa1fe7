"""Calibrate height, pitch and roll of a camera from pictures of rows whose distance is known."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from agribot.app.calibration.advice import format_advice
from agribot.app.calibration.recorded_robot import read_measured_robot
from agribot.app.run_recording import find_recording
from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.far_row_line import measure_far_contrast
from agribot.autonomy.perceive.pictures import Classifier, classify
from agribot.autonomy.perceive.row_mount import RowMountFit, fit_row_mount
from agribot.core import topics
from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError
from agribot.core.geo import rpy_from_rotation
from agribot.core.messages import ByteArray
from agribot.core.robot import CameraSpec, RobotSpec
from agribot.record.mcap_file import read_messages
from agribot.record.picture_files import read_pictures
from agribot.record.replay import read_config
from agribot.ros.messages.rosmsg import read_compressed_image

Item = TypeVar("Item")

PICTURE_ENDINGS = (".jpg", ".jpeg", ".png")
MOST_PICTURES = 48  # looked at, evenly over all
# Tolerance between the width to height ratios of pictures and of the described camera.
SHAPE_TOLERANCE = 0.02


class RowMountResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result as printed by --json; `settings` are for `agribot run --set`."""

    ok: bool
    reasons: tuple[str, ...]
    fit: RowMountFit
    settings: tuple[str, ...]


def list_pictures(folder: Path) -> list[Path]:
    """List the pictures of a folder by name, at most MOST_PICTURES of them, evenly.

    Raises: ConfigError: there is no picture.
    """
    found = []
    if folder.is_dir():
        found = sorted(p for p in folder.iterdir() if p.suffix.lower() in PICTURE_ENDINGS)
    if not found:
        raise ConfigError(
            f"--pictures {folder}: holds no pictures ({', '.join(PICTURE_ENDINGS)}); give the "
            "folder of photographs that the camera took along rows"
        )
    return choose_evenly(found)


def choose_evenly(items: Sequence[Item]) -> list[Item]:
    """Choose at most MOST_PICTURES of items, evenly."""
    count = min(len(items), MOST_PICTURES)
    return [items[k * len(items) // count] for k in range(count)]


def open_recording(path: Path) -> tuple[RobotSpec, RunConfig, list[ByteArray]]:
    """Read the robot, the settings and pictures of a recording.

    Raises: ConfigError: it holds no pictures; RecordingError: it cannot be read.
    """
    found = find_recording(path)
    config = read_config(found)
    robot = read_measured_robot(found, config)
    count = sum(1 for _ in read_messages(found, topics.IMAGE))
    if not count:
        raise ConfigError(
            f"{found}: holds no pictures; record them with --set record.image_rate_hz=1, or give "
            "--pictures DIR"
        )
    wanted = set(choose_evenly(range(count)))
    messages = enumerate(read_messages(found, topics.IMAGE))
    jpegs = (read_compressed_image(message.data) for k, message in messages if k in wanted)
    return robot, config, list(read_pictures(map(io.BytesIO, jpegs)))


def fit_camera_spec(
    described: CameraSpec | None, shape: tuple[int, ...], lens_rad: float | None
) -> CameraSpec:
    """Make the camera of pictures (H, W, ...) from the described one, or from a lens' width.

    Raises: ConfigError: neither says how wide the pictures look.
    """
    height_px, width_px = shape[:2]
    if lens_rad is not None:
        return CameraSpec(
            link="camera", width_px=width_px, height_px=height_px, hfov_rad=lens_rad, rate_hz=1.0,
            noise_std=0.0, clip_near_m=0.01, clip_far_m=100.0,
        )  # fmt: skip
    if described is None:
        raise ConfigError("the robot's description has no camera; give --lens-deg")
    ratio = (width_px / height_px) / (described.width_px / described.height_px)
    if abs(ratio - 1.0) > SHAPE_TOLERANCE:
        raise ConfigError(
            f"pictures are {width_px} x {height_px} px, the robot's camera has "
            f"{described.width_px} x {described.height_px}, another shape; give --lens-deg, the "
            "horizontal angle of the lens that took them"
        )
    return described


def calibrate_row_mount(
    pictures: Iterable[ByteArray],
    network: Classifier,
    robot: RobotSpec,
    spacing_m: float,
    lens_rad: float | None,
) -> RowMountResult:
    """Fit the mount to pictures (H, W, 3) of one camera, of rows `spacing_m` apart.

    Raises: ConfigError: the camera is not known, or pictures are of several sizes.
    """
    contrasts, shape, camera = [], None, None
    for image_rgb in pictures:
        if shape not in (None, image_rgb.shape):
            raise ConfigError(
                f"pictures are of several sizes, {shape} and {image_rgb.shape}; give those of one "
                "camera"
            )
        shape = image_rgb.shape
        camera = camera or fit_camera_spec(robot.camera, shape, lens_rad)
        seen = classify(network, image_rgb)
        class_map = ClassMap(
            class_id=seen.class_id, confidence=seen.confidence, scale_px=(1.0, 1.0)
        )
        contrasts.append(measure_far_contrast(class_map, image_rgb))
    if camera is None:
        raise ConfigError("no pictures; give some that show rows to the horizon")
    fit = fit_row_mount(contrasts, camera, spacing_m, np.random.default_rng(0))
    reasons = fit.complaints()
    return RowMountResult(
        ok=not reasons, reasons=reasons, fit=fit, settings=_make_settings(fit, robot)
    )


def _make_settings(fit: RowMountFit, robot: RobotSpec) -> tuple[str, ...]:
    """Set what was found; what does not show stays as described."""
    roll_rad, yaw_rad = 0.0, 0.0
    if robot.camera is not None:
        roll_rad, _, yaw_rad = rpy_from_rotation(robot.base_from_link(robot.camera.link)[:3, :3])
    roll_rad = roll_rad if fit.roll_rad is None else fit.roll_rad
    rpy = ",".join(f"{value:.5f}" for value in (roll_rad, fit.pitch_rad, yaw_rad))
    return (
        f"calibration.camera_height_m={fit.height_m:.4f}",
        f"calibration.camera_rpy_rad=[{rpy}]",
    )


def format_row_mount(result: RowMountResult) -> str:
    """Write the result for a person."""
    fit = result.fit
    roll = "does not show in these pictures, and stays as described"
    if fit.roll_rad is not None:
        roll = f"{math.degrees(fit.roll_rad):+.1f} +- {math.degrees(fit.roll_std_rad):.1f} deg"
    lines = [
        f"{fit.pictures} pictures, each tilted by {math.degrees(fit.tilt_std_rad):.1f} deg against "
        "the others",
        f"the camera looks down by {math.degrees(fit.pitch_rad):.1f} +- "
        f"{math.degrees(fit.pitch_std_rad):.1f} deg",
        f"it is {fit.height_m:.2f} +- {fit.height_std_m:.2f} m over the ground",
        f"its roll: {roll}",
        *format_advice(result.settings, result.reasons),
    ]
    return "\n".join(lines) + "\n"
