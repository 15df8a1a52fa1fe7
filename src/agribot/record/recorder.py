"""The recorder: a tap that writes every TickRecord to `run.mcap`, for ROS 2 tools and replay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath

import msgspec

from agribot.core import topics
from agribot.core.config import RunConfig, to_toml
from agribot.core.messages import MappedPlant, Path, TickRecord
from agribot.core.robot import RobotSpec
from agribot.core.version import __version__
from agribot.record.parts import RecordingParts
from agribot.record.ticks import encode_tick
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.rosmsg import to_nanoseconds
from agribot.ros.messages.topic_writer import TopicWriter

CONFIG_ATTACHMENT = "config.toml"
URDF_ATTACHMENT = "robot.urdf"
WEED_MAP_ATTACHMENT = "weed_map.json"

_SECOND_NS = 1_000_000_000
FLUSH_NS = 500_000_000  # half of the time that may be lost; the disk may take the other half


class RunRecorder:
    """Call it with every TickRecord; a process killed later loses at most the last second.

    `weed_map` is asked once per second and at the end. `goals_map_m` are the waypoints in
    driving order. A disk that fails later ends the recording, see `ended_because`.
    Raises: RecordingError: the file cannot be created or written.
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
        self._robot, self._config, self._urdf = robot, config, urdf
        self._weed_map = weed_map
        self._now_s = 0.0
        self._next_second_ns = self._next_flush_ns = 0
        camera = CameraLog(robot, config.record.image_rate_hz, config.record.jpeg_quality)
        self._feed = TopicWriter(
            self._file.write, robot, config.field.datum, urdf, camera, config.estimate
        )
        self._feed.set_plan(0.0, plan, goals_map_m)
        self._attach_settings()

    def __call__(self, record: TickRecord) -> None:
        if self._file.ended_because:
            return
        self._now_s = record.batch.t_s
        now_ns = to_nanoseconds(self._now_s)
        self._feed(record)
        self._file.write(topics.TICK, now_ns, encode_tick(record), now_ns)
        if now_ns >= self._next_second_ns:
            self._next_second_ns = now_ns + _SECOND_NS
            self._write_weeds()
        if now_ns >= self._next_flush_ns:
            self._next_flush_ns = now_ns + FLUSH_NS
            self._file.flush()

    @property
    def ended_because(self) -> str:
        """Why recording ended before the run did; empty while it goes on."""
        return self._file.ended_because

    def truth(
        self, t_s: float, pose: tuple[float, float, float], twist: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Record the true x_map_m, y_map_m, yaw_map_rad and forward and yaw rate of a simulator."""
        self._feed.write_truth(t_s, pose, twist)

    def set_plan(
        self, t_s: float, plan: Path | None, goals_map_m: Sequence[tuple[float, float]]
    ) -> None:
        """Record a new path and its waypoints, when the mission planned again."""
        self._feed.set_plan(t_s, plan, goals_map_m)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Keep a file inside the recording, for example the report."""
        self._file.attach(name, media_type, data)

    def fill_disk(self, *, is_full: bool) -> None:
        """Let the disk count as full, as a fault."""
        self._file.fill_disk(is_full=is_full)

    def close(self) -> None:
        """Write the last weed map and the index. Safe to call twice."""
        if self._file.closed:
            return
        if self._weed_map is not None:
            self._write_weeds()
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
        self._file.drain()

    def _write_weeds(self) -> None:
        if self._weed_map is not None:
            self._feed.set_weeds(self._now_s, self._weed_map())
