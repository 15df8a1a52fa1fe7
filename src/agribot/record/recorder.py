"""The recorder: a tap that writes every TickRecord to `run.mcap`, for ROS 2 tools and replay."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath

import msgspec

from agribot import __version__, topics
from agribot.config import RunConfig, to_toml
from agribot.geo import MapFrame, compass_deg_from_yaw
from agribot.messages import Estimate, MappedPlant, MissionStatus, Path, TickRecord
from agribot.record.parts import RecordingParts
from agribot.record.sensor_log import SLOW_NS, SensorLog
from agribot.record.ticks import encode_tick
from agribot.robot import RobotSpec
from agribot.ros import cdr, rosmsg
from agribot.ros.camera_log import CameraLog
from agribot.ros.markers import weed_markers
from agribot.ros.transforms import BodyTransforms, static_transforms
from agribot.topic import Topic

CONFIG_ATTACHMENT = "config.toml"
URDF_ATTACHMENT = "robot.urdf"
WEED_MAP_ATTACHMENT = "weed_map.json"

_SECOND_NS = 1_000_000_000


class RunRecorder:
    """Call it with every TickRecord; a process killed later loses at most the last second.

    `weed_map` is asked once per second and at the end. `goals_map_m` are the waypoints in
    driving order. Raises: RecordingError: the file cannot be created or written.
    """

    def __init__(
        self,
        path: FilePath,
        config: RunConfig,
        robot: RobotSpec,
        urdf: str,
        plan: Path | None = None,
        goals_map_m: Sequence[tuple[float, float]] = (),
        weed_map: Callable[[], Sequence[MappedPlant]] | None = None,
    ) -> None:
        self._file = RecordingParts(path, config.record)
        self._robot = robot
        self._config, self._urdf = config, urdf
        self._map_frame = MapFrame(config.field.datum)
        self._plan, self._goals_map_m = plan, tuple(goals_map_m)
        self._weed_map = weed_map
        self._weeds: tuple[MappedPlant, ...] = ()
        self._status: MissionStatus | None = None
        self._started = False
        self._now_ns = self._next_second_ns = self._next_slow_ns = 0
        self._camera = CameraLog(robot, config.record.image_rate_hz, config.record.jpeg_quality)
        self._sensors = SensorLog(self._file, robot, self._camera)
        self._odometry, self._truth = cdr.OdometryCdr(), cdr.OdometryCdr()
        self._twist, self._number = cdr.TwistCdr(), cdr.Float64Cdr()
        self._body_tf = BodyTransforms()
        self._attach_settings()

    def __call__(self, record: TickRecord) -> None:
        self._now_ns = rosmsg.nanoseconds(record.batch.t_s)
        if not self._started:
            self._start(record.batch.t_s)
        self._sensors(self._now_ns, record.batch)
        self._overlays(record)
        self._decisions(record)
        if self._now_ns >= self._next_slow_ns:
            self._next_slow_ns = self._now_ns + SLOW_NS
            self._slow(record)
        self._mission(record.status)
        self._file.write(topics.TICK, self._now_ns, encode_tick(record), self._now_ns)
        if self._now_ns >= self._next_second_ns:
            self._next_second_ns = self._now_ns + _SECOND_NS
            self._weed_markers(record.batch.t_s)
            self._file.flush()

    @property
    def ended_because(self) -> str:
        """Why recording ended before the run did; empty while it goes on."""
        return self._file.ended_because

    def truth(
        self, t_s: float, pose: tuple[float, float, float], twist: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """True x_map_m, y_map_m, yaw_map_rad and forward and yaw rate; a simulator has them."""
        t_ns = rosmsg.nanoseconds(t_s)
        data = self._truth.pack(t_ns, pose, (0.0,) * 9, twist)
        self._file.write(topics.GROUND_TRUTH, t_ns, data, t_ns)

    def set_plan(
        self, t_s: float, plan: Path | None, goals_map_m: Sequence[tuple[float, float]]
    ) -> None:
        """A new path and its waypoints, when the mission planned again."""
        self._plan, self._goals_map_m = plan, tuple(goals_map_m)
        if self._started:
            self._write_plan(t_s)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Keep a file inside the recording, for example the report."""
        self._file.attach(name, media_type, data)

    def close(self) -> None:
        """Write the last weed map and the index. Safe to call twice."""
        if self._file.closed:
            return
        if self._weed_map is not None:
            self._weed_markers(self._now_ns / _SECOND_NS)
            weeds = msgspec.json.encode(tuple(self._weed_map()))
            self._file.attach(WEED_MAP_ATTACHMENT, "application/json", weeds)
        self._file.close()

    def _attach_settings(self) -> None:
        self._file.describe(
            "agribot",
            {
                "version": __version__,
                "profile": self._config.profile,
                "seed": str(self._config.seed),
                "robot": self._robot.name,
            },
        )
        toml = to_toml(self._config).encode()
        self._file.attach(CONFIG_ATTACHMENT, "application/toml", toml)
        self._file.attach(URDF_ATTACHMENT, "application/xml", self._urdf.encode())
        self._file.flush()

    def _start(self, t_s: float) -> None:
        self._started = True
        self._write_ros(topics.ROBOT_DESCRIPTION, rosmsg.text(self._urdf), t_s)
        self._write_ros(topics.TF_STATIC, static_transforms(self._robot), t_s)
        self._write_plan(t_s)

    def _write_plan(self, t_s: float) -> None:
        if self._plan is not None:
            self._write_ros(topics.PATH, rosmsg.path(t_s, self._plan), t_s)
        if self._goals_map_m:
            self._write_ros(topics.GOALS, rosmsg.goals(t_s, self._goals_map_m), t_s)

    def _overlays(self, record: TickRecord) -> None:
        for scene in record.scenes:
            jpeg = self._camera.overlay(scene)
            if jpeg is not None:
                overlay = rosmsg.compressed_image(scene.t_s, jpeg)
                self._write_ros(topics.OVERLAY, overlay, scene.t_s)

    def _decisions(self, record: TickRecord) -> None:
        now_ns, estimate, drive = self._now_ns, record.estimate, record.command.drive
        self._file.write(topics.ODOMETRY, now_ns, self._odometry(now_ns, estimate), now_ns)
        self._file.write(topics.TF, now_ns, self._body_tf(now_ns, estimate), now_ns)
        twist = self._twist(drive.v_mps, drive.yaw_rate_radps)
        self._file.write(topics.CMD_VEL, now_ns, twist, now_ns)

    def _slow(self, record: TickRecord) -> None:
        estimate = record.estimate
        self._write_ros(topics.POSE, rosmsg.pose_stamped(estimate), estimate.t_s)
        self._write_number(topics.HEADING_FILTERED, compass_deg_from_yaw(estimate.yaw_map_rad))
        if record.tracking is not None:
            self._write_number(topics.ANGLE, math.degrees(record.tracking.heading_error_rad))
        if self._goals_map_m:
            self._next_goal(estimate, record.status)
        if record.batch.wheels:
            self._sensors.wheel_transforms(self._now_ns, record.batch.wheels[-1])

    def _next_goal(self, estimate: Estimate, status: MissionStatus) -> None:
        index = min(status.waypoints_reached, len(self._goals_map_m) - 1)
        x_m, y_m = self._goals_map_m[index]
        dx_m, dy_m = x_m - estimate.x_map_m, y_m - estimate.y_map_m
        self._write_number(topics.DISTANCE, math.hypot(dx_m, dy_m))
        self._write_number(topics.BEARING, math.degrees(math.atan2(dy_m, dx_m)))

    def _mission(self, status: MissionStatus) -> None:
        before, now_s = self._status, self._now_ns / _SECOND_NS
        changed = before is None or (before.state, before.reason, before.row) != (
            status.state, status.reason, status.row,
        )  # fmt: skip
        if changed or self._now_ns >= self._next_second_ns:
            self._write_ros(topics.STATUS, rosmsg.status_json(status), now_s)
        if self._goals_map_m and (
            before is None or before.waypoints_reached != status.waypoints_reached
        ):
            goal = self._goals_map_m[min(status.waypoints_reached, len(self._goals_map_m) - 1)]
            self._write_ros(topics.GOAL_FIX, rosmsg.goal_fix(now_s, goal, self._map_frame), now_s)
        self._status = status

    def _weed_markers(self, t_s: float) -> None:
        weeds = tuple(self._weed_map()) if self._weed_map is not None else ()
        if weeds != self._weeds:
            self._weeds = weeds
            self._write_ros(topics.WEEDS, weed_markers(t_s, weeds), t_s)

    def _write_number(self, topic: Topic, value: float) -> None:
        self._file.write(topic, self._now_ns, self._number(value), self._now_ns)

    def _write_ros(self, topic: Topic, message: object, t_s: float) -> None:
        data = rosmsg.to_cdr(message)
        self._file.write(topic, self._now_ns, data, rosmsg.nanoseconds(t_s))
