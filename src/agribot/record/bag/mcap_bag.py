"""MCAP files of any program: with index or without, whole or cut off."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Message, Schema

from agribot.core.errors import RecordingError
from agribot.record.bag.source import Bag, BagFile, BagMessage, BagTopic, is_latched
from agribot.record.mcap_parsing import Summary
from agribot.record.mcap_records import McapRecords


class McapBag(Bag):
    """An MCAP file of any program.

    Raises: RecordingError: no such file, or no MCAP file.
    """

    kind = "MCAP"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        records = McapRecords(path)
        self.damage = records.find_damage()
        if self.damage or not self._use_summary(records.summary):
            self._scan()
            if not self.damage:
                self.notes.append("the file has no index; `agribot record recover` writes one")

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        topics = {t.id: t for t in self.topics if names is None or t.name in names}
        for record in McapRecords(self.path):
            if isinstance(record, Message) and record.channel_id in topics:
                topic = topics[record.channel_id]
                yield BagMessage(topic, record.log_time, record.publish_time, record.data)

    def files(self) -> Iterator[BagFile]:
        if not self.file_names:
            return
        for record in McapRecords(self.path):
            if isinstance(record, Attachment):
                yield BagFile(record.name, record.media_type, bytes(record.data))

    def _use_summary(self, summary: Summary | None) -> bool:
        """Take all from the index; False where the file has no sound one with message counts."""
        statistics = summary.statistics if summary is not None else None
        if summary is None or statistics is None or not (statistics.message_count == 0 or (
            summary.channels
        )):  # fmt: skip
            return False
        counts = Counter(dict(statistics.channel_message_counts))
        self.topics = _topics(summary.channels, summary.schemas, counts)
        self.file_names = tuple(index.name for index in summary.files)
        if statistics.message_count:
            self.times_ns = (statistics.message_start_time, statistics.message_end_time)
        self.compression = "/".join(
            sorted({chunk.compression or "none" for chunk in summary.chunks})
        )
        return True

    def _scan(self) -> None:
        records = McapRecords(self.path)
        channels: dict[int, Channel] = {}
        schemas: dict[int, Schema] = {}
        counts: Counter[int] = Counter()
        names: list[str] = []
        low, high = 2**64, -1
        for record in records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Attachment):
                names.append(record.name)
            elif isinstance(record, Message):
                counts[record.channel_id] += 1
                low, high = min(low, record.log_time), max(high, record.log_time)
        self.topics = _topics(channels, schemas, counts)
        self.file_names = tuple(names)
        self.times_ns = (low, high) if counts else None
        if not channels and any(damage.is_end for damage in self.damage):
            raise RecordingError(
                f"{self.path} was cut off before its first message; nothing to read"
            )


def _topics(channels: Any, schemas: Any, counts: Counter[int]) -> tuple[BagTopic, ...]:
    return tuple(
        _topic(channel, schemas.get(channel.schema_id), counts[channel.id])
        for _, channel in sorted(channels.items())
    )


def _topic(channel: Channel, schema: Schema | None, count: int) -> BagTopic:
    schema_name = schema.name if schema is not None else ""
    schema_encoding = schema.encoding if schema is not None else ""
    data = schema.data.decode("utf-8", "replace") if schema is not None else ""
    is_ros = channel.message_encoding in ("cdr", "ros1") and "/" in schema_name
    package, _, kind = schema_name.partition("/")
    full_name = f"{package}/msg/{kind.rpartition('/')[2]}"
    qos = channel.metadata.get("offered_qos_profiles", "")
    return BagTopic(
        id=channel.id,
        name=channel.topic,
        ros_type=full_name if is_ros else "",
        encoding=channel.message_encoding or "unknown",
        definition=data,
        definition_format={"ros2idl": "idl"}.get(schema_encoding, "msg" if is_ros else ""),
        schema_name=schema_name,
        schema_encoding=schema_encoding,
        is_latched=is_latched(qos),
        qos_yaml=qos,
        count=count,
    )
