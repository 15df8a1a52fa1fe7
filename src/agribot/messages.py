"""Every value that crosses a layer. Immutable, SI units, the unit in the name.

Frames (REP-103, REP-105):
    map     local East-North-Up, metres, origin at the field datum.
    body    on the ground under the robot's centre: x forward, y left, z up.
    camera  optical: x right, y down, z forward.
Yaw is counter-clockwise from East, radians, in (-pi, pi].
`t_s` is the capture time on the platform clock, never the time a value was read.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Literal

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.devices import (
    BaseFix,
    BatterySample,
    BumperSample,
    CropCover,
    GnssHeading,
    RowLine,
)  # fmt: skip
from agribot.field_bounds import FieldBounds
from agribot.operator_input import HandDrive, OperatorAction, OperatorEvent

__all__ = ["HandDrive", "OperatorAction", "OperatorEvent"]

Vec3 = tuple[float, float, float]
Four = tuple[float, float, float, float]
FloatArray = npt.NDArray[np.float64]
ByteArray = npt.NDArray[np.uint8]

# The order of every four-wheel tuple: rear right, rear left, front right, front left.
WHEEL_NAMES = ("right_wheel_R", "left_wheel_R", "right_wheel_F", "left_wheel_F")


class PlantClass(IntEnum):
    """Class ids of masks and reports; colours red, green, blue."""

    WEED = 0
    CROP = 1
    SOIL = 2


class GnssQuality(IntEnum):
    """How a position was obtained; the numbers are those of NMEA GGA field 6."""

    NONE = 0
    SINGLE = 1
    DGNSS = 2
    RTK_FIXED = 4
    RTK_FLOAT = 5


# ---------------------------------------------------------------- sensors


class WheelSample(msgspec.Struct, frozen=True, kw_only=True):
    """Encoder reading of the four wheels, in the order of WHEEL_NAMES.

    A board may also tell the torque at the wheels, the speeds it wants, and disobedient wheels.
    """

    t_s: float
    angle_rad: Four
    speed_radps: Four
    effort_nm: Four | None = None
    target_radps: Four | None = None
    faults: tuple[str, ...] = ()


class ImuSample(msgspec.Struct, frozen=True, kw_only=True):
    """Body axes at the IMU. Acceleration is specific force: +9.8 upwards at rest (REP-145)."""

    t_s: float
    gyro_radps: Vec3
    accel_mps2: Vec3


class MagSample(msgspec.Struct, frozen=True, kw_only=True):
    """Magnetic field in body axes."""

    t_s: float
    field_t: Vec3


class GnssFix(msgspec.Struct, frozen=True, kw_only=True):
    """One epoch of a receiver, at its antenna.

    `pos_std_m` is the receiver's own 1 sigma per horizontal axis; `t_s` the measurement epoch
    (the fix arrives later). Velocity is East, North, Up, or None when the receiver gives none.
    """

    t_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    pos_std_m: float
    quality: GnssQuality
    velocity_mps: Vec3 | None = None
    velocity_std_mps: float = 0.1


class CameraFrame(msgspec.Struct, frozen=True, kw_only=True):
    """An image: (height, width, 3) uint8, red green blue, top row first."""

    t_s: float
    index: int
    image_rgb: ByteArray


class SensorBatch(msgspec.Struct, frozen=True, kw_only=True):
    """What arrived since the last tick, oldest first. A silent sensor is an empty tuple."""

    t_s: float
    wheels: tuple[WheelSample, ...] = ()
    imu: tuple[ImuSample, ...] = ()
    mag: tuple[MagSample, ...] = ()
    gnss: tuple[GnssFix, ...] = ()
    frames: tuple[CameraFrame, ...] = ()
    events: tuple[OperatorEvent, ...] = ()
    base: tuple[BaseFix, ...] = ()
    headings: tuple[GnssHeading, ...] = ()
    bumper: tuple[BumperSample, ...] = ()
    battery: tuple[BatterySample, ...] = ()
    hand: tuple[HandDrive, ...] = ()


# ---------------------------------------------------------------- perception


class GroundPlant(msgspec.Struct, frozen=True, kw_only=True):
    """One plant seen in one frame, projected on the ground plane of the body frame."""

    x_body_m: float
    y_body_m: float
    plant: PlantClass
    area_m2: float
    confidence: float
    std_m: float


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """What the network saw in the frame captured at `t_s`; usable from `ready_s` on.

    `view_body_m` is the ground polygon that the camera covered, so that a plant that should
    have been seen and was not can count against its track.
    """

    t_s: float
    ready_s: float
    frame_index: int
    plants: tuple[GroundPlant, ...]
    view_body_m: tuple[tuple[float, float], ...]
    class_ratio: Vec3 = (0.0, 0.0, 0.0)
    row_line: RowLine | None = None
    crop_cover: CropCover | None = None  # None: of a camera, or a recording, that tells none
    picture_crc32: int = 0  # of the picture's bytes; 0 where nobody worked it out


# ---------------------------------------------------------------- estimate, mission


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """Pose of the body in the map; `pose_cov` is the 3x3 covariance of x, y and yaw by rows.

    `ok` is False until the filter has a position and a heading, and again when inputs go
    silent; `reason` then says why, or what is wrong with a sensor that the pose does without.
    `protection_m` bounds the error, faults of GNSS included, `across_protection_m` that to the
    side of where the robot heads, of which the covariance alone makes `across_plain_m`.
    `contradiction` tells of sensors between which a person decides.
    """

    t_s: float
    x_map_m: float
    y_map_m: float
    yaw_map_rad: float
    v_mps: float
    yaw_rate_radps: float
    slip_rad: float
    pose_cov: tuple[float, float, float, float, float, float, float, float, float]
    pos_std_m: float
    yaw_std_rad: float
    quality: GnssQuality
    ok: bool
    reason: str = ""
    protection_m: float = float("inf")
    row_seen: bool | None = None  # crop, where the robot's row is to be; None: no camera looks
    across_protection_m: float = float("inf")
    across_plain_m: float = 0.0
    contradiction: str = ""


class Path(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A dense path of the body frame's origin in the map.

    All arrays have N points about 2 cm apart: `xy_map_m` (N, 2), `yaw_map_rad` (N,),
    `curvature_radpm` (N,), `row` (N,) the index of the crop row, or -1 between rows,
    `s_m` (N,) the distance from the start.
    """

    xy_map_m: FloatArray
    yaw_map_rad: FloatArray
    curvature_radpm: FloatArray
    row: npt.NDArray[np.int64]
    s_m: FloatArray


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """A crop row from its first to its last plant: a line, or an arc (see row_shape)."""

    index: int
    start_map_m: tuple[float, float]
    end_map_m: tuple[float, float]
    curvature_radpm: float = 0.0  # left positive


MissionState = Literal["waiting", "running", "paused", "done", "cancelled", "failed"]


class MissionStatus(msgspec.Struct, frozen=True, kw_only=True):
    """Progress: `row` is the row being worked, -1 between rows; `rows_done` those finished."""

    state: MissionState
    reason: str
    row: int
    rows_total: int
    rows_done: tuple[int, ...]
    s_m: float
    length_m: float
    waypoints_total: int
    waypoints_reached: int
    leg: str = ""  # "row 3", "to row 4", "way home"
    distance_left_m: float = 0.0
    eta_s: float | None = None  # until the end of the path, at the planned speeds
    refusal: str = ""  # why the last goal, visit, plan or way home was not taken
    task: str = ""  # the name of the visit that took the place of the mission
    goal_map_m: tuple[float, float] | None = None  # where the robot is bound for on its path
    rows_unproven: tuple[int, ...] = ()  # driven without evidence that it was this row: not done
    stopped: str = ""  # why it stands until a person clears the stop
    held: str = ""  # why it paused by itself; a person has to look, and to resume it
    warning: str = ""  # what calls it home, such as a low battery


class Goal(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What the mission wants now: follow `path` from `s_m`, at most this fast.

    `path` is None until it is planned. `tracked_x_m` ahead on the body is what stays on it.
    """

    path: Path | None
    s_m: float
    max_speed_mps: float
    tool_on: bool
    status: MissionStatus
    tracked_x_m: float = 0.0
    bounds: FieldBounds | None = None  # of the field that must not be left


class DriveCommand(msgspec.Struct, frozen=True, kw_only=True):
    """Body twist; the platform turns it into wheel speeds."""

    v_mps: float = 0.0
    yaw_rate_radps: float = 0.0


class ImplementCommand(msgspec.Struct, frozen=True, kw_only=True):
    """State of each spray nozzle, from left to right; empty where there is no implement."""

    nozzles_open: tuple[bool, ...] = ()


class RobotCommand(msgspec.Struct, frozen=True, kw_only=True):
    t_s: float
    drive: DriveCommand = DriveCommand()
    implement: ImplementCommand = ImplementCommand()


STOP = DriveCommand()


class Tracking(msgspec.Struct, frozen=True, kw_only=True):
    """What the follower believes: signed cross-track (left positive) and heading error."""

    s_m: float
    cross_track_m: float
    heading_error_rad: float


class TickRecord(msgspec.Struct, frozen=True, kw_only=True):
    """All that one tick saw and decided: log line, display update and replay key.

    `reason` says why the supervisor changed the command, or that wheels turn on though they are
    to stand; empty where neither is so.
    """

    batch: SensorBatch
    scenes: tuple[Scene, ...]
    estimate: Estimate
    status: MissionStatus
    tracking: Tracking | None
    command: RobotCommand
    reason: str = ""
