"""The records of a ROS 1 bag in file order, and behind damage the next sound one.

rosbags reads by the index at the end of the file. Here the records are taken one after the other.
An uncompressed chunk is entered like a part of the file, so that damage costs single messages; a
compressed one is lost as a whole. Source of the format: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from typing import IO, NamedTuple

from rosbags.rosbag1.reader import decompressors

from agribot.record.mcap_parsing import read_bytes

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG_HEADER, INDEX_DATA, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")
_SECOND_NS = 1_000_000_000
# The field of a header that says the kind of its record.
_KIND_FIELD = re.compile(rb"\x04\x00\x00\x00op=[\x02-\x07]")
_LARGEST_HEADER_BYTES = 1 << 16
_SEARCHED_BYTES = 400  # bytes of a header before the field of its kind: topics may be as long
_WINDOW = 1 << 20  # bytes that are searched at once
_LINKS = 3  # records that follow one another are taken for sound
_NEEDED: dict[int, dict[bytes, int]] = {  # fields of each kind, and their bytes
    MESSAGE: {b"conn": 4, b"time": 8},
    BAG_HEADER: {b"index_pos": 8},
    INDEX_DATA: {b"conn": 4, b"count": 4},
    CHUNK: {b"size": 4},
    CHUNK_INFO: {b"chunk_pos": 8, b"start_time": 8, b"end_time": 8, b"count": 4},
    CONNECTION: {b"conn": 4},
}


class Ros1Record(NamedTuple):
    """A record; its body lies from `body_at` to `end`, `offset` is where its chunk begins."""

    kind: int
    fields: dict[bytes, bytes]
    offset: int
    body_at: int
    end: int
    body: bytes = b""

    @property
    def connection(self) -> int:
        return int.from_bytes(self.fields.get(b"conn", b""), "little")

    def read_time_ns(self, name: bytes = b"time") -> int:
        seconds, nanoseconds = _TIME.unpack(self.fields[name])
        return int(seconds) * _SECOND_NS + int(nanoseconds)


class Ros1Hole(NamedTuple):
    """Bytes that are no record, from `offset` to `end`."""

    offset: int
    end: int


class Ros1Walk:
    """Iterate over the records of a bag, those in chunks too, and the holes between them."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self._file, self._size = file, size

    def __iter__(self) -> Iterator[Ros1Record | Ros1Hole]:
        at = len(MAGIC)
        while at < self._size:
            found = self._read_at(at)
            if found is None:
                hole = Ros1Hole(at, self._find_next(at))
                at = hole.end
                yield hole
                continue
            at = found[-1].end
            yield from found

    def _read_at(self, at: int) -> list[Ros1Record] | None:
        """Read a record with its body, or those of a compressed chunk with the chunk itself."""
        record = self.parse_at(at)
        if record is None:
            return None
        if record.kind != CHUNK:
            body = read_bytes(self._file, record.body_at, record.end - record.body_at)
            return [record._replace(body=body)]
        if record.fields.get(b"compression") == b"none":
            return [record._replace(end=record.body_at)]  # its records follow
        inner = self._unpack(record)
        return None if inner is None else [*inner, record]

    def parse_at(self, at: int) -> Ros1Record | None:
        """Parse the head of a record; None for other bytes."""
        head = self._read_sized(at, _LARGEST_HEADER_BYTES)
        fields = None if head is None else parse_fields(head)
        if head is None or fields is None or not _is_complete(fields):
            return None
        body_at = at + 2 * _LENGTH.size + len(head)
        raw = read_bytes(self._file, body_at - _LENGTH.size, _LENGTH.size)
        if len(raw) < _LENGTH.size:
            return None
        end = body_at + _LENGTH.unpack(raw)[0]
        is_entered = fields.get(b"compression") == b"none"  # also where its end was cut off
        if end > self._size and not is_entered:
            return None
        return Ros1Record(fields[b"op"][0], fields, at, body_at, end)

    def _read_sized(self, at: int, limit: int) -> bytes | None:
        raw = read_bytes(self._file, at, _LENGTH.size)
        if len(raw) < _LENGTH.size:
            return None
        (length,) = _LENGTH.unpack(raw)
        if length > min(limit, self._size - at):
            return None
        return read_bytes(self._file, at + _LENGTH.size, length)

    def _unpack(self, chunk: Ros1Record) -> list[Ros1Record] | None:
        body = read_bytes(self._file, chunk.body_at, chunk.end - chunk.body_at)
        try:
            data = decompressors[chunk.fields[b"compression"].decode()](body)
        except Exception:  # noqa: BLE001  each decompressor has errors of its own for damaged bytes
            return None
        inside, at, found = Ros1Walk(io.BytesIO(data), len(data)), 0, []
        while at < len(data):
            record = inside.parse_at(at)
            if record is None:
                return None
            found.append(record._replace(body=data[record.body_at : record.end]))
            at = record.end
        return [record._replace(offset=chunk.offset) for record in found]

    def _find_next(self, start: int) -> int:
        """Find the next sound record behind `start`; the end of the file without one."""
        stated = self.parse_at(start)
        if stated is not None and self._is_chain(stated.end):
            return stated.end
        at = start + 1
        while at < self._size:
            window = read_bytes(self._file, at, _WINDOW + _SEARCHED_BYTES)
            for match in _KIND_FIELD.finditer(window):
                found = self._find_start(at + match.start(), start + 1)
                if found is not None:
                    return found
            at += _WINDOW
        return self._size

    def _find_start(self, field_at: int, first: int) -> int | None:
        """Find the beginning of the record that has the field of its kind at `field_at`."""
        lowest = max(first, field_at - _SEARCHED_BYTES)
        before = read_bytes(self._file, lowest, field_at - lowest)
        for back in range(len(before) - _LENGTH.size, -1, -1):
            (length,) = _LENGTH.unpack_from(before, back)
            reach = len(before) - back - _LENGTH.size
            if reach < length <= _LARGEST_HEADER_BYTES and self._is_chain(lowest + back):
                return lowest + back
        return None

    def _is_chain(self, at: int) -> bool:
        """Return whether records follow one another here, or the last ones of the file."""
        for _ in range(_LINKS):
            if at == self._size:
                return True
            found = self._read_at(at)
            if found is None:
                return False
            at = found[-1].end
        return True


def parse_fields(data: bytes) -> dict[bytes, bytes] | None:
    """Parse the fields of a header; None where they do not fill it exactly."""
    fields, at = {}, 0
    while at < len(data):
        if at + _LENGTH.size > len(data):
            return None
        (length,) = _LENGTH.unpack_from(data, at)
        at += _LENGTH.size
        name, separator, value = data[at : at + length].partition(b"=")
        at += length
        if not separator or at > len(data):
            return None
        fields[name] = value
    return fields


def _is_complete(fields: dict[bytes, bytes]) -> bool:
    kind = fields.get(b"op", b"")
    needed = _NEEDED.get(kind[0]) if len(kind) == 1 else None
    if needed is None or any(len(fields.get(name, b"")) != size for name, size in needed.items()):
        return False
    return b"time" not in fields or _TIME.unpack(fields[b"time"])[1] < _SECOND_NS
