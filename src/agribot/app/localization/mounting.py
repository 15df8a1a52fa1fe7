"""How the IMU of a log is mounted, and where its antenna is: stated, by fixed frames, or found."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec
import numpy as np

from agribot.app.localization.imu_mount import AGREE_RAD, LEAST_GRAVITY_MPS2, ImuMount
from agribot.app.localization.log_scan import LogScan
from agribot.core.errors import ConfigError, RecordingError
from agribot.core.geo import rotation_from_rpy, rpy_from_rotation
from agribot.core.messages import FloatArray, Vec3
from agribot.record.frames_path import BASE_FRAMES, MAX_DEPTH

Frames = Mapping[str, tuple[str, FloatArray]]


def choose_mount(scan: LogScan, rpy_deg: Vec3 | None, frames: Frames, notes: list[str]) -> ImuMount:
    """Choose the stated mount, that of the frames, or the one that was found.

    Raises: ConfigError: the stated one contradicts gravity. RecordingError: nothing shows it.
    """
    found = scan.mount.solve()
    if rpy_deg is not None:
        return _take_stated(rpy_deg, found, scan)
    frame = scan.main_frame("imu")
    pose = find_in_base(frames, frame)
    if pose is not None:
        mount = _keep_found(ImuMount(body_from_imu=pose[:3, :3], how=f"frame {frame}"), found)
        off_rad = find_tilt(mount, scan)
        if off_rad < AGREE_RAD or found is None:
            notes += _compare_forward(mount, found, frame)
            return mount
        notes.append(
            f"IMU: by the frame {frame} it lies {math.degrees(off_rad):.0f} degrees off gravity; "
            "the frame is not used"
        )
    if found is None:
        raise RecordingError(
            "IMU: neither gravity nor turns show how it is mounted; state it with --imu-rpy-deg"
        )
    return found


def _take_stated(rpy_deg: Vec3, found: ImuMount | None, scan: LogScan) -> ImuMount:
    body_from_imu = rotation_from_rpy(*(math.radians(angle) for angle in rpy_deg))
    mount = _keep_found(ImuMount(body_from_imu=body_from_imu, how="as stated"), found)
    off_rad = find_tilt(mount, scan)
    if found is None or off_rad < AGREE_RAD:
        return mount
    text = ",".join(f"{angle:g}" for angle in rpy_deg)
    raise ConfigError(
        f"--imu-rpy-deg {text}: gravity then lies {math.degrees(off_rad):.0f} degrees off the "
        f"vertical; by the log it is {format_rpy(found)}, or leave the option out"
    )


def _compare_forward(mount: ImuMount, found: ImuMount | None, frame: str) -> list[str]:
    """Say where accelerations contradict a frame about the vertical."""
    if found is None or not found.has_heading:
        return []
    cosine = float(mount.body_from_imu[0] @ found.body_from_imu[0])
    if cosine > math.cos(math.radians(45.0)):
        return []
    off_deg = math.degrees(math.acos(max(cosine, -1.0)))
    return [
        f"IMU: by the frame {frame} forward lies {off_deg:.0f} degrees off that of the wheels' "
        f"accelerations ({found.axes}); turns are right, roll and pitch may not be"
    ]


def choose_mag_mount(scan: LogScan, mount: ImuMount, frames: Frames, notes: list[str]) -> ImuMount:
    """Choose the mount of a magnetometer: that of its frame, else the IMU's."""
    frame = scan.main_frame("mag")
    pose = find_in_base(frames, frame)
    if pose is not None:
        return ImuMount(body_from_imu=pose[:3, :3], how=f"frame {frame}")
    if "mag" in scan.sensors and frame != scan.main_frame("imu"):
        notes.append("magnetometer: it is taken to be mounted as the IMU is")
    return mount


def _keep_found(mount: ImuMount, found: ImuMount | None) -> ImuMount:
    """Take over what a log shows of an IMU whose mount is known."""
    if found is None:
        return mount
    return msgspec.structs.replace(
        mount,
        has_gravity=found.has_gravity,
        accel_sign=found.accel_sign,
        turn_gain=found.turn_gain,
        apart_rad=found.apart_rad,
    )


def find_tilt(mount: ImuMount, scan: LogScan) -> float:
    """Find the angle between mean acceleration and vertical, rad; 0 without gravity."""
    gravity = mount.accel_sign * scan.mount.gravity_mps2
    size = float(np.linalg.norm(gravity))
    if size < LEAST_GRAVITY_MPS2:
        return 0.0
    return math.acos(max(-1.0, min(1.0, float(mount.body_from_imu[2] @ gravity) / size)))


def format_rpy(mount: ImuMount) -> str:
    """Write a mount as --imu-rpy-deg takes it."""
    angles = (math.degrees(angle) for angle in rpy_from_rotation(mount.body_from_imu))
    return ",".join(f"{round(angle, 1) + 0.0:g}" for angle in angles)


def find_in_base(frames: Frames, frame: str) -> FloatArray | None:
    """Find `base_from_frame` (4, 4) of a frame that hangs on the robot's base; None otherwise."""
    base_from_frame = np.eye(4)
    if frame in BASE_FRAMES:
        return base_from_frame if frames else None
    for _ in range(MAX_DEPTH):
        if frame not in frames:
            return None
        frame, parent_from_frame = frames[frame]
        base_from_frame = parent_from_frame @ base_from_frame
        if frame in BASE_FRAMES:
            return base_from_frame
    return None


def list_mount_notes(mount: ImuMount) -> list[str]:
    """List what is not known of a mount."""
    notes = []
    if not mount.has_heading:
        notes.append(
            "IMU: its angle about the vertical is not known, so that slopes are taken for level "
            "ground askew; turns are right; state --imu-rpy-deg"
        )
    if mount.apart_rad > AGREE_RAD:
        notes.append(
            f"IMU: the gyro turns about an axis {math.degrees(mount.apart_rad):.0f} degrees off "
            "gravity; its gyro and its accelerometer have other axes, or the odometry's yaw rate "
            "is wrong"
        )
    if mount.accel_sign < 0.0:
        notes.append(
            "IMU: its acceleration points down at rest, against the turns of the wheels; it is "
            "taken with the other sign"
        )
    return notes
