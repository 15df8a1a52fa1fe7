"""What was read of an MCAP file, and what by its index and by the times around is missing."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import IO, Any

from mcap.records import Channel, Chunk, DataEnd, Message

from agribot.record.damage import Damage
from agribot.record.mcap_parsing import (
    DATA_END_BYTES,
    MessageIndex,
    Summary,
    break_up,
    parse_record,
    read_bytes,
    read_footer,
    read_record,
)
from agribot.record.mcap_walk import Hole

_WINDOW = 1 << 20  # bytes that are summed up at once


class Tally:
    """Counts and times of the sound records; it makes `Damage` of the holes between them."""

    def __init__(self, name: str, file: IO[bytes], size: int, summary: Summary | None) -> None:
        self._name, self._file, self._size, self._summary = name, file, size, summary
        self._hole: Hole | None = None
        self._has_damage = False
        self._chunks = self._data_crc = 0
        self._channel_ids: set[int] = set()
        self._orphans = 0
        self._begin_ns: int | None = None
        self._last_ns: int | None = None
        statistics = summary.statistics if summary is not None else None
        if statistics is not None and statistics.message_count:
            self._begin_ns = statistics.message_start_time

    def add_hole(self, hole: Hole) -> None:
        """Note bytes that are no record; those before the next message are one stretch."""
        self._has_damage = True
        start = hole.offset if self._hole is None else self._hole.offset
        self._hole = Hole(start, hole.end)

    def close_hole(self, record: Any) -> Iterator[Any]:
        """Give the damage before a chunk or a message, and the definitions lost in it."""
        if self._hole is None or not isinstance(record, Chunk | Message):
            return
        if isinstance(record, Message):
            before_ns: int | None = record.log_time
        else:
            before_ns = _read_times(record)[0]
        yield self._make_damage(self._hole, before_ns)
        self._hole = None
        if self._summary is not None:
            self._channel_ids.update(self._summary.channels)
            yield from self._summary.schemas.values()
            yield from self._summary.channels.values()

    def add(self, record: Any) -> None:
        if isinstance(record, Message):
            self._add_time(record.log_time)
            self._orphans += record.channel_id not in self._channel_ids
        elif isinstance(record, Channel):
            self._channel_ids.add(record.id)
        elif isinstance(record, DataEnd):
            self._data_crc = record.data_section_crc

    def add_chunk(self, chunk: Chunk) -> None:
        self._chunks += 1
        for t_ns in _read_times(chunk):
            if t_ns is not None:
                self._add_time(t_ns)

    def finish(self, data_end: int | None) -> Iterator[Damage]:
        """Give what is missing at the end, and messages whose topic nothing defines.

        `data_end` is where the data section ended, None in a file that was cut off.
        """
        if data_end is None:
            yield self._describe_end()
        elif self._hole is not None:
            yield self._make_damage(self._hole, None)
        elif not self._has_damage:
            yield from self._compare_index(data_end)
            yield from self._compare_checksum(data_end)
        if self._orphans:
            what = f"{self._name}: the definition of a topic is damaged"
            yield Damage(what=what, begin_ns=self._begin_ns, lost_messages=self._orphans)

    def _compare_index(self, data_end: int) -> Iterator[Damage]:
        """Compare an undamaged file with its index."""
        footer = read_footer(self._file, self._size)
        if footer is None or not footer.summary_start:
            return
        if footer.summary_start != data_end:
            moved = f"its index belongs at byte {footer.summary_start} and lies at {data_end}"
            yield Damage(what=f"{self._name}: {moved}; bytes were lost or added")
        elif self._summary is None:
            yield Damage(what=f"{self._name}: its index is damaged", lost_messages=0)
        elif self._summary.is_complete and len(self._summary.chunks) != self._chunks:
            stated = f"its index names {len(self._summary.chunks)} chunks and {self._chunks}"
            yield Damage(what=f"{self._name}: {stated} are there")

    def _compare_checksum(self, data_end: int) -> Iterator[Damage]:
        """Compare a file without chunks, whose messages have no checksums, with that of its data.

        Files with chunks are checked by those.
        """
        stated = self._data_crc if not self._chunks else 0
        at, end, crc = 0, data_end - DATA_END_BYTES, 0
        while stated and at < end:
            data = read_bytes(self._file, at, min(_WINDOW, end - at))
            at, crc = at + len(data), zlib.crc32(data, crc)
        if crc != stated:
            what = f"{self._name}: bytes of its messages have changed: their checksum is wrong"
            yield Damage(what=what, begin_ns=self._begin_ns)

    def _add_time(self, t_ns: int) -> None:
        self._begin_ns = t_ns if self._begin_ns is None else min(self._begin_ns, t_ns)
        self._last_ns = t_ns if self._last_ns is None else max(self._last_ns, t_ns)

    def _describe_end(self) -> Damage:
        lost = 0 if self._hole is None else self._size - self._hole.offset
        return Damage(
            what=f"{self._name}: the file ends in the middle: its last {lost} bytes cannot be "
            "read, and `agribot record recover` writes a whole file of the rest",
            begin_ns=self._begin_ns, after_ns=self._last_ns, lost_bytes=lost, is_end=True,
        )  # fmt: skip

    def _make_damage(self, hole: Hole, before_ns: int | None) -> Damage:
        what = f"{self._name}: bytes {hole.offset} to {hole.end} are damaged"
        summary, lost_bytes = self._summary, hole.end - hole.offset
        if summary is None or not summary.is_complete:
            return Damage(
                what=what, begin_ns=self._begin_ns, after_ns=self._last_ns, before_ns=before_ns,
                lost_bytes=lost_bytes,
            )  # fmt: skip
        chunks = [c for c in summary.chunks if hole.offset <= c.chunk_start_offset < hole.end]
        offsets = [at for chunk in chunks for at in chunk.message_index_offsets.values()]
        return Damage(
            what=what,
            begin_ns=self._begin_ns,
            after_ns=min((c.message_start_time for c in chunks), default=None),
            before_ns=max((c.message_end_time for c in chunks), default=None),
            lost_messages=self._count_messages(offsets) if offsets or not chunks else None,
            lost_bytes=lost_bytes,
            lost_files=tuple(f.name for f in summary.files if hole.offset <= f.offset < hole.end),
        )

    def _count_messages(self, offsets: list[int]) -> int | None:
        """Count by the message indexes at `offsets`; None where one of them is damaged."""
        count = 0
        for offset in offsets:
            opcode, body = read_record(self._file, offset, self._size)
            index = parse_record(opcode, body) if opcode else None
            if not isinstance(index, MessageIndex):
                return None
            count += index.messages
        return count


def _read_times(chunk: Chunk) -> tuple[int | None, int | None]:
    """Read the first and the last log time of a chunk; None for one without messages."""
    times = chunk.message_start_time, chunk.message_end_time
    if any(times) or any(isinstance(record, Message) for record in break_up(chunk)):
        return times
    return None, None
