"""Recording of a world without a robot's mind: sensors, drive commands and the truth."""

from __future__ import annotations

from pathlib import Path

from agribot import __version__, topics
from agribot.config import RunConfig, to_toml
from agribot.messages import DriveCommand, SensorBatch
from agribot.record.parts import RecordingParts
from agribot.record.recorder import CONFIG_ATTACHMENT, URDF_ATTACHMENT
from agribot.record.sensor_log import SLOW_NS, SensorLog
from agribot.robot import RobotSpec
from agribot.ros import cdr, rosmsg
from agribot.ros.camera_log import CameraLog
from agribot.ros.rosmsg import BODY_FRAME, MAP_FRAME, ODOM_FRAME, quaternion_from_yaw
from agribot.ros.transforms import static_transforms

_SECOND_NS = 1_000_000_000
_NOWHERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class WorldRecorder:
    """Call it once per tick; a process killed later loses at most the last second.

    The frame tree follows the truth, odom lying on map: nobody estimates anything here.
    Raises: RecordingError: the file cannot be created or written.
    """

    def __init__(self, path: Path, config: RunConfig, robot: RobotSpec, urdf: str) -> None:
        self.path = path
        self._file = RecordingParts(path, config.record)
        self._robot, self._urdf = robot, urdf
        camera = CameraLog(robot, config.record.image_rate_hz, config.record.jpeg_quality)
        self._sensors = SensorLog(self._file, robot, camera)
        self._truth, self._twist = cdr.OdometryCdr(), cdr.TwistCdr()
        self._tf = cdr.TransformsCdr(((MAP_FRAME, ODOM_FRAME), (ODOM_FRAME, BODY_FRAME)))
        self._next_slow_ns = self._next_second_ns = 0
        self._started = False
        words = {"version": __version__, "profile": config.profile, "seed": str(config.seed)}
        self._file.describe("agribot", {**words, "robot": robot.name, "world": config.world})
        self._file.attach(CONFIG_ATTACHMENT, "application/toml", to_toml(config).encode())
        self._file.attach(URDF_ATTACHMENT, "application/xml", urdf.encode())

    def __call__(
        self,
        batch: SensorBatch,
        command: DriveCommand | None,
        pose: tuple[float, float, float],
        twist: tuple[float, float],
    ) -> None:
        """`pose` is the true x_map_m, y_map_m, yaw_map_rad, `twist` the forward and yaw rate."""
        now_ns = rosmsg.nanoseconds(batch.t_s)
        if not self._started:
            self._start(now_ns)
        self._sensors(now_ns, batch)
        if command is not None:
            data = self._twist(command.v_mps, command.yaw_rate_radps)
            self._file.write(topics.CMD_VEL, now_ns, data, now_ns)
        truth = self._truth.pack(now_ns, pose, (0.0,) * 9, twist)
        self._file.write(topics.GROUND_TRUTH, now_ns, truth, now_ns)
        x_m, y_m, yaw_rad = pose
        body = (x_m, y_m, 0.0, *quaternion_from_yaw(yaw_rad))
        self._file.write(topics.TF, now_ns, self._tf(now_ns, (_NOWHERE, body)), now_ns)
        if now_ns >= self._next_slow_ns and batch.wheels:
            self._next_slow_ns = now_ns + SLOW_NS
            self._sensors.wheel_transforms(now_ns, batch.wheels[-1])
        if now_ns >= self._next_second_ns:
            self._next_second_ns = now_ns + _SECOND_NS
            self._file.flush()

    def close(self) -> None:
        """Write the index. Safe to call twice."""
        self._file.close()

    def _start(self, now_ns: int) -> None:
        self._started = True
        urdf = rosmsg.to_cdr(rosmsg.text(self._urdf))
        self._file.write(topics.ROBOT_DESCRIPTION, now_ns, urdf, now_ns)
        fixed = rosmsg.to_cdr(static_transforms(self._robot))
        self._file.write(topics.TF_STATIC, now_ns, fixed, now_ns)
