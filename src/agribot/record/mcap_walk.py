"""The records of an MCAP file in file order, outside of chunks; behind damage the next sound one.

A chunk and an attachment carry a checksum: bytes that pass it are one, at any place. Records
without a checksum count where several follow one another.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from typing import IO, Any, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message

from agribot.record.mcap_parsing import (
    HEAD,
    MAGIC,
    MessageIndex,
    parse_record,
    read_bytes,
    read_head,
    read_record,
)

# Heads of records below 2^40 bytes: of those with a checksum, and of any kind.
_CHECKED_HEAD = re.compile(rb"[\x06\x09].{5}\x00{3}", re.DOTALL)
_ANY_HEAD = re.compile(rb"[\x01-\x0f].{5}\x00{3}", re.DOTALL)
_LINKS = 3  # records without a checksum that follow one another are taken for sound
_WINDOW = 1 << 20  # bytes that are searched at once
_INNER = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)  # records of a chunk
_CHECKED = (Opcode.CHUNK, Opcode.ATTACHMENT)


class Outer(NamedTuple):
    """A record that is not inside a chunk."""

    offset: int
    end: int
    record: Any


class Hole(NamedTuple):
    """Bytes that are no record, from `offset` to `end`."""

    offset: int
    end: int


class McapWalk:
    """Iterate over an MCAP file. `data_end`: where the data section ended; None: cut off."""

    def __init__(self, file: IO[bytes], size: int, channel_ids: Collection[int] = ()) -> None:
        self._file, self._size = file, size
        self._channel_ids = set(channel_ids)
        self._chunk: Chunk | None = None  # the last one
        self._is_behind_damage = False
        self._searched_from = size  # no record with a checksum lies behind it
        self.data_end: int | None = None

    def __iter__(self) -> Iterator[Outer | Hole]:
        at = len(MAGIC)
        while at < self._size and self.data_end is None:
            found = self._parse_at(at)
            if found is None:
                self._is_behind_damage = True
                hole = Hole(at, self._find_next(at))
                at = hole.end
                yield hole
                continue
            at = found.end
            self._note(found.record)
            if self._read_head(found.offset)[0] in (Opcode.DATA_END, Opcode.FOOTER):
                self.data_end = at
            yield found

    def _note(self, record: Any) -> None:
        if isinstance(record, Chunk):
            self._chunk, self._is_behind_damage = record, False
        if isinstance(record, Channel):
            self._channel_ids.add(record.id)

    def _read_head(self, offset: int) -> tuple[int, int]:
        return read_head(self._file, offset, self._size)

    def _parse_at(self, offset: int) -> Outer | None:
        opcode, body = read_record(self._file, offset, self._size)
        record = parse_record(opcode, body) if opcode else None
        if isinstance(record, Message) and self._chunk is not None:
            record = _distinguish_from_index(record, body)
        if isinstance(record, MessageIndex) and not self._belongs(record):
            record = None
        return None if record is None else Outer(offset, offset + HEAD.size + len(body), record)

    def _belongs(self, index: MessageIndex) -> bool:
        """Return whether an index is of the chunk before it, or of a damaged one."""
        if self._chunk is None or self._is_behind_damage or not index.messages:
            return True
        start_ns, end_ns = self._chunk.message_start_time, self._chunk.message_end_time
        return start_ns <= index.first_ns and index.last_ns <= end_ns

    def _find_next(self, start: int) -> int:
        """Find the next sound record behind `start`; the end of the file without one."""
        _, stated_end = self._read_head(start)
        if stated_end and self._is_sound(stated_end):
            return stated_end
        if self._chunk is None:
            return self._search(_ANY_HEAD, self._is_sound, start + 1)
        at = self._size
        if start < self._searched_from:
            at = self._search(_CHECKED_HEAD, self._is_checked, start + 1)
        if at == self._size:
            self._searched_from = min(self._searched_from, start)
            at = self._search(_ANY_HEAD, self._is_chain, start + 1)
        return at

    def _search(self, head: re.Pattern[bytes], is_record: Callable[[int], bool], start: int) -> int:
        while start < self._size:
            window = read_bytes(self._file, start, _WINDOW + HEAD.size)
            at = -1
            while match := head.search(window, at + 1):
                at = match.start()
                if is_record(start + at):
                    return start + at
            start += _WINDOW
        return self._size

    def _is_sound(self, offset: int) -> bool:
        return self._is_checked(offset) or self._is_chain(offset)

    def _is_checked(self, offset: int) -> bool:
        return self._read_head(offset)[0] in _CHECKED and self._parse_at(offset) is not None

    def _is_chain(self, offset: int) -> bool:
        """Return whether several records follow one another here, or the last ones of the file."""
        opcode, _ = self._read_head(offset)
        if not opcode or (opcode in _INNER and self._chunk is not None):
            return False
        channel_ids = set(self._channel_ids)
        for _ in range(_LINKS):
            found = self._parse_at(offset)
            if found is None or not _fits(found.record, channel_ids):
                return False
            offset = found.end
            if offset in (self._size, self._size - len(MAGIC)):
                return True
        return True


def _fits(record: Any, channel_ids: set[int]) -> bool:
    if isinstance(record, Channel):
        channel_ids.add(record.id)
    return not isinstance(record, Message) or record.channel_id in channel_ids


def _distinguish_from_index(message: Message, body: bytes) -> Message | MessageIndex | None:
    """Distinguish a message from a message index whose opcode is damaged."""
    index = parse_record(Opcode.MESSAGE_INDEX, body)
    return message if index is None else index
