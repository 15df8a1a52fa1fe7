"""Packets of VESC motor controllers, and what a controller answers about its values.

Source: the packets and commands of VESC firmware 5 and later (vedderb/bldc: comm/packet.c,
comm/commands.c, datatypes.h): COMM_GET_VALUES_SELECTIVE and mc_fault_code. A packet is 2, length,
payload, CRC-16/XMODEM high byte first, 3; one longer than 255 bytes begins with 3 and two bytes of
length. An answer repeats the mask of its question.

Only what is used is asked for: 26 bytes of an answer instead of 79.
"""

from __future__ import annotations

import functools
import struct
from binascii import crc_hqx
from typing import NamedTuple

GET_SELECTED = 50
SHORT, LONG, END = 2, 3, 3
LONGEST_PAYLOAD = 512
# Bits of GET_VALUES_SELECTIVE with the formats of their numbers: current of the battery, rpm,
# voltage, tachometer, fault, id.
_FORMATS = {3: "i", 7: "i", 8: "h", 13: "i", 15: "B", 17: "B"}
MASK = sum(1 << bit for bit in _FORMATS)
# Bits that are asked for to know the answer again: temperatures, duty, current of the motor.
_MARKS = {0: "h", 1: "h", 6: "h", 2: "i"}
MOST_MARKS = (1 << len(_MARKS)) - 1
FAULTS = (
    "", "over voltage", "under voltage", "DRV", "absolute over current", "over temperature of FET",
    "over temperature of motor", "gate driver over voltage", "gate driver under voltage",
    "MCU under voltage (brown-out)", "booting from watchdog reset", "encoder SPI",
)  # fmt: skip


class VescValues(NamedTuple):
    """Answer of one controller."""

    controller: int
    erpm: float
    tachometer: int
    voltage_v: float
    input_a: float
    fault: int


class VescDecoder:
    """Finds packets in a stream of bytes; what is broken is counted in `bad` and left out."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self.bad = 0

    def feed(self, data: bytes) -> list[bytes]:
        """Give the payloads of the packets that `data` completes."""
        self._waiting += data
        found = []
        while self._waiting:
            size = self._measure()
            if size is None:
                break
            payload = self._take(size)
            if payload is None:
                self.bad += 1
                del self._waiting[0]
            else:
                found.append(payload)
        return found

    def _measure(self) -> int | None:
        """Measure the head and payload of what may be a packet; 0 for none, None to wait."""
        waiting = self._waiting
        head = {SHORT: 2, LONG: 3}.get(waiting[0], 0)
        if not head:
            return 0
        if len(waiting) < head:
            return None
        length = int.from_bytes(waiting[1:head], "big")
        if not 0 < length <= LONGEST_PAYLOAD:
            return 0
        return None if len(waiting) < head + length + 3 else head + length

    def _take(self, size: int) -> bytes | None:
        waiting = self._waiting
        if not size or waiting[size + 2] != END:
            return None
        payload = bytes(waiting[2 if waiting[0] == SHORT else 3 : size])
        if crc_hqx(payload, 0) != int.from_bytes(waiting[size : size + 2], "big"):
            return None
        del waiting[: size + 3]
        return payload


def make_packet(payload: bytes) -> bytes:
    head = bytes((SHORT, len(payload))) if len(payload) < 256 else b"\x03" + _two(len(payload))
    return head + payload + _two(crc_hqx(payload, 0)) + bytes((END,))


@functools.cache
def make_mask(mark: int) -> int:
    """Make the mask of a question that is marked by a number up to MOST_MARKS, 0 for none."""
    return MASK | sum(1 << bit for k, bit in enumerate(_MARKS) if mark >> k & 1)


@functools.cache
def _make_format(mask: int) -> struct.Struct:
    """Make the format of an answer: its number, the mask; what marks it is skipped; the values."""
    formats = {bit: f"{struct.calcsize(one)}x" for bit, one in _MARKS.items()} | _FORMATS
    return struct.Struct(
        ">BI" + "".join(formats[bit] for bit in sorted(formats) if mask >> bit & 1)
    )


def read_values(payload: bytes, mask: int = MASK) -> VescValues | None:
    """Read the answer about a mask; None where it is another one, or one that is cut off."""
    head, values = struct.pack(">BI", GET_SELECTED, mask), _make_format(mask)
    if len(payload) != values.size or not payload.startswith(head):
        return None
    _, _, input_ca, erpm, voltage_dv, tachometer, fault, controller = values.unpack(payload)
    return VescValues(
        controller, float(erpm), tachometer, voltage_dv / 10.0, input_ca / 100.0, fault
    )


def name_fault(fault: int) -> str:
    return FAULTS[fault] if fault < len(FAULTS) else f"fault {fault}"


def _two(number: int) -> bytes:
    return number.to_bytes(2, "big")
