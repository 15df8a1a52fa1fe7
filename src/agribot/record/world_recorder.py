"""Recording of a simulated world alone: sensors, drive commands and the truth."""

from __future__ import annotations

from pathlib import Path

from agribot.core.config import RunConfig, to_toml
from agribot.core.robot import RobotSpec
from agribot.core.version import __version__
from agribot.record.parts import RecordingParts
from agribot.record.recorder import CONFIG_ATTACHMENT, FLUSH_NS, URDF_ATTACHMENT
from agribot.ros.messages import rosmsg
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.world_topic_writer import WorldTick, WorldTopicWriter


class WorldRecorder:
    """A recorder to call once per tick; a process killed later loses at most a second.

    Raises: RecordingError: the file cannot be created or written.
    """

    def __init__(self, path: Path, config: RunConfig, robot: RobotSpec, urdf: str) -> None:
        self.path = path
        self._file = RecordingParts(path, config.record)
        camera = CameraLog(robot, config.record.image_rate_hz, config.record.jpeg_quality)
        self._feed = WorldTopicWriter(
            self._file.write, robot, urdf, camera, config.estimate, has_map=True
        )
        self._next_flush_ns = 0
        words = {"version": __version__, "profile": config.profile, "seed": str(config.seed)}
        self._file.describe("agribot", {**words, "robot": robot.name, "world": config.world})
        self._file.attach(CONFIG_ATTACHMENT, "application/toml", to_toml(config).encode())
        self._file.attach(URDF_ATTACHMENT, "application/xml", urdf.encode())
        self._file.drain()

    def __call__(self, tick: WorldTick) -> None:
        self._feed(tick)
        now_ns = rosmsg.to_nanoseconds(tick.batch.t_s)
        if now_ns >= self._next_flush_ns:
            self._next_flush_ns = now_ns + FLUSH_NS
            self._file.flush()

    def close(self) -> None:
        """Write the index. Safe to call twice."""
        self._file.close()
