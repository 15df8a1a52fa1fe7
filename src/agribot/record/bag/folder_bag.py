"""A rosbag2 folder of several files, also one whose recorder died before metadata.yaml."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from agribot.record.bag.source import Bag, BagFile, BagMessage, BagTopic


class FolderBag(Bag):
    """The parts one after the other; the same topic of several parts is one topic."""

    def __init__(self, path: Path, parts: Sequence[Bag]) -> None:
        super().__init__(path)
        self.parts = tuple(parts)
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
        if not (path / "metadata.yaml").exists():
            self.notes.append("metadata.yaml is missing; the files were read by themselves")
        self._merged = merged
        self.topics = tuple(merged.values())
        self.file_names = tuple(name for part in self.parts for name in part.file_names)
        times = [part.times_ns for part in self.parts if part.times_ns is not None]
        if times:
            self.times_ns = (min(t[0] for t in times), max(t[1] for t in times))
        self.compression = "/".join(sorted({part.compression for part in self.parts} - {""}))

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        for part in self.parts:
            for message in part.messages(names):
                topic = message.topic
                merged = self._merged[topic.name, topic.schema_name or topic.ros_type]
                yield message._replace(topic=merged)

    def files(self) -> Iterator[BagFile]:
        for part in self.parts:
            yield from part.files()

    def close(self) -> None:
        for part in self.parts:
            part.close()
