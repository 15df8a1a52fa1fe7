"""ROS 1 bags without an index: a recorder that died, or a copy that was cut off.

rosbags reads by the index at the end of the file. Here the records are taken one after the
other instead. Source of the format: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

import msgspec
from rosbags.rosbag1.reader import decompressors
from rosbags.typesys.msg import normalize_msgtype

from agribot.core.errors import RecordingError
from agribot.record.bag.source import Bag, BagMessage, BagTopic

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG_HEADER, _CHUNK, _CONNECTION = 2, 3, 5, 7
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")


class _Record(NamedTuple):
    op: int
    fields: dict[str, bytes]
    body: bytes


class _Damage(Exception):
    """The rest of the file cannot be understood."""


def has_no_index(path: Path) -> bool:
    """Tell whether the header says so, or points behind the end of the file."""
    try:
        with path.open("rb") as file:
            file.read(len(_MAGIC))
            header = _read_record(file, path.stat().st_size)
    except _Damage:
        return True
    index_at = header.fields.get("index_pos", b"") if header is not None else b""
    return len(index_at) != 8 or not 0 < struct.unpack("<Q", index_at)[0] < path.stat().st_size


class UnindexedBag(Bag):
    """A ROS 1 bag without an index. Raises: RecordingError: cut off before the first message.

    Raises: RecordingError: cut off before the first message.
    """

    kind = "ROS 1 bag"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._connections: dict[int, BagTopic] = {}
        self._good_bytes = 0
        counts: Counter[int] = Counter()
        low, high = 2**64, -1
        for record in self._records():
            if record.op == _MESSAGE:
                t_ns = _read_time_ns(record.fields)
                counts[_read_connection(record.fields)] += 1
                low, high = min(low, t_ns), max(high, t_ns)
        if not counts:
            raise RecordingError(f"{path} was cut off before its first message; nothing to read")
        self.topics = tuple(
            msgspec.structs.replace(topic, count=counts[number])
            for number, topic in sorted(self._connections.items())
        )
        self.times_ns = (low, high)
        lost = path.stat().st_size - self._good_bytes
        self.notes.append(
            f"the bag has no index or a damaged one; read up to the last sound record, "
            f"{lost} bytes behind it are ignored"
        )

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        topics = {t.id: t for t in self.topics if names is None or t.name in names}
        for record in self._records():
            topic = topics.get(_read_connection(record.fields)) if record.op == _MESSAGE else None
            if topic is not None:
                t_ns = _read_time_ns(record.fields)
                yield BagMessage(topic, t_ns, t_ns, record.body)

    def _records(self) -> Iterator[_Record]:
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            file.read(len(_MAGIC))
            try:
                while (record := _read_record(file, size)) is not None:
                    for inner in _unpack(record):
                        _check_time(inner)
                        self._note_connection(inner)
                        yield inner
                    self._good_bytes = file.tell()
            except _Damage:
                return

    def _note_connection(self, record: _Record) -> None:
        if record.op != _CONNECTION:
            return
        number = _read_connection(record.fields)
        about = _parse_fields(record.body)
        self._connections.setdefault(
            number,
            BagTopic(
                id=number,
                name=record.fields.get("topic", b"").decode("utf-8", "replace"),
                ros_type=normalize_msgtype(about.get("type", b"").decode("utf-8", "replace")),
                encoding="ros1",
                definition=about.get("message_definition", b"").decode("utf-8", "replace"),
                definition_format="msg",
                is_latched=about.get("latching") == b"1",
            ),
        )


def _unpack(record: _Record) -> Iterator[_Record]:
    """Iterate over the records inside a chunk, or over the record itself."""
    if record.op != _CHUNK:
        yield record
        return
    try:
        data = decompressors[record.fields["compression"].decode()](record.body)
    except Exception as error:  # each decompressor has errors of its own for damaged bytes
        raise _Damage from error
    stream = io.BytesIO(data)
    while (inner := _read_record(stream, len(data))) is not None:
        yield inner


def _read_record(file: IO[bytes], size: int) -> _Record | None:
    """Read a record; None at the end.

    Raises: _Damage: not enough bytes, or bytes without sense.
    """
    head = _read_sized(file, size)
    if head is None:
        return None
    fields = _parse_fields(head)
    body = _read_sized(file, size)
    if body is None or len(fields.get("op", b"")) != 1:
        raise _Damage
    return _Record(fields["op"][0], fields, body)


def _read_sized(file: IO[bytes], size: int) -> bytes | None:
    raw = file.read(_LENGTH.size)
    if not raw:
        return None
    if len(raw) < _LENGTH.size:
        raise _Damage
    (length,) = _LENGTH.unpack(raw)
    if length > size - file.tell():
        raise _Damage
    return file.read(length)


def _parse_fields(data: bytes) -> dict[str, bytes]:
    fields, at = {}, 0
    while at + _LENGTH.size <= len(data):
        (length,) = _LENGTH.unpack_from(data, at)
        name, separator, value = data[at + 4 : at + 4 + length].partition(b"=")
        if not separator:
            raise _Damage
        fields[name.decode("ascii", "replace")] = value
        at += 4 + length
    return fields


def _read_connection(fields: dict[str, bytes]) -> int:
    return int.from_bytes(fields.get("conn", b""), "little")


def _check_time(record: _Record) -> None:
    """Refuse a message without a time.

    Raises: _Damage: a message without one.
    """
    if record.op == _MESSAGE:
        _read_time_ns(record.fields)


def _read_time_ns(fields: dict[str, bytes]) -> int:
    raw = fields.get("time", b"")
    if len(raw) != _TIME.size:
        raise _Damage
    seconds, nanoseconds = _TIME.unpack(raw)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
