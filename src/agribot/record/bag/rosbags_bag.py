"""ROS 1 bags and rosbag2 databases, through the maintained readers of rosbags."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.interfaces import MessageDefinitionFormat, Qos
from rosbags.rosbag1.reader import decompressors

from agribot.core.errors import RecordingError
from agribot.record.bag.source import Bag, BagMessage, BagTopic

_FORMATS = {MessageDefinitionFormat.MSG: "msg", MessageDefinitionFormat.IDL: "idl"}


class RosbagsBag(Bag):
    """A `.bag`, a `.db3` or a rosbag2 folder.

    Raises: RecordingError: the file is not what its name says, or is damaged.
    """

    def __init__(self, path: Path, is_ros1: bool = False) -> None:
        super().__init__(path)
        self._is_ros1 = is_ros1
        self.kind = "ROS 1 bag" if self._is_ros1 else "rosbag2"
        with _refuse_damage(path):
            self._reader: Any = rosbag1.Reader(path) if self._is_ros1 else rosbag2.Reader(path)
            self._reader.open()
        self._is_open = True
        self.topics = tuple(self._topic(connection) for connection in self._reader.connections)
        if self.count:
            self.times_ns = (self._reader.start_time, self._reader.end_time - 1)
        self.compression = self._compression()
        if not self._is_ros1 and not any(topic.definition for topic in self.topics) and self.topics:
            self.notes.append("it brings no message definitions; those of ROS 2 Jazzy are assumed")

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        by_id = {id(c): t for c, t in zip(self._reader.connections, self.topics, strict=True)}
        wanted = [c for c in self._reader.connections if names is None or c.topic in names]
        if not wanted:
            return
        topics = {(c.id, c.topic): by_id[id(c)] for c in wanted}
        with _refuse_damage(self.path):
            for connection, t_ns, data in self._reader.messages(connections=wanted):
                topic = topics[connection.id, connection.topic]
                yield BagMessage(topic, t_ns, t_ns, bytes(data))

    def close(self) -> None:
        if self._is_open:
            self._is_open = False
            self._reader.close()

    def _topic(self, connection: Any) -> BagTopic:
        profiles: list[Qos] = getattr(connection.ext, "offered_qos_profiles", None) or []
        latched = any(qos.durability.name == "TRANSIENT_LOCAL" for qos in profiles)
        return BagTopic(
            id=connection.id,
            name=connection.topic,
            ros_type=connection.msgtype,
            encoding="ros1" if self._is_ros1 else "cdr",
            definition=connection.msgdef.data,
            definition_format=_FORMATS.get(connection.msgdef.format, ""),
            is_latched=bool(getattr(connection.ext, "latching", 0)) or latched,
            count=connection.msgcount,
        )

    def _compression(self) -> str:
        if not self._is_ros1:
            return self._reader.compression_format or ""
        names = {function: name for name, function in decompressors.items()}
        return "/".join(
            sorted({names[chunk.decompressor] for chunk in self._reader.chunks.values()})
        )


@contextlib.contextmanager
def _refuse_damage(path: Path) -> Iterator[None]:
    try:
        yield
    except (RecordingError, GeneratorExit):
        raise
    except Exception as error:  # damaged bytes surface as any error of rosbags, SQLite or bz2
        reason = str(error).strip().rstrip(".") or type(error).__name__
        raise RecordingError(f"{path} cannot be read as a recording: {reason}") from error
