"""A recording as a platform: the same batches again, the commands collected."""

from __future__ import annotations

import tomllib
from collections.abc import Generator
from pathlib import Path

import msgspec
import numpy as np

from agribot.core import topics
from agribot.core.config import RunConfig
from agribot.core.errors import EndOfRecording, RecordingError
from agribot.core.messages import (
    STOP,
    DriveCommand,
    FloatArray,
    Inbox,
    MappedPlant,
    RobotCommand,
    Scene,
    SensorBatch,
    TickRecord,
)
from agribot.record.events import Event
from agribot.record.mcap_file import (
    find_damage,
    read_attachment,
    read_attachment_unless_damaged,
    read_messages,
)
from agribot.record.recorder import CONFIG_ATTACHMENT, URDF_ATTACHMENT, WEED_MAP_ATTACHMENT
from agribot.record.ticks import decode_tick
from agribot.ros.messages.rosmsg import load_types


def read_config(path: Path) -> RunConfig:
    """Read the resolved settings of the recorded run.

    Raises: RecordingError: not a recording, or one with settings this version does not know.
    """
    text = read_attachment(path, CONFIG_ATTACHMENT).decode()
    try:
        return msgspec.convert(tomllib.loads(text), RunConfig)
    except (msgspec.ValidationError, tomllib.TOMLDecodeError) as error:
        raise RecordingError(
            f"the settings inside {path} do not fit this version ({error}); "
            "replay it with the version that recorded it"
        ) from error


def read_urdf(path: Path) -> str:
    return read_attachment(path, URDF_ATTACHMENT).decode()


def read_ticks(path: Path) -> Generator[TickRecord]:
    """Read every recorded tick in order that is not in a damaged part."""
    for message in read_messages(path, topics.TICK):
        yield decode_tick(message.data)


def read_weed_map(path: Path) -> tuple[MappedPlant, ...]:
    """Read the weed map at the end of the run; only a run that was closed has one."""
    return _decode_plants(read_attachment(path, WEED_MAP_ATTACHMENT))


def read_weed_map_unless_damaged(path: Path) -> tuple[MappedPlant, ...]:
    """Read the weed map at the end of the run; nothing where it is lost in damage."""
    return _decode_plants(read_attachment_unless_damaged(path, WEED_MAP_ATTACHMENT) or b"[]")


def _decode_plants(data: bytes) -> tuple[MappedPlant, ...]:
    return msgspec.json.decode(data, type=tuple[MappedPlant, ...])


def read_truth(path: Path) -> FloatArray:
    """Read the truth, (N, 4): t_s, x_map_m, y_map_m, yaw_map_rad; no rows where none was known."""
    rows = []
    for message in read_messages(path, topics.GROUND_TRUTH):
        odometry = load_types().deserialize_cdr(message.data, topics.GROUND_TRUTH.ros_type)
        pose = odometry.pose.pose  # type: ignore[attr-defined]
        yaw = 2.0 * np.arctan2(pose.orientation.z, pose.orientation.w)
        rows.append((message.publish_time * 1e-9, pose.position.x, pose.position.y, yaw))
    return np.array(rows, dtype=float).reshape(-1, 4)


def read_gaps(path: Path) -> tuple[Event, ...]:
    """Find the times from which on the recording lacks messages or files, as events."""
    return tuple(
        Event(t_s=(gap.after_ns or gap.begin_ns or 0) * 1e-9, kind="lost", reason=gap.describe())
        for gap in find_damage(path)
        if gap.is_loss
    )


class ReplayPlatform:
    """Platform over `run.mcap`: read() gives what the sensors said, write() only collects.

    What is posted into its inbox comes after what was asked of the robot then.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._ticks = read_ticks(path)
        self._scenes: tuple[Scene, ...] = ()
        self._sent = STOP
        self.commands: list[RobotCommand] = []
        self.inbox = Inbox()

    def read(self) -> SensorBatch:
        """Return the next recorded batch.

        Raises: EndOfRecording: the last batch was already given.
        """
        record = next(self._ticks, None)
        if record is None:
            raise EndOfRecording(f"{self._path} has no more ticks; start it again")
        self._scenes, self._sent = record.scenes, record.command.drive
        requests, hand = self.inbox.drain(record.batch.t_s)
        if not (requests or hand):
            return record.batch
        batch = record.batch
        return msgspec.structs.replace(
            batch, requests=(*batch.requests, *requests), hand=(*batch.hand, *hand)
        )

    def recorded_scenes(self) -> tuple[Scene, ...]:
        """Return what perception delivered in the tick of the last batch."""
        return self._scenes

    def recorded_drive(self) -> DriveCommand:
        """Return the drive command of the tick of the last batch."""
        return self._sent

    def write(self, command: RobotCommand) -> None:
        self.commands.append(command)

    def close(self) -> None:
        self._ticks.close()


def recorded_scenes(path: Path) -> Generator[tuple[Scene, ...]]:
    """Read the scenes of each tick in order, to stand in for the network."""
    for record in read_ticks(path):
        yield record.scenes


def find_late_plans(path: Path) -> frozenset[float]:
    """Find the times of the ticks in which a way was due and not there."""
    return frozenset(record.batch.t_s for record in read_ticks(path) if record.is_plan_late)
