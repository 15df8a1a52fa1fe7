"""Frames of Unicore receivers (UM980, UM982), in ASCII behind a # and in binary.

Sources: Unicore N4 high precision products, reference commands manual: both headers and the CRC-32;
NovAtel OEM7 commands and logs reference manual: the ASCII header, whose CRC is the same.
`unicore_fixes.py` reads what they hold.
"""

from __future__ import annotations

import re
import struct
import zlib
from typing import NamedTuple

SYNC = b"\xaa\x44\xb5"
BESTNAV, UNIHEADING = 2118, 972
NAMES = {BESTNAV: "BESTNAV", UNIHEADING: "UNIHEADING"}
# Names of this sentence at NovAtel, ComNav and Bynav; the fields are those of UNIHEADING.
HEADINGS = (NAMES[UNIHEADING], "HEADING", "HEADING2", "DUALANTENNAHEADING")
LONGEST_BODY = 8192
LONGEST_LINE = 1024
HEAD = struct.Struct("<3sBHHBBHIIBBH")
_CHECKSUM_BYTES = 4
_PRINTABLE = re.compile(rb"#[ -~]*")
_LINE = re.compile(rb'#([A-Z0-9]+)A,([ -"$-)+-:<-~]*);([ -"$-)+-~]*)\*([0-9a-fA-F]{8})')
_WEEK_S = 604_800.0


class UnicoreFrame(NamedTuple):
    """`fields` are those of the ASCII form, `body` the bytes of the binary one.

    `stamp_s` is GPS time; `name` is without the A or B at its end.
    """

    name: str
    stamp_s: float
    fields: tuple[str, ...] = ()
    body: bytes = b""


class UnicoreDecoder:
    """Finds frames of both forms in a stream of bytes; broken ones are counted in `bad`."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self.is_binary = False  # whether the last message found was binary
        self.bad = 0

    def feed(self, data: bytes) -> list[UnicoreFrame]:
        waiting = self._waiting
        waiting += data
        found: list[UnicoreFrame] = []
        start = 0
        while True:
            start = _find_start(waiting, start)
            size, frame = self._read(start)
            if size == 0:
                break
            if frame is not None:
                found.append(frame)
                self.is_binary = not frame.fields
            start += size
        del waiting[:start]
        return found

    def _read(self, start: int) -> tuple[int, UnicoreFrame | None]:
        """Read what begins there: how many bytes it takes, 0 where more are needed."""
        if self._waiting[start : start + 1] == b"#":
            return self._read_line(start)
        return self._read_binary(start)

    def _read_line(self, start: int) -> tuple[int, UnicoreFrame | None]:
        waiting = self._waiting
        match = _LINE.match(waiting, start)
        if match is None:  # a part of one, one of another maker, or a # in binary data
            is_part = _PRINTABLE.fullmatch(waiting, start) and len(waiting) - start < LONGEST_LINE
            return (0 if is_part else 1), None
        name, head, body, checksum = (group.decode("ascii", "replace") for group in match.groups())
        if compute_crc32(waiting[start + 1 : match.end() - 9]) != int(checksum, 16):
            self.bad += 1
            return 1, None
        stamp_s = _read_stamp_s(head.split(","))
        return match.end() - start, UnicoreFrame(name, stamp_s, tuple(body.split(",")))

    def _read_binary(self, start: int) -> tuple[int, UnicoreFrame | None]:
        waiting = self._waiting
        if len(waiting) - start < HEAD.size:
            return 0, None
        _, _, number, length, _, _, week, time_ms, *_ = HEAD.unpack_from(waiting, start)
        begin, end = start + HEAD.size, start + HEAD.size + length
        if length > LONGEST_BODY:
            self.bad += 1
            return len(SYNC), None
        if len(waiting) < end + _CHECKSUM_BYTES:
            return 0, None
        checksum = int.from_bytes(waiting[end : end + _CHECKSUM_BYTES], "little")
        if compute_crc32(waiting[start:end]) != checksum:
            self.bad += 1
            return len(SYNC), None
        name, stamp_s = NAMES.get(number, f"Unicore {number}"), _make_stamp_s(week, time_ms)
        frame = UnicoreFrame(name, stamp_s, (), bytes(waiting[begin:end]))
        return end + _CHECKSUM_BYTES - start, frame


def _find_start(waiting: bytearray, start: int) -> int:
    """Find where the next frame may begin; at the end of what waits, a part of a sync word."""
    places = [at for at in (waiting.find(b"#", start), waiting.find(SYNC, start)) if at >= 0]
    if places:
        return min(places)
    kept = next((k for k in (2, 1) if waiting.endswith(SYNC[:k])), 0)
    return max(len(waiting) - kept, start)


def _read_stamp_s(words: list[str]) -> float:
    """Read week and milliseconds of a header, or NovAtel's week and seconds; 0 without a time."""
    if len(words) > 4 and words[3].isdecimal() and words[4].isdecimal():
        return _make_stamp_s(int(words[3]), int(words[4]))
    if len(words) > 5 and words[4].isdecimal() and re.fullmatch(r"\d+\.\d+", words[5]):
        return _make_stamp_s(int(words[4]), round(float(words[5]) * 1e3))
    return 0.0


def _make_stamp_s(week: int, time_ms: int) -> float:
    return week * _WEEK_S + time_ms * 1e-3


def compute_crc32(data: bytes | bytearray) -> int:
    """Compute the CRC-32 of NovAtel and Unicore, which begins with zeros and inverts nothing."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF
