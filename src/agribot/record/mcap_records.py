"""The records of an MCAP file in file order, up to wherever it was cut."""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk

from agribot.core.errors import RecordingError

MAGIC = b"\x89MCAP0\r\n"
_NUMBERED = re.compile(r"(.*)-(\d{4,})")
_RECORD_HEAD = struct.Struct("<BQ")
_PLAIN: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
}


def part_path(first: Path, number: int) -> Path:
    return first if number == 0 else first.with_name(f"{first.stem}-{number:04d}{first.suffix}")


def list_parts(path: Path) -> list[Path]:
    """List the given part of a recording and all that follow it: run.mcap, run-0001.mcap, ..."""
    found = _NUMBERED.fullmatch(path.stem)
    first, number = path, 0
    if found is not None:
        first, number = path.with_name(found[1] + path.suffix), int(found[2])
    parts = [path]
    while (following := part_path(first, number := number + 1)).exists():
        parts.append(following)
    return parts


class McapRecords:
    """Iterate for Header, Schema, Channel, Message, Attachment and Metadata records.

    After the last one `is_whole` says whether the data ended as it should, `good_bytes` up to
    which byte it was sound. Raises: RecordingError: no such file, or it is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_whole = False
        self.good_bytes = 0

    def __iter__(self) -> Iterator[Any]:
        try:
            size = self.path.stat().st_size
            file = self.path.open("rb")
        except OSError as error:
            raise RecordingError(
                f"cannot read recording {self.path}: {error.strerror or error}; check the path"
            ) from error
        with file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(
                    f"{self.path} is not an MCAP recording; give the run.mcap of a run"
                )
            self.good_bytes = file.tell()
            yield from self._read_sound_records(file, size)

    def _read_sound_records(self, file: IO[bytes], size: int) -> Iterator[Any]:
        while True:
            head = file.read(_RECORD_HEAD.size)
            if len(head) < _RECORD_HEAD.size:
                return
            opcode, length = _RECORD_HEAD.unpack(head)
            if opcode == Opcode.DATA_END:
                self.is_whole = True
            if opcode in {0, Opcode.DATA_END} or length > size - file.tell():
                return
            records = _parse_record(opcode, file.read(length))
            if records is None:
                return
            self.good_bytes = file.tell()
            yield from records


def _parse_record(opcode: int, body: bytes) -> list[Any] | None:
    """Parse a record; None for bytes that are damaged."""
    stream = ReadDataStream(io.BytesIO(body))
    try:
        if opcode == Opcode.CHUNK:
            return list(breakup_chunk(Chunk.read(stream), validate_crc=True))
        if opcode == Opcode.ATTACHMENT:
            is_sound = zlib.crc32(body[:-4]) == int.from_bytes(body[-4:], "little")
            return [Attachment.read(stream)] if is_sound else None
        if opcode == Opcode.MESSAGE:
            return [Message.read(stream, len(body))]
        kind = _PLAIN.get(opcode)
        return [] if kind is None else [kind.read(stream)]
    except Exception:  # noqa: BLE001  each decompressor has errors of its own for damaged bytes
        return None
