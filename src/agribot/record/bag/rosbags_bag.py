"""ROS 1 bags with an index, through the maintained reader of rosbags."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags import rosbag1
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag1.reader import decompressors

from agribot.core.errors import RecordingError
from agribot.record.bag.source import Bag, BagMessage, BagTopic

_FORMATS = {MessageDefinitionFormat.MSG: "msg", MessageDefinitionFormat.IDL: "idl"}


class RosbagsBag(Bag):
    """A sound `.bag`; its messages come in the order of their times.

    Raises: RecordingError: the file is not what its name says, or is damaged.
    """

    kind = "ROS 1 bag"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with _refuse_damage(path):
            self._reader: Any = rosbag1.Reader(path)
            self._reader.open()
        self._is_open = True
        self.topics = tuple(_topic(connection) for connection in self._reader.connections)
        if self.count:
            self.times_ns = (self._reader.start_time, self._reader.end_time - 1)
        names = {function: name for name, function in decompressors.items()}
        used = {names[chunk.decompressor] for chunk in self._reader.chunks.values()}
        self.compression = "/".join(sorted(used))

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


def _topic(connection: Any) -> BagTopic:
    return BagTopic(
        id=connection.id,
        name=connection.topic,
        ros_type=connection.msgtype,
        encoding="ros1",
        definition=connection.msgdef.data,
        definition_format=_FORMATS.get(connection.msgdef.format, ""),
        is_latched=bool(getattr(connection.ext, "latching", 0)),
        count=connection.msgcount,
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
