"""All topics of a simulated world without a stack: sensors, frame tree and the truth."""

from __future__ import annotations

from typing import NamedTuple

from agribot.core import topics
from agribot.core.config import EstimateConfig
from agribot.core.messages import DriveCommand, SensorBatch, Vec3
from agribot.core.robot import RobotSpec
from agribot.ros.messages import cdr, rosmsg
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.sensor_topics import SLOW_NS, MessageSink, SensorTopicWriter
from agribot.ros.messages.transforms import make_static_transforms
from agribot.ros.messages.wheel_odometry import (
    MapTransform,
    OdomTransform,
    WheelOdometryWriter,
)


class WorldTick(NamedTuple):
    """The batch of one tick of the world, and the true motion of the robot in it."""

    batch: SensorBatch
    command: DriveCommand | None
    pose: tuple[float, float, float]  # x_map_m, y_map_m, yaw_map_rad
    twist: tuple[float, float]  # v_mps, yaw_rate_radps
    imu_bias: tuple[Vec3, Vec3] | None = None  # biases of accelerometer, m/s^2, and gyro, rad/s


class WorldTopicWriter:
    """Call it once per tick; all messages go to `write`, in a fixed order.

    The frame tree is that of the wheel odometry, odom -> base_footprint: no node localizes here.
    With `has_map` it has map -> odom, too, as a localizer without errors would give it. `wheels`
    is how well the wheels are believed.
    """

    def __init__(
        self,
        write: MessageSink,
        robot: RobotSpec,
        urdf: str,
        camera: CameraLog,
        wheels: EstimateConfig | None = None,
        *,
        has_map: bool = False,
    ) -> None:
        self._write, self._robot, self._urdf = write, robot, urdf
        self._sensors = SensorTopicWriter(write, robot, camera)
        self._truth, self._twist = cdr.OdometryCdr(), cdr.TwistCdr()
        self._wheel_odometry = WheelOdometryWriter(write, robot, wheels)
        self._odom_tf, self._map_tf = OdomTransform(), MapTransform() if has_map else None
        self._next_slow_ns = 0
        self._started = False

    def __call__(self, tick: WorldTick) -> None:
        now_ns = rosmsg.to_nanoseconds(tick.batch.t_s)
        if not self._started:
            self._start(now_ns)
        self._sensors(now_ns, tick.batch)
        self._wheel_odometry(now_ns, tick.batch)
        if tick.command is not None:
            data = self._twist(tick.command.v_mps, tick.command.yaw_rate_radps)
            self._write(topics.CMD_VEL, now_ns, data, now_ns)
        truth = self._truth.pack(now_ns, tick.pose, (0.0,) * 9, tick.twist)
        self._write(topics.GROUND_TRUTH, now_ns, truth, now_ns)
        self._write_frames(now_ns, tick)
        if tick.imu_bias is not None:
            self._sensors.write_imu_bias(now_ns, tick.batch.t_s, tick.imu_bias)
        if now_ns >= self._next_slow_ns and tick.batch.wheels:
            self._next_slow_ns = now_ns + SLOW_NS
            self._sensors.write_wheel_transforms(now_ns, tick.batch.wheels[-1])

    def _write_frames(self, now_ns: int, tick: WorldTick) -> None:
        odom_from_body = self._wheel_odometry.pose
        self._write(topics.TF, now_ns, self._odom_tf(now_ns, odom_from_body), now_ns)
        if self._map_tf is not None:
            self._write(topics.TF, now_ns, self._map_tf(now_ns, tick.pose, odom_from_body), now_ns)

    def _start(self, now_ns: int) -> None:
        self._started = True
        urdf = rosmsg.to_cdr(rosmsg.make_text(self._urdf))
        self._write(topics.ROBOT_DESCRIPTION, now_ns, urdf, now_ns)
        fixed = rosmsg.to_cdr(make_static_transforms(self._robot))
        self._write(topics.TF_STATIC, now_ns, fixed, now_ns)
        self._sensors.write_calibrated(now_ns, is_calibrated=True)
