"""RTCM 3 of a base station: bytes to whole messages, which are passed on unchanged.

Source: RTCM 10403.3, transport layer: preamble 0xD3, ten bits of length, CRC-24Q.
"""

from __future__ import annotations

from typing import NamedTuple

from agribot.core.messages import Vec3

PREAMBLE = 0xD3
_AROUND = 6  # bytes of preamble, length and checksum
_POLYNOMIAL = 0x1864CFB
# Place, antenna, receiver and words of a base, orbits, and biases of its receiver: it repeats them
# also while it hears no satellite.
_OF_THE_BASE = frozenset(
    (1005, 1006, 1007, 1008, 1013, 1019, 1020, 1029, 1032, 1033, *range(1041, 1047), 1230)
)
# Position of the satellites' count in observations: the mask of MSM 1 to 7 of all systems, and the
# numbers of the older messages of GPS and of GLONASS.
_SATELLITE_BITS = (
    (frozenset(k for k in range(1071, 1138) if k % 10 in range(1, 8)), (73, 64)),
    (range(1001, 1005), (55, 5)),
    (range(1009, 1013), (52, 5)),
)
_STATION_BITS, _VIRTUAL_BIT = (12, 12), 33
_PLACE_BITS = (34, 74, 114)  # bits where the three numbers of a place begin


class RtcmMessage(NamedTuple):
    """`kind` is its number, such as 1005; `data` the whole of it, checksum and all."""

    kind: int
    data: bytes


class HeardBase(NamedTuple):
    """Earth-centred place of a base's antenna, m; `is_virtual` where no antenna stands there."""

    ecef_m: Vec3
    station: int
    is_virtual: bool


def corrects_ranges(message: RtcmMessage) -> bool:
    """Return whether a receiver corrects with a message, or only needs it beside.

    One about observations that counts no satellite corrects nothing: a base sends such that hears
    none. Source: RTCM 10403.3, tables 3.5-2, 3.5-11 and 3.5-78.
    """
    kind = message.kind
    if kind in _OF_THE_BASE:
        return False
    begin, count = next((bits for kinds, bits in _SATELLITE_BITS if kind in kinds), (0, 0))
    payload = message.data[3:-3]
    return not count or _read_bits(payload, begin, count) > 0


def _read_bits(payload: bytes, begin: int, count: int) -> int:
    """Read some bits, the first of the payload being number 0; 0 where it is too short."""
    last = len(payload) * 8 - begin - count
    return int.from_bytes(payload) >> last & ((1 << count) - 1) if last >= 0 else 0


def read_base(message: RtcmMessage) -> HeardBase | None:
    """Read where the base says that its antenna stands; None of other messages.

    Source: RTCM 10403.3, messages 1005 and 1006: DF003 is the station, DF141 is set of a virtual
    one, DF025 to DF027 are three numbers of 38 bits, in 0.1 mm.
    """
    payload = message.data[3:-3]
    if message.kind not in (1005, 1006) or len(payload) * 8 < _PLACE_BITS[-1] + 38:
        return None
    x, y, z = (_read_bits(payload, at, 38) for at in _PLACE_BITS)
    place_m = _scale_place(x), _scale_place(y), _scale_place(z)
    is_virtual = bool(_read_bits(payload, _VIRTUAL_BIT, 1))
    return HeardBase(place_m, _read_bits(payload, *_STATION_BITS), is_virtual)


def _scale_place(number: int) -> float:
    return (number - (number >> 37 << 38)) * 1e-4


class RtcmDecoder:
    """Finds messages in a stream of bytes; every byte that belongs to none is counted in `junk`."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self.junk = 0

    def feed(self, data: bytes) -> list[RtcmMessage]:
        waiting = self._waiting
        waiting += data
        found: list[RtcmMessage] = []
        start, end = 0, len(waiting)
        while True:
            before, start = start, waiting.find(PREAMBLE, start)
            self.junk += (end if start < 0 else start) - before
            if start < 0 or end - start < 3:
                break
            length = (waiting[start + 1] << 8 | waiting[start + 2]) + _AROUND
            if waiting[start + 1] >> 2:  # reserved bits, all zero
                length = 0
            if end - start < length:
                break
            whole = bytes(waiting[start : start + length])
            if length > _AROUND + 1 and compute_crc24q(whole) == 0:
                found.append(RtcmMessage(whole[3] << 4 | whole[4] >> 4, whole))
                start += length
            else:
                self.junk += 1
                start += 1
        del waiting[: end if start < 0 else start]
        return found


def _make_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        value = byte << 16
        for _ in range(8):
            value <<= 1
            value ^= _POLYNOMIAL if value & 0x1000000 else 0
        table.append(value)
    return tuple(table)


_TABLE = _make_table()


def compute_crc24q(data: bytes) -> int:
    """Compute the checksum; that of a message with its own checksum behind it is zero."""
    value = 0
    for byte in data:
        value = (value << 8 & 0xFFFFFF) ^ _TABLE[value >> 16 ^ byte]
    return value


def make_message(payload: bytes) -> bytes:
    """Put a payload of at most 1023 bytes between preamble and checksum."""
    head = bytes((PREAMBLE, len(payload) >> 8, len(payload) & 0xFF)) + payload
    return head + compute_crc24q(head).to_bytes(3, "big")
