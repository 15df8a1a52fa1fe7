"""The records of an MCAP file: parsed when all of their bytes fit, None where they do not."""

from __future__ import annotations

import dataclasses
import io
import struct
import zlib
from collections.abc import Callable
from typing import IO, Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import breakup_chunk, get_chunk_data_stream

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode, length of the body
SECTOR = 512  # bytes that a disk loses at once
_FIRST_PRIVATE_OPCODE = 0x80
_INDEX_HEAD_BYTES = 6
_INDEX_ENTRY = struct.Struct("<QQ")  # log time, offset in the chunk
_FOOTER_BYTES, _CRC_BYTES = 20, 4
_DATA_END_HEAD = HEAD.pack(Opcode.DATA_END, _CRC_BYTES)
DATA_END_BYTES = len(_DATA_END_HEAD) + _CRC_BYTES
_LARGEST_SUMMARY_BYTES = 64 << 20  # size of a summary that is searched for; 2 kB a chunk are usual
_PLAIN: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}


class MessageIndex(NamedTuple):
    """Count of a channel's messages in the chunk before it, and their times."""

    channel_id: int
    messages: int
    first_ns: int
    last_ns: int


class Private(NamedTuple):
    """A record of a kind that only another program knows."""

    opcode: int


class _ExactStream(ReadDataStream):
    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


def read_bytes(file: IO[bytes], offset: int, size: int) -> bytes:
    """Read bytes of a file; sectors that the disk cannot read are zeros."""
    try:
        file.seek(offset)
        return file.read(size)
    except OSError:
        if size <= SECTOR:
            return bytes(size)
    half = size // 2
    return read_bytes(file, offset, half) + read_bytes(file, offset + half, size - half)


def read_record(file: IO[bytes], offset: int, size: int) -> tuple[int, bytes]:
    """Read opcode and body of a record; (0, b"") where it does not fit into `size` bytes."""
    opcode, end = read_head(file, offset, size)
    start = offset + HEAD.size
    return (opcode, read_bytes(file, start, end - start)) if opcode else (0, b"")


def read_head(file: IO[bytes], offset: int, size: int) -> tuple[int, int]:
    """Read the opcode and the end of a record; (0, 0) where it does not fit into `size` bytes."""
    head = read_bytes(file, offset, HEAD.size)
    if len(head) < HEAD.size:
        return 0, 0
    opcode, length = HEAD.unpack(head)
    end = offset + HEAD.size + length
    return (opcode, end) if end <= size else (0, 0)


def parse_record(opcode: int, body: bytes) -> Any | None:
    """Parse a record of any kind; None for bytes that are damaged.

    A chunk comes unpacked and checked: with its records as plain `data`. A checksum that fits
    says more than an opcode of another program.
    """
    try:
        if opcode >= _FIRST_PRIVATE_OPCODE:
            kinds = (parse_record(kind, body) for kind in (Opcode.CHUNK, Opcode.ATTACHMENT))
            return next((record for record in kinds if record is not None), Private(opcode))
        return _PARSERS.get(opcode, _parse_plain)(opcode, body)
    except Exception:  # noqa: BLE001  each decompressor has errors of its own for damaged bytes
        return None


def break_up(chunk: Chunk) -> list[Any]:
    """List the records inside an unpacked chunk."""
    return list(breakup_chunk(chunk))


def _parse_plain(opcode: int, body: bytes) -> Any | None:
    stream = _ExactStream(io.BytesIO(body))
    record = _PLAIN[opcode].read(stream)
    return record if stream.count == len(body) else None


def _parse_message(_: int, body: bytes) -> Message:
    message: Message = Message.read(_ExactStream(io.BytesIO(body)), len(body))
    return message


def _unpack_chunk(_: int, body: bytes) -> Chunk | None:
    stream = _ExactStream(io.BytesIO(body))
    packed = Chunk.read(stream)
    if stream.count != len(body):
        return None
    unpacked, size = get_chunk_data_stream(packed, validate_crc=True)
    chunk: Chunk = dataclasses.replace(packed, compression="", data=unpacked.read(size))
    if not packed.uncompressed_crc:
        break_up(chunk)  # without a checksum, records that fit are all there is to go by
    return chunk


def _parse_attachment(_: int, body: bytes) -> Attachment | None:
    stated = int.from_bytes(body[-4:], "little")
    if stated not in (0, zlib.crc32(body[:-4])):
        return None
    stream = _ExactStream(io.BytesIO(body))
    attachment = Attachment.read(stream)
    return attachment if stream.count == len(body) else None


def _parse_message_index(_: int, body: bytes) -> MessageIndex | None:
    channel_id, size = struct.unpack_from("<HI", body)
    is_sound = size == len(body) - _INDEX_HEAD_BYTES and size % _INDEX_ENTRY.size == 0
    if not is_sound:
        return None
    times_ns = [t_ns for t_ns, _ in _INDEX_ENTRY.iter_unpack(body[_INDEX_HEAD_BYTES:])]
    return MessageIndex(
        channel_id, len(times_ns), min(times_ns, default=0), max(times_ns, default=0)
    )


_PARSERS: dict[int, Callable[[int, bytes], Any | None]] = {
    Opcode.CHUNK: _unpack_chunk,
    Opcode.ATTACHMENT: _parse_attachment,
    Opcode.MESSAGE_INDEX: _parse_message_index,
    Opcode.MESSAGE: _parse_message,
}


class Summary:
    """The index at the end of a file: what the file should hold."""

    def __init__(self, is_in_place: bool) -> None:
        self._is_in_place = is_in_place
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.chunks: list[ChunkIndex] = []
        self.files: list[AttachmentIndex] = []
        self.statistics: Statistics | None = None

    @property
    def is_complete(self) -> bool:
        """Whether all that may hold messages is listed, where it lies in the file."""
        stated = self.statistics.chunk_count if self.statistics is not None else 0
        return self._is_in_place and 0 < stated == len(self.chunks)

    def add(self, record: Any) -> None:
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, ChunkIndex):
            self.chunks.append(record)
        elif isinstance(record, AttachmentIndex):
            self.files.append(record)
        elif isinstance(record, Statistics):
            self.statistics = record


def read_footer(file: IO[bytes], size: int) -> Footer | None:
    """Read the last record of a file, which says where its index begins; None without one."""
    tail_size = HEAD.size + _FOOTER_BYTES + len(MAGIC)
    tail = read_bytes(file, max(size - tail_size, 0), tail_size)
    if tail[: HEAD.size] != HEAD.pack(Opcode.FOOTER, _FOOTER_BYTES) or not tail.endswith(MAGIC):
        return None
    footer: Footer | None = parse_record(Opcode.FOOTER, tail[HEAD.size : -len(MAGIC)])
    return footer


def read_summary(file: IO[bytes], size: int) -> Summary | None:
    """Read the index; None if it is missing, or its checksum is wrong.

    In a file that lost bytes it lies elsewhere than the file says: behind the end of the data.
    """
    footer, end = read_footer(file, size), size - len(MAGIC)
    if footer is None or not footer.summary_start:
        return None
    starts = (footer.summary_start, _find_data_end(file, size))
    for start in starts:
        data = read_bytes(file, start, end - start) if 0 < start < end else b""
        if data and footer.summary_crc in (0, zlib.crc32(data[:-4])):
            return _parse_summary(data, is_in_place=start == footer.summary_start)
    return None


def _find_data_end(file: IO[bytes], size: int) -> int:
    """Find the end of the last record that ends the data; 0 without one."""
    start = max(size - _LARGEST_SUMMARY_BYTES, 0)
    at = read_bytes(file, start, _LARGEST_SUMMARY_BYTES).rfind(_DATA_END_HEAD)
    return 0 if at < 0 else start + at + DATA_END_BYTES


def _parse_summary(data: bytes, is_in_place: bool) -> Summary | None:
    summary, at = Summary(is_in_place), 0
    while at + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, at)
        at += HEAD.size + length
        record = parse_record(opcode, data[at - length : at]) if at <= len(data) else None
        if record is None:
            return None
        summary.add(record)
    return summary
