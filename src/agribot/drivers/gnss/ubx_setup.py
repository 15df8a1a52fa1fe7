"""Setting up a u-blox receiver for driving: what is written to it, and what it answers.

Sources: UBXDOC-963802114-12815 (F9: CFG-VALSET and its keys, MON-VER, ACK), UBX-13003221 (M8:
CFG-RATE, CFG-MSG, CFG-NAV5, CFG-CFG). No input or output here.
"""

from __future__ import annotations

import struct
from collections import deque
from typing import NamedTuple

from agribot.drivers.gnss.sky import NAV_DOP, NAV_SAT, RXM_COR, RXM_RTCM
from agribot.drivers.gnss.ubx import (
    NAV_HPPOSLLH,
    NAV_PVT,
    NAV_RELPOSNED,
    UbxFrame,
    make_frame,
)

MON_VER, ACK, NAK = (0x0A, 0x04), (0x05, 0x01), (0x05, 0x00)
CFG_VALSET, CFG_RATE, CFG_MSG, CFG_NAV5, CFG_CFG = (
    (0x06, 0x8A), (0x06, 0x08), (0x06, 0x01), (0x06, 0x24), (0x06, 0x09),
)  # fmt: skip
DYNAMIC_MODELS = {"portable": 0, "pedestrian": 3, "automotive": 4}
LEAST_VALSET_PROTOCOL = 27.0  # protocol of the ninth generation; the eighth has other messages
_RAM, _KEPT = 0b001, 0b110  # layers: now; after switching off (battery and flash)
_RATE_MEAS, _DYNMODEL = 0x30210001, 0x20110021
# Keys of CFG-MSGOUT for I2C; those of UART1, UART2 and USB follow.
_OUTPUT_KEYS = {
    NAV_PVT: 0x20910006,
    NAV_SAT: 0x20910015,
    NAV_DOP: 0x20910038,
    NAV_HPPOSLLH: 0x20910033,
    NAV_RELPOSNED: 0x2091008D,
    RXM_RTCM: 0x20910268,
    RXM_COR: 0x209106B6,
}
_PORTS = (1, 2, 3)  # UART1, UART2, USB
_RTCM_INPUTS = (0x10730004, 0x10750004, 0x10770004)  # messages of RTCM on the same ports
_VALUE_FORMATS = {1: "B", 2: "B", 3: "H", 4: "I"}  # formats by the bits 28 to 30 of a key
_SECTIONS = 0x1F1F  # all sections of CFG-CFG
_VERSION_WORDS = 30


class SetupPlan(NamedTuple):
    """Settings of a receiver; `model` is one of DYNAMIC_MODELS."""

    rate_hz: float = 10.0
    model: str = "automotive"
    is_kept: bool = False  # when it is switched off


def write_setup(plan: SetupPlan, protocol: float) -> list[bytes]:
    """Write the frames that set up a receiver of that protocol version."""
    if protocol >= LEAST_VALSET_PROTOCOL:
        return _write_values(plan)
    return _write_messages(plan)


def write_valset(values: dict[int, int], layers: int) -> bytes:
    """Write CFG-VALSET with at most 64 keys and their values."""
    body = struct.pack("<BBxx", 0, layers)
    for key, value in values.items():
        body += struct.pack(f"<I{_VALUE_FORMATS[key >> 28 & 7]}", key, value)
    return make_frame(CFG_VALSET, body)


def _write_values(plan: SetupPlan) -> list[bytes]:
    layers = _RAM | (_KEPT if plan.is_kept else 0)
    each_second = max(round(plan.rate_hz), 1)
    groups = [{_RATE_MEAS: round(1000.0 / plan.rate_hz), _DYNMODEL: DYNAMIC_MODELS[plan.model]}]
    for kind, key in _OUTPUT_KEYS.items():
        every = each_second if kind in (NAV_SAT, NAV_DOP) else 1
        groups.append({key + port: every for port in _PORTS})
    groups.append(dict.fromkeys(_RTCM_INPUTS, 1))
    return [write_valset(values, layers) for values in groups]


def _write_messages(plan: SetupPlan) -> list[bytes]:
    """Write the messages of the eighth generation, which has no heading and no RTK."""
    each_second = max(round(plan.rate_hz), 1)
    model = struct.pack("<HB33x", 1, DYNAMIC_MODELS[plan.model])
    frames = [
        make_frame(CFG_RATE, struct.pack("<HHH", round(1000.0 / plan.rate_hz), 1, 1)),
        make_frame(CFG_NAV5, model),
        make_frame(CFG_MSG, bytes((*NAV_PVT, 1))),
        make_frame(CFG_MSG, bytes((*NAV_SAT, each_second))),
        make_frame(CFG_MSG, bytes((*NAV_DOP, each_second))),
    ]
    if plan.is_kept:
        frames.append(make_frame(CFG_CFG, struct.pack("<III", 0, _SECTIONS, 0)))
    return frames


class Version(NamedTuple):
    """Version of a receiver, from MON-VER."""

    model: str
    protocol: float


def read_version(payload: bytes) -> Version:
    """Read MON-VER; a receiver that states no protocol version is of the oldest."""
    words = [_read_text(payload[:30]), _read_text(payload[30:40])]
    words += [
        _read_text(payload[k : k + _VERSION_WORDS]) for k in range(40, len(payload), _VERSION_WORDS)
    ]
    stated = dict(word.partition("=")[::2] for word in words if "=" in word)
    try:
        protocol = float(stated.get("PROTVER", "0"))
    except ValueError:
        protocol = 0.0
    return Version(stated.get("MOD", words[1]), protocol)


def _read_text(data: bytes) -> str:
    text = data.partition(b"\0")[0].decode("ascii", "replace")
    return "".join(c for c in text if c.isascii() and c.isprintable())


class ReceiverSetup:
    """The talk with a receiver: call `add` with each frame of it and send what that gives.

    It begins with `ask`. Settings that the receiver refuses, as one without RTK does those for
    RTK, are in `refused`; `is_done` when all are answered.
    """

    ask = make_frame(MON_VER, b"")

    def __init__(self, plan: SetupPlan) -> None:
        self._plan = plan
        self._waiting: deque[bytes] = deque()
        self.version: Version | None = None
        self.accepted = 0
        self.refused: list[bytes] = []

    @property
    def is_done(self) -> bool:
        return self.version is not None and not self._waiting

    def add(self, frame: UbxFrame) -> bytes:
        """Add a frame of the receiver; gives the bytes to send next, often none."""
        if frame.kind == MON_VER and self.version is None and len(frame.payload) >= 40:
            self.version = read_version(frame.payload)
            self._waiting.extend(write_setup(self._plan, self.version.protocol))
            return self._waiting[0]
        if frame.kind not in (ACK, NAK) or not self._waiting:
            return b""
        sent = self._waiting[0]
        if tuple(frame.payload[:2]) != tuple(sent[2:4]):
            return b""
        self._waiting.popleft()
        if frame.kind == ACK:
            self.accepted += 1
        else:
            self.refused.append(sent)
        return self._waiting[0] if self._waiting else b""
