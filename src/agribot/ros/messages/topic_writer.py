"""All topics of a run: one TickRecord in, its messages out, serialised once for all receivers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.core import topics
from agribot.core.config import EstimateConfig
from agribot.core.geo import Datum, MapFrame, compass_deg_from_yaw, wrap_rad
from agribot.core.messages import Estimate, MappedPlant, MissionStatus, Path, TickRecord, Vec3
from agribot.core.robot import RobotSpec
from agribot.core.topics import Topic
from agribot.ros.messages import cdr, rosmsg
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.drawn_topics import list_drawn
from agribot.ros.messages.markers import make_weed_markers
from agribot.ros.messages.sensor_topics import SLOW_NS, MessageSink, SensorTopicWriter
from agribot.ros.messages.transforms import make_static_transforms
from agribot.ros.messages.wheel_odometry import FrameChain, WheelOdometryWriter

_SECOND_NS = 1_000_000_000


class TopicWriter:
    """Call it with every TickRecord; all messages of a tick go to `write`, in a fixed order.

    A file, a network or a display may be behind `write`; the bytes are the same for each.
    """

    def __init__(
        self,
        write: MessageSink,
        robot: RobotSpec,
        datum: Datum,
        urdf: str,
        camera: CameraLog,
        wheels: EstimateConfig | None = None,
    ) -> None:
        self._write, self._robot, self._urdf, self._camera = write, robot, urdf, camera
        self._map_frame = MapFrame(datum)
        self._plan: Path | None = None
        self._goals_map_m: tuple[tuple[float, float], ...] = ()
        self._weeds: tuple[MappedPlant, ...] = ()
        self._status: MissionStatus | None = None
        self._started = False
        self._is_calibrated: bool | None = None
        self._now_ns = self._next_second_ns = self._next_slow_ns = 0
        self._sensors = SensorTopicWriter(write, robot, camera)
        self._odometry, self._truth = cdr.OdometryCdr(), cdr.OdometryCdr()
        self._twist, self._number = cdr.TwistCdr(), cdr.Float64Cdr()
        self._wheel_odometry = WheelOdometryWriter(write, robot, wheels)
        self._frames = FrameChain()

    def __call__(self, record: TickRecord) -> None:
        self._now_ns = rosmsg.to_nanoseconds(record.batch.t_s)
        if not self._started:
            self._start(record.batch.t_s)
        self._sensors(self._now_ns, record.batch)
        self._wheel_odometry(self._now_ns, record.batch)
        self._write_overlays(record)
        self._write_decisions(record)
        for topic, message in list_drawn(record.batch.requests, record.batch.t_s):
            self._write_ros(topic, message, record.batch.t_s)
        if self._now_ns >= self._next_slow_ns:
            self._next_slow_ns = self._now_ns + SLOW_NS
            self._write_slow(record)
        self._write_mission(record.status)
        self._write_calibrated(is_calibrated=record.estimate.ok)
        if self._now_ns >= self._next_second_ns:
            self._next_second_ns = self._now_ns + _SECOND_NS

    def write_truth(
        self, t_s: float, pose: tuple[float, float, float], twist: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Write the true pose (x_map_m, y_map_m, yaw_map_rad) and twist of a simulator."""
        t_ns = rosmsg.to_nanoseconds(t_s)
        data = self._truth.pack(t_ns, pose, (0.0,) * 9, twist)
        self._write(topics.GROUND_TRUTH, t_ns, data, t_ns)

    def write_imu_bias(self, t_s: float, bias: tuple[Vec3, Vec3]) -> None:
        """Write the true biases of accelerometer and gyro of a simulator."""
        self._sensors.write_imu_bias(rosmsg.to_nanoseconds(t_s), t_s, bias)

    def set_plan(
        self, t_s: float, plan: Path | None, goals_map_m: Sequence[tuple[float, float]]
    ) -> None:
        """Set and write a new path and its waypoints, when the mission planned again."""
        self._plan, self._goals_map_m = plan, tuple(goals_map_m)
        if self._started:
            self._write_plan(t_s)

    def set_weeds(self, t_s: float, plants: Sequence[MappedPlant]) -> None:
        """Set the weed map and write it if it changed."""
        weeds = tuple(plants)
        if weeds != self._weeds:
            self._weeds = weeds
            self._write_ros(topics.WEEDS, make_weed_markers(t_s, weeds), t_s)

    def _start(self, t_s: float) -> None:
        self._started = True
        self._write_ros(topics.ROBOT_DESCRIPTION, rosmsg.make_text(self._urdf), t_s)
        self._write_ros(topics.TF_STATIC, make_static_transforms(self._robot), t_s)
        self._write_plan(t_s)

    def _write_plan(self, t_s: float) -> None:
        if self._plan is not None:
            self._write_ros(topics.PATH, rosmsg.make_path(t_s, self._plan), t_s)
        if self._goals_map_m:
            self._write_ros(topics.GOALS, rosmsg.make_goals(t_s, self._goals_map_m), t_s)

    def _write_overlays(self, record: TickRecord) -> None:
        for scene in record.scenes:
            jpeg = self._camera.encode_overlay(scene)
            if jpeg is not None:
                overlay = rosmsg.make_compressed_image(scene.t_s, jpeg)
                self._write_ros(topics.OVERLAY, overlay, scene.t_s)

    def _write_decisions(self, record: TickRecord) -> None:
        now_ns, estimate, drive = self._now_ns, record.estimate, record.command.drive
        self._write(topics.ODOMETRY, now_ns, self._odometry(now_ns, estimate), now_ns)
        frames = self._frames(now_ns, estimate, self._wheel_odometry.pose)
        self._write(topics.TF, now_ns, frames, now_ns)
        twist = self._twist(drive.v_mps, drive.yaw_rate_radps)
        self._write(topics.CMD_VEL, now_ns, twist, now_ns)

    def _write_slow(self, record: TickRecord) -> None:
        estimate = record.estimate
        self._write_ros(topics.POSE, rosmsg.make_pose_stamped(estimate), estimate.t_s)
        self._write_number(topics.HEADING_FILTERED, compass_deg_from_yaw(estimate.yaw_map_rad))
        if record.status.goal_map_m is not None:
            self._write_goal_distance(estimate, record.status.goal_map_m)
        if record.batch.wheels:
            self._sensors.write_wheel_transforms(self._now_ns, record.batch.wheels[-1])

    def _write_goal_distance(self, estimate: Estimate, goal_map_m: tuple[float, float]) -> None:
        dx_m, dy_m = goal_map_m[0] - estimate.x_map_m, goal_map_m[1] - estimate.y_map_m
        self._write_number(topics.DISTANCE, math.hypot(dx_m, dy_m))
        bearing_rad = math.atan2(dy_m, dx_m)
        self._write_number(topics.BEARING, math.degrees(bearing_rad))
        left_rad = wrap_rad(bearing_rad - estimate.yaw_map_rad)
        self._write_number(topics.ANGLE, math.degrees(left_rad))

    def _write_mission(self, status: MissionStatus) -> None:
        before, now_s = self._status, self._now_ns / _SECOND_NS
        changed = before is None or (
            before.state, before.reason, before.row, before.gate.state,
        ) != (status.state, status.reason, status.row, status.gate.state)  # fmt: skip
        if changed or self._now_ns >= self._next_second_ns:
            self._write_ros(topics.STATUS, rosmsg.make_status(status), now_s)
        goal_map_m = status.goal_map_m
        if goal_map_m is not None and (before is None or before.goal_map_m != goal_map_m):
            fix = rosmsg.make_goal_fix(now_s, goal_map_m, self._map_frame)
            self._write_ros(topics.GOAL_FIX, fix, now_s)
        self._status = status

    def _write_calibrated(self, *, is_calibrated: bool) -> None:
        """Write false at the start, and true once for all when the robot knows where it is."""
        if self._is_calibrated is None or (is_calibrated and not self._is_calibrated):
            self._is_calibrated = is_calibrated
            self._sensors.write_calibrated(self._now_ns, is_calibrated=is_calibrated)

    def _write_number(self, topic: Topic, value: float) -> None:
        self._write(topic, self._now_ns, self._number(value), self._now_ns)

    def _write_ros(self, topic: Topic, message: object, t_s: float) -> None:
        data = rosmsg.to_cdr(message)
        self._write(topic, self._now_ns, data, rosmsg.to_nanoseconds(t_s))
