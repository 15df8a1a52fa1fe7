"""Readers of sensor messages of other nodes, of both ROS versions, as checked samples.

A reader takes a message object and its capture time. It returns None for a valid message without
a sample, such as that of a receiver without a fix. What a message says to be unknown, by the rules
of its definition, is unknown in the sample: no altitude is NaN, no acceleration None; an unknown
covariance is that of the kind of fix.
Raises: BridgeError: a number not finite or out of range, an image of another size, no such wheel.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from PIL import Image

from agribot.core.errors import BridgeError, ConfigError
from agribot.core.messages import (
    ByteArray,
    CameraFrame,
    GnssFix,
    GnssQuality,
    ImuSample,
    LaserScan,
    MagSample,
    Vec3,
    WheelSample,
)
from agribot.core.pixel_depth import Pixels, find_depth, narrow_pixels
from agribot.core.platform import Sensor
from agribot.core.robot import RobotSpec
from agribot.ros.messages.gps_types import (
    GPSFIX_ROS1,
    GPSFIX_ROS2,
    read_gps_fix,
    read_place,
    read_variance_m2,
)
from agribot.ros.messages.wheel_readers import JointReader, TwistReader

Sample = GnssFix | ImuSample | MagSample | WheelSample | CameraFrame | LaserScan
ReadSample = Callable[[Any, float], Sample | None]

# Quality and 1 sigma (m) of a receiver without a covariance, by NavSatStatus.
_QUALITY = {
    0: (GnssQuality.SINGLE, 2.5),
    1: (GnssQuality.DGNSS, 1.0),
    2: (GnssQuality.RTK_FLOAT, 0.3),
}
_NO_FIX = -1
NOT_MEASURED = -1.0
_FIXED_STD_M = 0.05  # a carrier solution that claims to be better has its ambiguities fixed
_CHANNELS = {"rgb8": (3, (0, 1, 2)), "bgr8": (3, (2, 1, 0)), "rgba8": (4, (0, 1, 2)),
             "bgra8": (4, (2, 1, 0)), "mono8": (1, (0, 0, 0)), "rgb16": (3, (0, 1, 2)),
             "bgr16": (3, (2, 1, 0)), "mono16": (1, (0, 0, 0))}  # fmt: skip


def make_readers(sensor: Sensor, robot: RobotSpec) -> Mapping[str, ReadSample]:
    """Make the readers of a sensor, by message type.

    Raises: ConfigError: ROS has no type for it.
    """
    if sensor == "gnss":
        return {
            "sensor_msgs/msg/NavSatFix": read_fix,
            GPSFIX_ROS1: read_gps_fix,
            GPSFIX_ROS2: read_gps_fix,
        }
    if sensor == "imu":
        return {"sensor_msgs/msg/Imu": read_imu}
    if sensor == "mag":
        return {
            "sensor_msgs/msg/MagneticField": lambda m, t_s: read_mag(m.magnetic_field, t_s),
            "geometry_msgs/msg/Vector3Stamped": lambda m, t_s: read_mag(m.vector, t_s),
        }
    if sensor == "wheels":
        return {
            "sensor_msgs/msg/JointState": JointReader(robot),
            "nav_msgs/msg/Odometry": TwistReader(robot.drive),
        }
    if sensor == "scans":
        if robot.lidar is None:
            raise ConfigError(
                "scan: the robot's description has no lidar, so that its place is not known; add a "
                '<sensor type="ray"> on its link'
            )
        return {"sensor_msgs/msg/LaserScan": read_scan}
    if sensor == "others":
        raise ConfigError("others: no type of ROS message stands for them; write a source for it")
    if sensor == "contactor":
        raise ConfigError("contactor: it is switched, not heard; use contactor=lcus:/dev/...")
    return make_image_readers(robot)


def make_image_readers(robot: RobotSpec | None) -> Mapping[str, ReadSample]:
    """Make the readers of pictures by type; without a robot they take any size."""
    images = ImageReader(robot)
    return {
        "sensor_msgs/msg/Image": images.read_raw,
        "sensor_msgs/msg/CompressedImage": images.read_compressed,
    }


def read_fix(message: Any, t_s: float) -> GnssFix | None:
    """Read a NavSatFix: without an altitude it is NaN, variances of zero or NaN are unknown."""
    if message.status.status <= _NO_FIX or (place := read_place(message)) is None:
        return None
    quality, std_m = _QUALITY.get(message.status.status, _QUALITY[0])
    if variance_m2 := read_variance_m2(message):
        std_m = math.sqrt(variance_m2)
    if quality is GnssQuality.RTK_FLOAT and std_m <= _FIXED_STD_M:
        quality = GnssQuality.RTK_FIXED
    lat_deg, lon_deg, alt_m = place
    return GnssFix(
        t_s=t_s, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m, pos_std_m=std_m, quality=quality
    )


def read_imu(message: Any, t_s: float) -> ImuSample:
    """Read an Imu, whose parts are not measured where the first number of a covariance is -1.

    Nor is an acceleration without a number, or of exactly zero, which none on Earth is.
    """
    if message.angular_velocity_covariance[0] == NOT_MEASURED:
        raise BridgeError(
            "an Imu without angular velocity (its covariance begins with -1), which the robot "
            "needs; take the topic of an IMU with a gyro"
        )
    accel = message.linear_acceleration
    has_numbers = any(number and not math.isnan(number) for number in (accel.x, accel.y, accel.z))
    has_accel = has_numbers and message.linear_acceleration_covariance[0] != NOT_MEASURED
    return ImuSample(
        t_s=t_s,
        gyro_radps=_read_finite(message.angular_velocity, "angular velocity"),
        accel_mps2=_read_finite(accel, "linear acceleration") if has_accel else None,
    )


def read_mag(vector: Any, t_s: float) -> MagSample:
    """Read the direction of a magnetic field, in any unit.

    By the definition of MagneticField, NaN is an axis that the sensor does not have.
    """
    if any(map(math.isnan, (vector.x, vector.y, vector.z))):
        raise BridgeError(
            f"a field {(vector.x, vector.y, vector.z)} without all three axes, which the heading "
            "needs; take the topic of a magnetometer with three"
        )
    return MagSample(t_s=t_s, field_t=_read_finite(vector, "field"))


def read_scan(message: Any, t_s: float) -> LaserScan:
    """Read a LaserScan, whose ranges out of its own limits are as REP-117 says.

    By many drivers 0 is a ray that did not come back.
    """
    limits = float(message.range_min), float(message.range_max)
    angles = float(message.angle_min), float(message.angle_increment)
    ranges_m = np.array(message.ranges, dtype=float)
    if not math.isfinite(sum(limits) + sum(angles)) or not len(ranges_m):
        raise BridgeError(
            f"a scan of {len(ranges_m)} rays with {limits} and {angles}; send rays and finite "
            "limits"
        )
    ranges_m[(ranges_m > limits[1]) | (ranges_m == 0.0)] = np.inf
    ranges_m[ranges_m < limits[0]] = -np.inf
    return LaserScan(
        t_s=t_s, min_angle_rad=angles[0], step_rad=angles[1], range_min_m=limits[0],
        range_max_m=limits[1], period_s=float(message.scan_time), ranges_m=ranges_m,
    )  # fmt: skip


class ImageReader:
    """Reads and numbers the frames; all must have the size of the robot's camera, if there is one.

    Of 16-bit pixels the upper eight of the bits that the camera uses are kept, as far as its
    frames have shown them: a dark frame after a bright one stays dark.
    """

    def __init__(self, robot: RobotSpec | None) -> None:
        """Take the size from a robot; without one, pictures of any size are read."""
        camera = None if robot is None else robot.camera
        self._takes_any = robot is None
        self._shape = (camera.height_px, camera.width_px, 3) if camera else None
        self._index = 0
        self._depth = 8

    def read_raw(self, message: Any, t_s: float) -> CameraFrame:
        if message.encoding not in _CHANNELS:
            raise BridgeError(
                f"encoding {message.encoding} is unknown; send one of {', '.join(_CHANNELS)}"
            )
        count, order = _CHANNELS[message.encoding]
        height, width, step = int(message.height), int(message.width), int(message.step)
        data = np.asarray(message.data, dtype=np.uint8)
        is_deep = message.encoding.endswith("16")
        used = width * count * (2 if is_deep else 1)
        if step < used or data.size < height * step:
            raise BridgeError(
                f"{data.size} bytes are no image of {width} x {height} pixels; send whole rows"
            )
        rows = data[: height * step].reshape(height, step)[:, :used]
        if is_deep:
            order_of_bytes = ">u2" if message.is_bigendian else "<u2"
            rows = self._narrow(np.ascontiguousarray(rows).view(order_of_bytes))
        return self._make_frame(rows.reshape(height, width, count)[:, :, order], t_s)

    def read_compressed(self, message: Any, t_s: float) -> CameraFrame:
        try:
            image = Image.open(io.BytesIO(np.asarray(message.data).tobytes()))
            if image.mode.startswith("I"):  # 16 bits and grey
                grey = self._narrow(np.asarray(image).astype(np.int64))
                return self._make_frame(np.repeat(grey[..., None], 3, axis=2), t_s)
            pixels = np.asarray(image.convert("RGB"))
        except (OSError, ValueError, Image.DecompressionBombError) as error:
            raise BridgeError(
                f"{len(message.data)} bytes are no picture: {error}; send JPEG or PNG"
            ) from error
        return self._make_frame(pixels, t_s)

    def _narrow(self, pixels: Pixels) -> ByteArray:
        self._depth = max(self._depth, find_depth(pixels))
        return narrow_pixels(pixels, self._depth)

    def _make_frame(self, image_rgb: ByteArray, t_s: float) -> CameraFrame:
        if not self._takes_any and image_rgb.shape != self._shape:
            wanted = "no camera" if self._shape is None else f"{self._shape[1]} x {self._shape[0]}"
            raise BridgeError(
                f"an image of {image_rgb.shape[1]} x {image_rgb.shape[0]} pixels, but the robot's "
                f"description has {wanted}; set the camera, or the description"
            )
        self._index += 1
        return CameraFrame(
            t_s=t_s, index=self._index - 1, image_rgb=np.ascontiguousarray(image_rgb)
        )


def _read_finite(vector: Any, what: str) -> Vec3:
    x, y, z = float(vector.x), float(vector.y), float(vector.z)
    if not math.isfinite(x + y + z):
        raise BridgeError(f"{what} {(x, y, z)} is not finite; send finite numbers")
    return (x, y, z)
