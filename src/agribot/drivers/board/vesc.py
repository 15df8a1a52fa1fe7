"""VESC motor controllers as a motor board: `serial:/dev/ttyACM0?board=vesc&ids=local,12`.

One controller is on the line; the others are reached through it over CAN. Wheel speeds go out as
electrical revolutions a minute, and the positions of the motors come back as the tachometer.

Source: the commands of VESC firmware 5 and later (vedderb/bldc: comm/commands.c):
COMM_GET_VALUES_SELECTIVE, COMM_SET_RPM, COMM_FORWARD_CAN.

An answer has 26 bytes, question and command have 24 (20 of the controller on the line). Four
controllers at 100 Hz then take 10.4 of the 11.5 kB/s of
a line of 115200 baud, at the usual 50 Hz half of that.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Mapping

from agribot.core.errors import ConfigError
from agribot.core.facts import ControllerFault, join_facts
from agribot.core.messages import (
    WHEEL_NAMES,
    BatterySample,
    BoardSample,
    Four,
    ImplementCommand,
    SafetyInput,
    WheelSample,
)
from agribot.core.robot import RobotSpec
from agribot.drivers.board.motor_board import GEAR_HOW, BoardReport, FreshValues, StampedReport
from agribot.drivers.board.vesc_packets import (
    GET_SELECTED,
    MOST_MARKS,
    VescDecoder,
    VescValues,
    make_mask,
    make_packet,
    name_fault,
    read_values,
)
from agribot.drivers.line.uri_options import UriOptions

SET_RPM, FORWARD_CAN = 8, 34
STEPS_PER_ELECTRICAL_TURN = 6  # steps of the tachometer
PAUSE_S = 0.2  # time without a reading, after which questions are marked anew
LOCAL = -1


class VescBoard:
    """Two controllers for the two sides, or four for the wheels in the order of WHEEL_NAMES.

    `ids` are their CAN ids, right before left; LOCAL is the one on the line. They report no time,
    red button or bumper. Questions that follow a pause are marked, so that answers
    which the line held back meanwhile are known as old.
    """

    inputs: frozenset[SafetyInput] = frozenset({"battery", "motors"})
    latency_s = 0.002
    trouble = ""

    def __init__(
        self, ids: tuple[int, ...], pole_pairs: int, gear_ratio: float,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self._ids, self._wheels = ids, ids if len(ids) == 4 else (*ids, *ids)
        self._electrical_turns = pole_pairs * gear_ratio  # for a turn of the wheel
        self._decoder = VescDecoder()
        self._values, self._now_s = FreshValues[VescValues](now_s), now_s
        # Marks of the newest questions, and of those before.
        self._marks, self._marked_s = (0, 0), now_s()
        self._counts: dict[int, CounterOf32Bits] = {}

    @property
    def broken(self) -> int:
        """Count of broken packets."""
        return self._decoder.bad

    def open(self) -> bytes:
        self._decoder = VescDecoder()
        self._values.clear()
        self._marks, self._marked_s = (0, 0), self._now_s()
        return self.poll()

    def poll(self) -> bytes:
        now_s = self._now_s()
        if now_s - self._marked_s > PAUSE_S:
            last = self._marks[0]
            self._marks, self._marked_s = (1 + last % MOST_MARKS, last), now_s
        question = struct.pack(">BI", GET_SELECTED, make_mask(self._marks[0]))
        return b"".join(self._send(one, question) for one in self._ids)

    def feed(self, data: bytes) -> list[StampedReport]:
        found = []
        for payload in self._decoder.feed(data):
            values_by_id = (read_values(payload, make_mask(mark)) for mark in self._marks)
            values = next(filter(None, values_by_id), None)
            if values is not None and (report := self._add(values)):
                found.append(StampedReport(0.0, report))
        return found

    def drive(self, speeds_radps: Four, implement: ImplementCommand) -> bytes:
        out = b""
        for k, one in enumerate(self._ids):
            erpm = speeds_radps[k] * 60.0 / math.tau * self._electrical_turns
            out += self._send(one, struct.pack(">Bi", SET_RPM, round(erpm)))
        return out

    def clear_stop(self) -> bytes:
        return b""  # it holds none: after a fault, as after a silence, it takes the next speed

    def _send(self, one: int, payload: bytes) -> bytes:
        forward = b"" if one == LOCAL else bytes((FORWARD_CAN, one))
        return make_packet(forward + payload)

    def _add(self, values: VescValues) -> BoardReport | None:
        """Take an answer in; it is a reading once every controller has answered.

        The controller on the line has whatever id is not one of the others'.
        """
        known = set(self._ids) - {LOCAL}
        one = values.controller if values.controller in known else LOCAL
        if one not in self._ids:
            return None
        self._values.put(one, values)
        self._counts.setdefault(one, CounterOf32Bits()).add(values.tachometer)
        values_by_id = self._values.take()
        if len(values_by_id) < len(self._ids):
            return None
        self._values.clear()
        self._marks, self._marked_s = (0, 0), self._now_s()  # nothing older is under way
        return self._report(values_by_id)

    def _report(self, values_by_id: Mapping[int, VescValues]) -> BoardReport:
        by_wheel = [values_by_id[one] for one in self._wheels]
        steps = STEPS_PER_ELECTRICAL_TURN * self._electrical_turns / math.tau
        turns = self._electrical_turns
        a, b, c, d = (self._counts[one].total / steps for one in self._wheels)
        e, f, g, h = (v.erpm * math.tau / 60.0 / turns for v in by_wheel)
        faults = tuple(name for name, v in zip(WHEEL_NAMES, by_wheel, strict=True) if v.fault)
        ours = [values_by_id[one] for one in self._ids]
        return BoardReport(
            wheels=WheelSample(
                t_s=0.0, angle_rad=(a, b, c, d), speed_radps=(e, f, g, h), faults=faults
            ),
            battery=BatterySample(
                t_s=0.0, voltage_v=min(v.voltage_v for v in ours),
                current_a=sum(v.input_a for v in ours), charge_ratio=math.nan,
            ),
            board=BoardSample(
                t_s=0.0, inputs=("battery", "motors"),
                fault=join_facts([ControllerFault(_name(one), name_fault(v.fault))
                                  for one, v in zip(self._ids, ours, strict=True) if v.fault]),
            ),
        )  # fmt: skip


class CounterOf32Bits:
    """A counter of 32 bits that goes on where it wraps around."""

    def __init__(self) -> None:
        self._last: int | None = None
        self.total = 0

    def add(self, count: int) -> None:
        last = count if self._last is None else self._last
        self._last = count
        self.total += (count - last + 0x80000000) % 0x100000000 - 0x80000000


def make_board(robot: RobotSpec, options: UriOptions) -> VescBoard:
    """Make it of `ids`, `pole_pairs` and `gear`.

    Raises: ConfigError: an invalid option.
    """
    ids = read_ids(options.pop_text("ids", "local"), "ids=local,12")
    return VescBoard(ids, *read_gearing(options))


def read_gearing(options: UriOptions) -> tuple[int, float]:
    """Read `pole_pairs` of the motors and `gear`, turns of a motor for one of its wheel.

    Raises: ConfigError: a number that is not stated, or out of range.
    """
    pole_pairs = options.pop_stated(
        "pole_pairs", 1.0, 100.0, "write pole_pairs=N, half of the motor's magnets"
    )
    gear = options.pop_stated("gear", 0.1, 1000.0, GEAR_HOW)
    return round(pole_pairs), gear


def read_ids(text: str, example: str) -> tuple[int, ...]:
    """Read two or four controllers, each named once.

    Raises: ConfigError: it names others.
    """
    ids = tuple(_read_id(word.strip()) for word in text.split(",") if text)
    if len(ids) not in (2, 4) or len(set(ids)) != len(ids):
        raise ConfigError(
            f"ids={text}: not two or four controllers; name right and left, or right rear, left "
            f"rear, right front and left front, as in {example}"
        )
    return ids


def _read_id(word: str) -> int:
    if word == "local":
        return LOCAL
    if not (word.isdecimal() and int(word) < 255):
        raise ConfigError(f"ids: '{word}' is no controller; write local or a CAN id up to 254")
    return int(word)


def _name(one: int) -> str:
    return "on the line" if one == LOCAL else str(one)
