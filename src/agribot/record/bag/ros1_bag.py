"""ROS 1 bags: whole, without an index as of a recorder that died, damaged, or cut off."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
from rosbags.typesys.msg import normalize_msgtype

from agribot.core.errors import RecordingError
from agribot.record.bag.ros1_walk import (
    BAG_HEADER,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    MESSAGE,
    Ros1Hole,
    Ros1Record,
    Ros1Walk,
    parse_fields,
)
from agribot.record.bag.source import Bag, BagMessage, BagTopic
from agribot.record.damage import Damage

_COUNT = struct.Struct("<II")  # counts of a chunk's information: connection, messages


class Ros1Bag(Bag):
    """A ROS 1 bag, read record by record; its messages come in the order of the file.

    Raises: RecordingError: cut off before the first message.
    """

    kind = "ROS 1 bag"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        tally = _Tally(path.name)
        for each in self._walk():
            tally.add(each)
            if isinstance(each, Ros1Record) and each.fields.get(b"encryptor"):
                raise RecordingError(f"{path} is encrypted; first run: rosbag decrypt {path}")
        self.damage = tuple(tally.finish(path.stat().st_size))
        if not (tally.counts or tally.has_index):
            raise RecordingError(f"{path} was cut off before its first message; nothing to read")
        self.topics = tuple(
            msgspec.structs.replace(topic, count=tally.counts[number])
            for number, topic in sorted(tally.topics.items())
        )
        self.times_ns = tally.times_ns
        self.compression = "/".join(sorted(tally.compressions))
        if not tally.has_index:
            self.notes.append(
                "the bag has no index, or a damaged one; its records were read one after the other"
            )

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        topics = {t.id: t for t in self.topics if names is None or t.name in names}
        for record in self._walk():
            if isinstance(record, Ros1Record) and record.kind == MESSAGE:
                topic = topics.get(record.connection)
                if topic is not None:
                    t_ns = record.read_time_ns()
                    yield BagMessage(topic, t_ns, t_ns, record.body)

    def _walk(self) -> Iterator[Ros1Record | Ros1Hole]:
        with self.path.open("rb") as file:
            yield from Ros1Walk(file, self.path.stat().st_size)


class _Tally:
    """Count of a bag's messages, and of those missing by its index or by the times around."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.topics: dict[int, BagTopic] = {}
        self.counts: Counter[int] = Counter()
        self.times_ns: tuple[int, int] | None = None
        self.compressions: set[str] = set()
        self._chunks: int | None = None  # number of chunks by the bag's header
        self._stated: list[int] = []  # messages of each chunk, by the index
        self._holes: list[tuple[Ros1Hole, int | None, int | None]] = []

    @property
    def has_index(self) -> bool:
        return self._chunks == len(self._stated)

    def add(self, each: Ros1Record | Ros1Hole) -> None:
        if isinstance(each, Ros1Hole):
            last_ns = self.times_ns[1] if self.times_ns is not None else None
            self._holes.append((each, last_ns, None))
        elif each.kind == MESSAGE:
            self._add_message(each)
        elif each.kind == CONNECTION:
            self.topics.setdefault(each.connection, _make_topic(each))
        elif each.kind == CHUNK:
            self.compressions.add(each.fields.get(b"compression", b"").decode("ascii", "replace"))
        elif each.kind == CHUNK_INFO:
            self._stated.append(sum(count for _, count in _COUNT.iter_unpack(each.body)))
        elif each.kind == BAG_HEADER and any(each.fields[b"index_pos"]):
            self._chunks = int.from_bytes(each.fields.get(b"chunk_count", b""), "little")

    def finish(self, size: int) -> Iterator[Damage]:
        begin_ns = self.times_ns[0] if self.times_ns is not None else None
        missing = sum(self._stated) - sum(self.counts.values()) if self.has_index else None
        for hole, after_ns, before_ns in self._holes:
            is_known = missing is not None and (len(self._holes) == 1 or not missing)
            yield Damage(
                what=f"{self._name}: bytes {hole.offset} to {hole.end} are damaged",
                begin_ns=begin_ns,
                after_ns=after_ns,
                before_ns=before_ns,
                lost_messages=missing if is_known else None,
                lost_bytes=hole.end - hole.offset,
                is_end=hole.end == size,
            )
        if missing and not self._holes:
            what = f"{self._name}: its index names {missing} messages more than it holds"
            yield Damage(what=what, begin_ns=begin_ns, lost_messages=max(missing, 0))
        orphans = sum(n for number, n in self.counts.items() if number not in self.topics)
        if orphans:
            what = f"{self._name}: the definition of a topic is damaged"
            yield Damage(what=what, begin_ns=begin_ns, lost_messages=orphans)

    def _add_message(self, record: Ros1Record) -> None:
        t_ns = record.read_time_ns()
        self.counts[record.connection] += 1
        low, high = self.times_ns or (t_ns, t_ns)
        self.times_ns = min(low, t_ns), max(high, t_ns)
        if self._holes and self._holes[-1][2] is None:
            hole, after_ns, _ = self._holes[-1]
            self._holes[-1] = hole, after_ns, t_ns


def _make_topic(record: Ros1Record) -> BagTopic:
    about = parse_fields(record.body) or {}
    text = {name: value.decode("utf-8", "replace") for name, value in about.items()}
    return BagTopic(
        id=record.connection,
        name=record.fields.get(b"topic", b"").decode("utf-8", "replace"),
        ros_type=normalize_msgtype(text.get(b"type", "")),
        encoding="ros1",
        definition=text.get(b"message_definition", ""),
        definition_format="msg",
        is_latched=about.get(b"latching") == b"1",
    )
