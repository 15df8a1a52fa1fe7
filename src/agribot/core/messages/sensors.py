"""What sensors and devices measure, and the batch of one tick.

What a device did not report is None, and NaN where it is a single number, such as an altitude or
the upward part of a velocity; never zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Literal

import msgspec

from agribot.core.facts import AnyFact
from agribot.core.messages.arrays import ByteArray, FloatArray, Four, Vec3
from agribot.core.messages.operator import HandDrive
from agribot.core.messages.requests import RequestEvent

# The order of every four-wheel tuple: rear right, rear left, front right, front left.
WHEEL_NAMES = ("right_wheel_R", "left_wheel_R", "right_wheel_F", "left_wheel_F")
# Wheels between them by their number: right and left, the rear pair first.
MIDDLE_WHEEL_NAMES = {
    0: (),
    2: ("right_wheel_M", "left_wheel_M"),
    4: ("right_wheel_MR", "left_wheel_MR", "right_wheel_MF", "left_wheel_MF"),
}


class GnssQuality(IntEnum):
    """Kind of a position; the numbers are those of NMEA GGA field 6."""

    NONE = 0
    SINGLE = 1
    DGNSS = 2
    RTK_FIXED = 4
    RTK_FLOAT = 5


Unmeasured = Literal["dead reckoning", "held"]


class MiddleWheel(msgspec.Struct, frozen=True, kw_only=True):
    """Encoder reading of one wheel between those at the corners; it turns with its side."""

    angle_rad: float
    speed_radps: float
    effort_nm: float | None = None


class WheelSample(msgspec.Struct, frozen=True, kw_only=True):
    """Encoder reading of the four wheels at the corners, in the order of WHEEL_NAMES.

    A board may also send the torque at the wheels, the commanded speeds, and faulty wheels.
    `middle` holds the wheels between them, in the order of `RobotSpec.middle_wheels`; it is empty
    of a robot with four and of a board that does not send them.
    """

    t_s: float
    angle_rad: Four
    speed_radps: Four
    effort_nm: Four | None = None
    target_radps: Four | None = None
    faults: tuple[str, ...] = ()
    middle: tuple[MiddleWheel, ...] = ()


class ImuSample(msgspec.Struct, frozen=True, kw_only=True):
    """Body axes at the IMU. Acceleration is specific force: +9.8 upwards at rest (REP-145).

    It is None from an IMU that does not measure it.
    """

    t_s: float
    gyro_radps: Vec3
    accel_mps2: Vec3 | None


class MagSample(msgspec.Struct, frozen=True, kw_only=True):
    """Magnetic field in body axes."""

    t_s: float
    field_t: Vec3


class GnssFix(msgspec.Struct, frozen=True, kw_only=True):
    """One epoch of a receiver, at its antenna.

    `pos_std_m` is the receiver's own 1 sigma per horizontal axis; `t_s` the measurement epoch
    (the fix arrives later). Velocity is East, North, Up, or None when the receiver gives none;
    altitude over the ellipsoid and upward velocity are NaN when it gives none. `unmeasured` says
    that satellites were not measured: by dead reckoning the receiver carries its place on, and a
    held place was entered for a base or a clock. The quality of both is NONE, and they correct
    nothing.
    """

    t_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    pos_std_m: float
    quality: GnssQuality
    velocity_mps: Vec3 | None = None
    velocity_std_mps: float = 0.1
    unmeasured: Unmeasured | Literal[""] = ""


class GnssHeading(msgspec.Struct, frozen=True, kw_only=True):
    """Heading of the robot from two antennas; silent while the ambiguities are not fixed."""

    t_s: float
    yaw_map_rad: float
    std_rad: float


class Satellite(msgspec.Struct, frozen=True, kw_only=True):
    """One satellite in view; `system` is GP, GL, GA, GB, GQ or SB, `number` the receiver's name.

    `snr_db` is the carrier to noise density in dB-Hz, 0 of one that is not heard.
    """

    system: str
    number: int
    elevation_deg: float
    azimuth_deg: float
    snr_db: float
    is_used: bool


class GnssStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A receiver's report beside its fixes, about once a second; None and empty: not reported.

    Dilutions of precision are of geometry, position, plane, height and time. The age is that of
    the newest correction, the counts are of corrections passed on to the receiver, by RTCM number.
    Used and unused are those that the receiver reports as used and as not used, broken ones
    included, since its line was opened. `unread` names the kinds of messages that came and are not
    read; `trouble` says why its data give no position, and what to do.
    """

    t_s: float
    satellites: tuple[Satellite, ...] = ()
    gdop: float | None = None
    pdop: float | None = None
    hdop: float | None = None
    vdop: float | None = None
    tdop: float | None = None
    correction_age_s: float | None = None
    correction_counts: tuple[tuple[int, int], ...] = ()
    corrections_used: int | None = None
    corrections_unused: int | None = None
    unread: tuple[str, ...] = ()
    trouble: str = ""


class BaseFix(msgspec.Struct, frozen=True, kw_only=True):
    """Position by a receiver at a known place: its error applies to nearby receivers.

    `velocity_mps` is East, North, Up, of one that stands its error; None where it gives none.
    """

    t_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    pos_std_m: float
    known_lat_deg: float
    known_lon_deg: float
    known_alt_m: float
    velocity_mps: Vec3 | None = None

    def error(self) -> tuple[float, float, float]:
        """Latitude, longitude (degrees) and altitude (m) to subtract from a fix near by."""
        return (
            self.lat_deg - self.known_lat_deg,
            self.lon_deg - self.known_lon_deg,
            self.alt_m - self.known_alt_m,
        )


class CameraFrame(msgspec.Struct, frozen=True, kw_only=True):
    """An image: (height, width, 3) uint8, red green blue, top row first."""

    t_s: float
    index: int
    image_rgb: ByteArray


class LaserScan(msgspec.Struct, frozen=True, kw_only=True):
    """A scan of a lidar in its plane, counter-clockwise from the first angle.

    `ranges_m` (N,) is infinite where nothing came back, and minus infinite where something is
    nearer than the lidar can measure (REP-117).
    """

    t_s: float
    min_angle_rad: float
    step_rad: float
    range_min_m: float
    range_max_m: float
    period_s: float
    ranges_m: FloatArray


class ObstacleSample(msgspec.Struct, frozen=True, kw_only=True):
    """The nearest things around the robot that one sensor sees above the ground and the crop.

    `points_body_m` are x and y in the body frame, one for each direction in which there is
    something; `std_m` is their 1 sigma. A sensor that works and sees nothing has no points.
    """

    t_s: float
    sensor: Literal["lidar"]
    std_m: float
    points_body_m: tuple[tuple[float, float], ...] = ()


class BumperSample(msgspec.Struct, frozen=True, kw_only=True):
    """The robot touches something, here in the body frame; one sample per tick of contact."""

    t_s: float
    x_body_m: float
    y_body_m: float


class BatterySample(msgspec.Struct, frozen=True, kw_only=True):
    """Voltage at the terminals, current drawn, and what is left of the capacity, or NaN."""

    t_s: float
    voltage_v: float
    current_a: float
    charge_ratio: float


# Safety inputs of a motor board: the red button (e-stop), the bumper, the battery's voltage, and
# the health of its motors.
SafetyInput = Literal["red button", "bumper", "battery", "motors"]


class BoardSample(msgspec.Struct, frozen=True, kw_only=True):
    """Report of a motor board: its safety inputs, its stop and its faults.

    `inputs` are those that it reads at this moment; one that it has lost is left out, and is a
    fault where the robot must have it. `stop` is why it drives no motor until it gets the command
    that a person cleared the stop, and `fault` is what is wrong with it; None where it is well.
    """

    t_s: float
    inputs: tuple[SafetyInput, ...] = ()
    is_button_pressed: bool = False
    stop: AnyFact | None = None
    fault: AnyFact | None = None


class ContactorSample(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Report of the contactor in the motors' supply: whether it feeds them, as far as it knows.

    Where there are two in series, `is_closed` while both are, and `is_one_closed` while one of
    them is alone: the other took the power. `fault` is why it does not obey, or cannot get, its
    command; None where it can.
    """

    t_s: float
    is_closed: bool = True
    is_one_closed: bool = False
    fault: AnyFact | None = None


class OtherSample(msgspec.Struct, frozen=True, kw_only=True):
    """Measurement of a sensor without a field of its own in the batch.

    `sensor` is its name, and the meaning and the units of `numbers` are its own affair: that of the
    `Correction` that takes them.
    """

    t_s: float
    sensor: str
    numbers: tuple[float, ...]


class DeviceNote(msgspec.Struct, frozen=True, kw_only=True):
    """What is found of a device or its line once; one whose severity is "note" is no fault."""

    t_s: float
    fact: AnyFact


class SensorBatch(msgspec.Struct, frozen=True, kw_only=True):
    """Samples since the last tick, oldest first. A silent sensor is an empty tuple."""

    t_s: float
    wheels: tuple[WheelSample, ...] = ()
    imu: tuple[ImuSample, ...] = ()
    mag: tuple[MagSample, ...] = ()
    gnss: tuple[GnssFix, ...] = ()
    frames: tuple[CameraFrame, ...] = ()
    requests: tuple[RequestEvent, ...] = ()
    notes: tuple[DeviceNote, ...] = ()
    base: tuple[BaseFix, ...] = ()
    headings: tuple[GnssHeading, ...] = ()
    bumper: tuple[BumperSample, ...] = ()
    battery: tuple[BatterySample, ...] = ()
    hand: tuple[HandDrive, ...] = ()
    others: tuple[OtherSample, ...] = ()
    board: tuple[BoardSample, ...] = ()
    gnss_status: tuple[GnssStatus, ...] = ()
    contactor: tuple[ContactorSample, ...] = ()
    scans: tuple[LaserScan, ...] = ()
    obstacles: tuple[ObstacleSample, ...] = ()


def join_batches(batches: Sequence[SensorBatch]) -> SensorBatch:
    """Put batches together into one of the last one's time."""
    fields = [name for name in SensorBatch.__struct_fields__ if name != "t_s"]
    joined = {
        name: tuple(sample for batch in batches for sample in getattr(batch, name))
        for name in fields
    }
    return msgspec.structs.replace(batches[-1], **joined)
