"""A rosbag2 folder of several files, also one whose recorder died before metadata.yaml."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import zstandard

from agribot.record.bag.rosbag2_metadata import NAME, Rosbag2Metadata, read_metadata
from agribot.record.bag.source import Bag, BagFile, BagMessage, BagTopic
from agribot.record.damage import Damage, warn_of


class FolderBag(Bag):
    """The parts one after the other; the same topic of several parts is one topic.

    `refused` are files that cannot be read at all.
    Raises: RecordingError: its messages are compressed in a way that is not read.
    """

    def __init__(self, path: Path, parts: Sequence[Bag], refused: Sequence[Damage] = ()) -> None:
        super().__init__(path)
        self.parts, about = tuple(parts), read_metadata(path)
        self._is_packed = about is not None and about.is_packed
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
        self.damage = (*refused, *(each for part in self.parts for each in part.damage))
        packed = {"zstd"} if self._is_packed else {part.compression for part in self.parts}
        self.compression = "/".join(sorted(packed - {""}))
        if about is None:
            state = "damaged" if (path / NAME).exists() else "missing"
            self.notes.append(f"{NAME} is {state}; the files were read by themselves")
        self._merged = merged
        self.topics = tuple(merged.values())
        self.file_names = tuple(name for part in self.parts for name in part.file_names)
        times = [part.times_ns for part in self.parts if part.times_ns is not None]
        if times:
            self.times_ns = (min(t[0] for t in times), max(t[1] for t in times))
        if about is not None:
            self.damage += tuple(self._compare(about))

    def _compare(self, about: Rosbag2Metadata) -> Iterator[Damage]:
        """Compare the files with what the folder's description says."""
        begin_ns = self.times_ns[0] if self.times_ns is not None else None
        missing = [name for name in about.files if not (self.path / name).exists()]
        lost = None if about.messages is None else max(about.messages - self.count, 0)
        if missing:
            what = f"{self.path.name}: {', '.join(missing)} of {NAME} is not there"
            yield Damage(what=what, begin_ns=begin_ns, lost_messages=lost)
        elif lost and not self.damage:
            stated = f"{about.messages} messages, {self.count} are there"
            what = f"{self.path.name}: {NAME} names {stated}"
            yield Damage(what=what, begin_ns=begin_ns, lost_messages=lost)

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        broken: Counter[str] = Counter()
        for part in self.parts:
            for message in part.messages(names):
                topic = message.topic
                merged = self._merged[topic.name, topic.schema_name or topic.ros_type]
                data = _unpack(message.data) if self._is_packed else message.data
                if data is None:
                    broken[topic.name] += 1
                else:
                    yield message._replace(topic=merged, data=data)

        warn_of(
            Damage(
                what=f"{self.path.name}: messages on {name} are no sound zstd frames",
                lost_messages=count,
            )
            for name, count in broken.items()
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
