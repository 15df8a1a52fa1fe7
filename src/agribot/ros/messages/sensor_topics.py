"""The topics of the sensors, for every recording, with or without a stack."""

from __future__ import annotations

import math
from typing import Any, Protocol

from agribot.core import topics
from agribot.core.messages import CameraFrame, GnssStatus, SensorBatch, Vec3, WheelSample
from agribot.core.robot import RobotSpec
from agribot.core.topics import Topic
from agribot.ros.messages import cdr, rosmsg
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.device_rosmsg import (
    make_battery_state,
    make_contact_point,
    make_imu_bias,
    make_laser_scan,
    make_pole_fix,
    make_pole_velocity,
)
from agribot.ros.messages.transforms import WheelTransforms, find_wheel_joints

SLOW_NS = 100_000_000  # values for people and for the original's tools


class MessageSink(Protocol):
    """Takes one CDR message; `log_ns` is the tick, `publish_ns` the stamp of the value."""

    def __call__(self, topic: Topic, log_ns: int, data: bytes, publish_ns: int, /) -> None: ...


class SensorTopicWriter:
    """Writes the sensors' topics, batch by batch; `camera` picks the images to write."""

    def __init__(self, write: MessageSink, robot: RobotSpec, camera: CameraLog) -> None:
        self._send, self._robot, self._camera = write, robot, camera
        names = robot.wheel_names
        joints = find_wheel_joints(robot, names)
        self._imu = cdr.ImuCdr(robot.imu.link)
        self._joints = cdr.JointStateCdr(tuple(joint.name for joint in joints) or names)
        self._number = cdr.Float64Cdr()
        self._gnss_status: GnssStatus | None = None  # no simulated receiver reports one
        self._wheel_tf = WheelTransforms(joints) if joints else None

    def __call__(self, now_ns: int, batch: SensorBatch) -> None:
        for imu in batch.imu:
            t_ns = rosmsg.to_nanoseconds(imu.t_s)
            self._send(topics.IMU, now_ns, self._imu(t_ns, imu), t_ns)
        if batch.wheels:
            wheels = batch.wheels[-1]
            t_ns = rosmsg.to_nanoseconds(wheels.t_s)
            self._send(topics.JOINT_STATES, now_ns, self._joints(t_ns, wheels), t_ns)
        mount = self._robot.mag or self._robot.imu
        for mag in batch.mag:
            field = rosmsg.make_magnetic_field(mag, mount.link)
            self._write(topics.MAGNETIC, now_ns, field, mag.t_s)
            heading = math.degrees(math.atan2(mag.field_t[1], mag.field_t[0])) % 360.0
            self._send(topics.HEADING_RAW, now_ns, self._number(heading), now_ns)
        self._write_positions(now_ns, batch)
        for scan in batch.scans:
            link = "" if self._robot.lidar is None else self._robot.lidar.link
            self._write(topics.SCAN, now_ns, make_laser_scan(scan, link), scan.t_s)
        for touch in batch.bumper:
            self._write(topics.BUMPER, now_ns, make_contact_point(touch), touch.t_s)
        for battery in batch.battery:
            self._write(topics.BATTERY, now_ns, make_battery_state(battery), battery.t_s)
        for frame in batch.frames:
            self._write_image(now_ns, frame)

    def write_wheel_transforms(self, now_ns: int, wheels: WheelSample) -> None:
        """Write the turning wheels into the frame tree; ten times a second is enough."""
        if self._wheel_tf is not None:
            self._send(topics.TF, now_ns, self._wheel_tf(now_ns, wheels), now_ns)

    def write_imu_bias(self, now_ns: int, t_s: float, bias: tuple[Vec3, Vec3]) -> None:
        """Write the true biases of accelerometer and gyro, as a simulator knows them."""
        message = make_imu_bias(t_s, self._robot.imu.link, bias)
        self._write(topics.IMU_BIAS, now_ns, message, t_s)

    def write_calibrated(self, now_ns: int, *, is_calibrated: bool) -> None:
        message = rosmsg.make_message("std_msgs/msg/Bool", is_calibrated)
        self._send(topics.CALIBRATED, now_ns, rosmsg.to_cdr(message), now_ns)

    def _write_positions(self, now_ns: int, batch: SensorBatch) -> None:
        self._gnss_status = batch.gnss_status[-1] if batch.gnss_status else self._gnss_status
        for fix in batch.gnss:
            message = rosmsg.make_fix(fix, self._robot.gnss.link)
            self._write(topics.FIX, now_ns, message, fix.t_s)
            if fix.velocity_mps is not None:
                velocity = rosmsg.make_fix_velocity(fix.t_s, fix.velocity_mps)
                self._write(topics.FIX_VELOCITY, now_ns, velocity, fix.t_s)
            if self._gnss_status is not None:
                extended = rosmsg.make_extended_fix(fix, self._gnss_status, self._robot.gnss.link)
                self._write(topics.EXTENDED_FIX, now_ns, extended, fix.t_s)
        for base in batch.base:
            self._write(topics.POLE_FIX, now_ns, make_pole_fix(base), base.t_s)
            if base.velocity_mps is not None:
                velocity = make_pole_velocity(base, base.velocity_mps)
                self._write(topics.POLE_FIX_VELOCITY, now_ns, velocity, base.t_s)

    def _write_image(self, now_ns: int, frame: CameraFrame) -> None:
        jpeg = self._camera.encode_image(frame)
        if jpeg is not None and self._robot.camera is not None:
            image = rosmsg.make_compressed_image(frame.t_s, jpeg)
            self._write(topics.IMAGE, now_ns, image, frame.t_s)
            if self._camera.keeps_raw:
                raw = rosmsg.make_image(frame.t_s, frame.image_rgb)
                self._write(topics.IMAGE_RAW, now_ns, raw, frame.t_s)
            info = rosmsg.make_camera_info(frame.t_s, self._robot.camera)
            self._write(topics.CAMERA_INFO, now_ns, info, frame.t_s)

    def _write(self, topic: Topic, now_ns: int, message: Any, t_s: float) -> None:
        self._send(topic, now_ns, rosmsg.to_cdr(message), rosmsg.to_nanoseconds(t_s))
