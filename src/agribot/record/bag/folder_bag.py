"""A rosbag2 folder of several files, also one whose recorder died before metadata.yaml."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import zstandard

from agribot.record.bag.source import Bag, BagFile, BagMessage, BagTopic
from agribot.record.damage import Damage, warn_of


class FolderBag(Bag):
    """The parts one after the other; the same topic of several parts is one topic.

    `is_packed`: each message is a zstd frame of its own.
    """

    def __init__(self, path: Path, parts: Sequence[Bag], is_packed: bool = False) -> None:
        super().__init__(path)
        self.parts, self._is_packed = tuple(parts), is_packed
        self.kind = f"rosbag2 folder of {len(self.parts)} {self.parts[0].kind} files"
        merged: dict[tuple[str, str], BagTopic] = {}
        for part in self.parts:
            for topic in part.topics:
                key = (topic.name, topic.schema_name or topic.ros_type)
                before = merged.get(key)
                merged[key] = msgspec.structs.replace(
                    before or topic,
                    id=before.id if before else len(merged),
                    count=topic.count + (before.count if before else 0),
                )
            self.notes += [f"{part.path.name}: {note}" for note in part.notes]
        self.damage = tuple(each for part in self.parts for each in part.damage)
        packed = {"zstd"} if is_packed else {part.compression for part in self.parts}
        self.compression = "/".join(sorted(packed - {""}))
        if not (path / "metadata.yaml").exists():
            self.notes.append("metadata.yaml is missing; the files were read by themselves")
        self._merged = merged
        self.topics = tuple(merged.values())
        self.file_names = tuple(name for part in self.parts for name in part.file_names)
        times = [part.times_ns for part in self.parts if part.times_ns is not None]
        if times:
            self.times_ns = (min(t[0] for t in times), max(t[1] for t in times))

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        for part in self.parts:
            for message in part.messages(names):
                topic = message.topic
                merged = self._merged[topic.name, topic.schema_name or topic.ros_type]
                data = _unpack(message.data) if self._is_packed else message.data
                if data is None:
                    self._warn_of_message(message)
                else:
                    yield message._replace(topic=merged, data=data)

    def _warn_of_message(self, message: BagMessage) -> None:
        begin_ns = self.times_ns[0] if self.times_ns is not None else None
        what = f"{self.path.name}: a message on {message.topic.name} is no sound zstd frame"
        at_ns = message.log_ns
        warn_of(
            [Damage(what=what, begin_ns=begin_ns, after_ns=at_ns, before_ns=at_ns, lost_messages=1)]
        )

    def files(self) -> Iterator[BagFile]:
        for part in self.parts:
            yield from part.files()

    def close(self) -> None:
        for part in self.parts:
            part.close()


def _unpack(data: bytes) -> bytes | None:
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError:
        return None
