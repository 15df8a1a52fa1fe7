"""Motor controllers of other makers by what they answer: they are silent until they are asked.

Sources: VESC firmware (vedderb/bldc: comm/commands.c), COMM_FW_VERSION, COMM_PING_CAN; ODrive's
documentation, "ASCII Protocol". Nothing that is asked here moves a motor.
"""

from __future__ import annotations

import math
import struct

from agribot.drivers.board.odrive_line import split_answer, write_line
from agribot.drivers.board.vesc_packets import (
    GET_SELECTED,
    MASK,
    VescDecoder,
    VescValues,
    make_packet,
    name_fault,
    read_values,
)
from agribot.drivers.probe.line_answers import LineAnswer

FW_VERSION, PING_CAN = 0, 62
ASK_AGAIN_S = 1.0
PING_S = 4.0  # time in which a controller tries all 255 ids of its CAN bus
ODRIVE_S, FLUSH_S = 1.0, 0.2
NO_PROPERTY = "invalid property"
MUST_REPORT = "--set 'safety.must_report=[\"motors\"]'"
BUTTON_ADVICE = (
    f"it reports no red button: cut the motors' supply by the button, then add {MUST_REPORT}"
)


class VescSpeaker:
    """The controller on the line, and the ids of those behind it on CAN."""

    def __init__(self, begins_s: float, *, may_ask: bool) -> None:
        """Begin to ask at a time."""
        self._may_ask, self._asked_s = may_ask, begins_s - ASK_AGAIN_S
        self._decoder = VescDecoder()
        self._values: VescValues | None = None
        self._firmware = self._model = ""
        self._others: tuple[int, ...] | None = None
        self._has_pinged = False
        self._heard_s = math.inf

    @property
    def is_heard(self) -> bool:
        return self._heard_s < math.inf

    def feed(self, data: bytes, now_s: float) -> None:
        for payload in self._decoder.feed(data):
            self._heard_s, self._may_ask = min(self._heard_s, now_s), True
            self._values = read_values(payload) or self._values
            if payload[0] == FW_VERSION and len(payload) >= 3:
                self._firmware = f"{payload[1]}.{payload[2]:02d}"
                self._model = _read_text(payload[3:].partition(b"\0")[0])
            elif payload[0] == PING_CAN:
                self._others = tuple(payload[1:])

    def take_to_send(self, now_s: float) -> bytes:
        if not self._may_ask or now_s - self._asked_s < ASK_AGAIN_S:
            return b""
        self._asked_s = now_s
        if self._values is None or not self._firmware:
            values = struct.pack(">BI", GET_SELECTED, MASK)
            return make_packet(bytes((FW_VERSION,))) + make_packet(values)
        if not self._has_pinged:
            self._has_pinged = True
            return make_packet(bytes((PING_CAN,)))
        return b""

    def is_done(self, now_s: float) -> bool:
        has_answer = self._others is not None and self._values is not None
        return has_answer or now_s - self._heard_s > PING_S + 2.0 * ASK_AGAIN_S

    def answer(self, baud: int) -> LineAnswer:
        others = self._others or ()
        values = self._values
        words = [f"VESC {self._model}".strip(), f"firmware {self._firmware or 'unknown'}"]
        fault = ""
        if values is not None:
            fault = name_fault(values.fault)
            words += [f"CAN id {values.controller}", f"{values.voltage_v:.1f} V"]
            words += [f"fault: {fault}"] if fault else ["no fault"]
        words.append(f"behind it on CAN: {', '.join(map(str, others)) or 'none'}")
        is_whole = len(others) in (1, 3)
        ids = ",".join(("local", *map(str, others)))
        return LineAnswer(
            kind="vesc", detail=", ".join(words), baud=baud, use="base",
            options=(("board", "vesc"), ("ids", ids)), is_good=is_whole and values is not None,
            advice=(_advise_ids(len(others)), BUTTON_ADVICE),
            numbers={
                "firmware": self._firmware, "can_ids": list(others), "fault": fault,
                **({"voltage_v": values.voltage_v} if values else {}),
            },
        )  # fmt: skip


def _advise_ids(others: int) -> str:
    if others == 1:
        return "ids are right, left: turn them round where the one on the line is the left one"
    if others == 3:
        return "put the ids in the order right rear, left rear, right front, left front"
    return f"a robot has two or four controllers; here are {1 + others}: check CAN, power and ids"


class OdriveSpeaker:
    """An ODrive by its ASCII protocol."""

    _QUESTIONS = (
        "vbus_voltage", "fw_version_major", "fw_version_minor", "axis0.error",
        "axis0.active_errors", "axis1.error", "axis1.active_errors", "axis0.current_state",
        "axis1.current_state",
    )  # fmt: skip

    def __init__(self, begins_s: float, *, may_ask: bool) -> None:
        """Begin to ask at a time, when others were tried."""
        self._may_ask, self._next_s = may_ask, begins_s
        self._line, self._is_flushed, self._has_checksums = b"", False, False
        self._said: dict[str, float | None] = {}
        self._asked = ""

    @property
    def is_heard(self) -> bool:
        return all(self._said.get(name) is not None for name in self._QUESTIONS[:3])

    def feed(self, data: bytes, now_s: float) -> None:
        *lines, rest = (self._line + data).split(b"\n")
        self._line = rest[-256:]
        for line in lines:
            if self._asked and (text := self._read_answer(line)):
                self._said[self._asked] = _read_float(text)
                self._asked, self._next_s = "", now_s

    def take_to_send(self, now_s: float) -> bytes:
        """Ask for one property after the other: an answer does not say to which it belongs."""
        left = [name for name in self._QUESTIONS if name not in self._said]
        if not self._may_ask or now_s < self._next_s or not left:
            return b""
        if not self._is_flushed:  # an answer to what came half, or from others, is not ours
            self._is_flushed, self._next_s = True, now_s + FLUSH_S
            return b"\n"
        if self._asked:
            self._said[self._asked] = None
            left = left[1:]
        self._next_s = now_s + ODRIVE_S
        self._asked = left[0] if left else ""
        return write_line(f"r {self._asked}").encode() if left else b""

    def _read_answer(self, line: bytes) -> str:
        """Read what answers a question for a property; empty of what is broken or was not asked."""
        text, has_checksum = split_answer(line) or ("", False)
        is_answer = text == NO_PROPERTY or _read_float(text) is not None
        if not is_answer or (self._has_checksums and not has_checksum):
            return ""
        self._has_checksums = has_checksum
        return text

    def is_done(self, now_s: float) -> bool:
        return len(self._said) == len(self._QUESTIONS)

    def answer(self, baud: int) -> LineAnswer:
        name = "error" if self._said.get("axis0.error") is not None else "active_errors"
        errors = {axis: int(self._said.get(f"axis{axis}.{name}") or 0) for axis in (0, 1)}
        states = {axis: int(self._said.get(f"axis{axis}.current_state") or 0) for axis in (0, 1)}
        version = ".".join(
            str(int(self._said.get(f"fw_version_{part}") or 0)) for part in ("major", "minor")
        )
        has_both = self._said.get("axis1.current_state") is not None
        faults = [f"axis {axis} has error {error:#x}" for axis, error in errors.items() if error]
        words = [f"ODrive, firmware {version}", f"{self._said['vbus_voltage']:.1f} V"]
        words += [f"axis {axis} in state {state}" for axis, state in states.items()][: 1 + has_both]
        options = {"board": "odrive", **({} if name == "error" else {"errors": name})}
        return LineAnswer(
            kind="odrive", detail=", ".join([*words, *faults]), baud=baud, use="base",
            options=tuple(options.items()), is_good=has_both,
            advice=(
                *(() if has_both else ("it has one axis, and a robot needs two",)),
                "axes are right, left: axes=1,0 where axis 0 is the left side", BUTTON_ADVICE,
            ),
            numbers={"firmware": version, "voltage_v": self._said["vbus_voltage"],
                     "errors": list(errors.values()), "states": list(states.values())},
        )  # fmt: skip


def _read_float(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _read_text(data: bytes) -> str:
    return "".join(c for c in data.decode("ascii", "replace") if c.isascii() and c.isprintable())
