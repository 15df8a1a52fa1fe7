"""Recordings for the tests of damage, and what lies where in them."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

Kind = Literal["flip", "zero", "random", "remove", "cut"]
KINDS: tuple[Kind, ...] = ("flip", "zero", "random", "remove", "cut")
SECTOR = 512


class Piece(NamedTuple):
    """A chunk of a sound file, from `start` to `end`, with its messages: time and bytes."""

    start: int
    end: int
    messages: tuple[tuple[int, bytes], ...]


def write_mcap(
    path: Path,
    compression: CompressionType = CompressionType.LZ4,
    begin_ns: int = 0,
    use_chunking: bool = True,
) -> None:
    """Write 400 messages of two topics at 10 Hz, in about 40 chunks, and two files."""
    rng = np.random.default_rng(3)
    with path.open("wb") as file:
        writer = Writer(
            file, 512, compression, use_chunking=use_chunking, enable_data_crcs=not use_chunking
        )
        writer.start("ros2", "test")
        writer.add_attachment(0, 0, "first.txt", "text/plain", b"first" * 20)
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        for index in range(400):
            if index % 250 == 0:
                channel = writer.register_channel(f"/number{index // 250}", "cdr", schema)
            data = b"\0\1\0\0" + rng.bytes(8) * 4
            t_ns = begin_ns + index * 100_000_000
            writer.add_message(channel, t_ns, data, t_ns, index)
        writer.add_attachment(0, 0, "last.txt", "text/plain", b"last" * 20)
        writer.finish()  # type: ignore[no-untyped-call]


def list_chunks(path: Path) -> list[Piece]:
    return list(_list_chunks(path.read_bytes()))


def _list_chunks(data: bytes) -> Iterator[Piece]:
    at = 8
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        end = at + 9 + length
        if opcode == Opcode.CHUNK:
            (chunk,) = _read_records(data[at:end])
            inner = [record for record in breakup_chunk(chunk) if isinstance(record, Message)]
            yield Piece(at, end, tuple((message.log_time, message.data) for message in inner))
        at = end


def _read_records(data: bytes) -> list[Chunk]:
    footer = struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0) + b"\x89MCAP0\r\n"
    stream = StreamReader(io.BytesIO(data + footer), skip_magic=True, emit_chunks=True)
    return [record for record in stream.records if isinstance(record, Chunk)]


def flip_in_chunk(path: Path, number: int) -> None:
    """Flip one bit in the middle of a chunk."""
    data, piece = bytearray(path.read_bytes()), list_chunks(path)[number]
    data[(piece.start + piece.end) // 2] ^= 0x10
    path.write_bytes(data)


def damage(data: bytes, kind: Kind, rng: np.random.Generator) -> tuple[bytes, int, int]:
    """Damage a file at a random place; return it with the first and last byte that changed."""
    start = int(rng.integers(8, len(data)))
    size = 1 if kind == "flip" else int(rng.integers(1, 2 * SECTOR))
    end = len(data) if kind == "cut" else min(start + size, len(data))
    old = data[start:end]
    changes: dict[Kind, bytes] = {
        "flip": bytes([old[0] ^ (1 << int(rng.integers(8)))]),
        "zero": bytes(len(old)),
        "random": rng.bytes(len(old)),
        "remove": b"",
        "cut": b"",
    }
    return data[:start] + changes[kind] + data[end:], start, end
