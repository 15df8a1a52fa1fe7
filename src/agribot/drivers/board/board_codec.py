"""Frames of the boards: bytes to messages of `board_protocol` and back, without a line.

Source: S. Cheshire and M. Baker, Consistent Overhead Byte Stuffing, IEEE/ACM Transactions on
Networking 7 (1999); CRC-16/XMODEM, polynomial 0x1021 from zero, low byte first.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections.abc import Callable
from enum import Enum
from typing import Any, NamedTuple

from agribot.drivers.board.board_protocol import (
    MESSAGES,
    BoardMessage,
    Sender,
    Wire,
    WireField,
    list_fields,
)

LONGEST_FRAME = 254  # bytes with CRC and before stuffing: one code byte more, never two
HEAD_BYTES, CRC_BYTES = 2, 2
_LETTERS = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i"}
_LIMITS = {
    kind: (-(1 << 8 * size - 1), (1 << 8 * size - 1) - 1) if kind[0] == "i" else (0, 256**size - 1)
    for kind, size in (("u8", 1), ("i8", 1), ("u16", 2), ("i16", 2), ("u32", 4), ("i32", 4))
}


class BoardFrame(NamedTuple):
    """A message and its sequence number."""

    seq: int
    message: BoardMessage


def stuff(data: bytes) -> bytes:
    """Write bytes without a zero among them (COBS), without the zero that ends a frame."""
    out = bytearray()
    for block in data.split(b"\0"):
        rest = block
        while len(rest) >= 254:
            out += b"\xff" + rest[:254]
            rest = rest[254:]
        out.append(len(rest) + 1)
        out += rest
    return bytes(out)


def unstuff(data: bytes) -> bytes | None:
    """Read what `stuff` wrote; None where nothing can have been written so."""
    out, at, end = bytearray(), 0, len(data)
    if 0 in data:
        return None
    while at < end:
        code = data[at]
        if at + code > end:
            return None
        out += data[at + 1 : at + code]
        at += code
        if code < 255 and at < end:
            out.append(0)
    return bytes(out)


class MessageFormat:
    """Format of one message: its struct, and the way of each field to and from it."""

    def __init__(self, message: type[BoardMessage]) -> None:
        self.message, self.fields = message, list_fields(message)
        letters = "".join(f"{f.wire.length}{_LETTERS[f.wire.kind]}" for f in self.fields)
        self.struct = struct.Struct("<BB" + letters)
        self._readers = self._make_readers()

    def pack(self, seq: int, message: BoardMessage) -> bytes:
        """Pack it, with type and sequence number.

        Raises: ValueError: a value that the field cannot carry.
        """
        numbers: list[int] = []
        for field in self.fields:
            value = getattr(message, field.name)
            numbers += [
                _to_wire(one, field, self.message)
                for one in (value if field.wire.length > 1 else (value,))
            ]
        return self.struct.pack(self.message.number, seq & 0xFF, *numbers)

    def unpack(self, body: bytes) -> BoardFrame | None:
        """Unpack it; None where a field has a value that it never has."""
        numbers = self.struct.unpack(body)
        try:
            values = {name: read(numbers) for name, read in self._readers}
        except ValueError:
            return None
        return BoardFrame(numbers[1], self.message(**values))

    def _make_readers(self) -> list[tuple[str, Callable[[tuple[int, ...]], Any]]]:
        readers, at = [], HEAD_BYTES
        for field in self.fields:
            readers.append((field.name, _make_reader(field.wire, field.python_type, at)))
            at += field.wire.length
        return readers


def _make_reader(wire: Wire, python_type: type, at: int) -> Callable[[tuple[int, ...]], Any]:
    end, scale = at + wire.length, wire.scale
    if issubclass(python_type, Enum):
        return lambda numbers: python_type(numbers[at])
    if wire.length > 1:
        if scale == 1.0:
            return lambda numbers: numbers[at:end]
        return lambda numbers: tuple([one * scale for one in numbers[at:end]])
    if scale == 1.0:
        return lambda numbers: numbers[at]
    if python_type is int:
        return lambda numbers: round(numbers[at] * scale)
    return lambda numbers: numbers[at] * scale


def _to_wire(value: float, field: WireField, message: type[BoardMessage]) -> int:
    low, high = _LIMITS[field.wire.kind]
    scale = field.wire.scale
    number = round(value / scale) if low * scale <= value <= high * scale else high + 1
    if not low <= number <= high:
        raise ValueError(
            f"{message.__name__}.{field.name} is {value:g} {field.wire.unit}; "
            f"it goes from {low * scale:g} to {high * scale:g}"
        )
    return number


FORMATS = {message.number: MessageFormat(message) for message in MESSAGES}


def encode(seq: int, message: BoardMessage) -> bytes:
    """Make the frame of a message, with the zero that ends it.

    Raises: ValueError: a value that its field cannot carry.
    """
    body = FORMATS[message.number].pack(seq, message)
    return stuff(body + crc_hqx(body, 0).to_bytes(CRC_BYTES, "little")) + b"\0"


class BoardEncoder:
    """Numbers the frames of one end of a line."""

    def __init__(self) -> None:
        self.next_seq = 0

    def encode(self, message: BoardMessage) -> tuple[int, bytes]:
        """Make its frame; gives the sequence number that it got, for the answer."""
        seq = self.next_seq
        data = encode(seq, message)
        self.next_seq = (seq + 1) & 0xFF
        return seq, data


class BoardDecoder:
    """Finds the frames of one end in a stream of bytes that may be cut and broken anywhere.

    `bad` counts what stood between two zeros and was no frame, `unknown` frames that are whole but
    of no type or length of the table, `lost` the gaps in the sequence numbers. What was in the line
    before the first whole frame counts as none of these: where it began is unknown.
    """

    def __init__(self, sender: Sender = "board") -> None:
        self._sender = sender
        self._waiting = bytearray()
        self._is_first, self._is_too_long = True, False
        self._last_seq: int | None = None
        self.bad = self.unknown = self.lost = 0

    def feed(self, data: bytes) -> list[BoardFrame]:
        *pieces, rest = data.split(b"\0")
        found = []
        for piece in pieces:
            self._keep(piece)
            frame = self._end_frame()
            if frame is not None:
                found.append(frame)
        self._keep(rest)
        return found

    def _keep(self, piece: bytes) -> None:
        self._waiting += piece
        if len(self._waiting) > LONGEST_FRAME + 1:
            self._waiting.clear()
            self._is_too_long = True

    def _end_frame(self) -> BoardFrame | None:
        raw, is_first, is_too_long = bytes(self._waiting), self._is_first, self._is_too_long
        self._waiting.clear()
        self._is_first = self._is_too_long = False
        if not raw and not is_too_long:
            return None
        body = None if is_too_long else _check(raw)
        if body is None:
            self.bad += not is_first
            return None
        self._count_lost(body[1])
        frame = self._unpack(body)
        self.unknown += frame is None
        return frame

    def _unpack(self, body: bytes) -> BoardFrame | None:
        kind = FORMATS.get(body[0])
        if kind is None or kind.message.sender != self._sender or len(body) != kind.struct.size:
            return None
        return kind.unpack(body)

    def _count_lost(self, seq: int) -> None:
        if self._last_seq is not None:
            self.lost += (seq - self._last_seq - 1) & 0xFF
        self._last_seq = seq


def _check(raw: bytes) -> bytes | None:
    """Unstuff a frame and take off its CRC; None where it is broken."""
    frame = unstuff(raw)
    if frame is None or len(frame) < HEAD_BYTES + CRC_BYTES:
        return None
    body = frame[:-CRC_BYTES]
    return body if crc_hqx(body, 0) == int.from_bytes(frame[-CRC_BYTES:], "little") else None
