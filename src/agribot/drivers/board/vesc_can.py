"""VESC motor controllers on a CAN bus: `can:can0?board=vesc&ids=11,12`.

Each reports its status by itself, as often as it is set up to; wheel speeds go out as electrical
revolutions a minute. Source: the CAN packets of VESC firmware 5 and later (vedderb/bldc:
comm/comm_can.c): CAN_PACKET_SET_RPM, STATUS, STATUS_4 and STATUS_5, in identifiers of 29 bits whose
lowest eight are the controller's; numbers have their high byte first. They report no faults there.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable

from agribot.core.errors import ConfigError
from agribot.core.messages import (
    BatterySample,
    BoardSample,
    Four,
    ImplementCommand,
    SafetyInput,
    WheelSample,
)
from agribot.core.robot import RobotSpec
from agribot.drivers.board.can_frames import CanDecoder, CanFrame
from agribot.drivers.board.motor_board import BoardReport, FreshValues, StampedReport
from agribot.drivers.board.vesc import (
    LOCAL,
    STEPS_PER_ELECTRICAL_TURN,
    CounterOf32Bits,
    read_gearing,
    read_ids,
)
from agribot.drivers.line.uri_options import UriOptions

SET_RPM, STATUS, STATUS_4, STATUS_5 = 3, 9, 16, 27
_SPEED, _CURRENT, _COUNT = struct.Struct(">i"), struct.Struct(">4xh"), struct.Struct(">ih")


class VescCanBoard:
    """Two controllers, right and left, or four for the wheels in the order of WHEEL_NAMES.

    A reading is whole when each has reported its speed, tachometer and voltage anew: one that
    is silent makes the board silent.
    """

    inputs: frozenset[SafetyInput] = frozenset({"battery"})
    latency_s = 0.002
    trouble = ""

    def __init__(
        self, ids: tuple[int, ...], pole_pairs: int, gear_ratio: float,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self._now_s = now_s
        self._ids, self._wheels = ids, ids if len(ids) == 4 else (*ids, *ids)
        self._electrical_turns = pole_pairs * gear_ratio  # for a turn of the wheel
        self._counts: dict[int, CounterOf32Bits] = {}
        self.open()

    def open(self) -> bytes:
        self._decoder = CanDecoder()
        self._erpm = FreshValues[float](self._now_s)
        self._volts = FreshValues[float](self._now_s)
        self._amperes = FreshValues[float](self._now_s)
        return b""

    def poll(self) -> bytes:
        return b""  # they report without being asked

    def feed(self, data: bytes) -> list[StampedReport]:
        found = []
        for frame in self._decoder.feed(data):
            if frame.is_extended and not frame.is_remote:
                self._take(frame.identifier >> 8, frame.identifier & 0xFF, frame.data)
            if not len(self._erpm) == len(self._volts) == len(self._ids):
                continue
            erpm, volts = self._erpm.take(), self._volts.take()
            if len(erpm) == len(volts) == len(self._ids):
                found.append(StampedReport(0.0, self._report(erpm, min(volts.values()))))
                self._erpm.clear()
                self._volts.clear()
        return found

    def drive(self, speeds_radps: Four, implement: ImplementCommand) -> bytes:
        to_erpm = 60.0 / math.tau * self._electrical_turns
        return b"".join(
            CanFrame(SET_RPM << 8 | one, _SPEED.pack(round(speed * to_erpm)), True).pack()
            for one, speed in zip(self._ids, speeds_radps, strict=False)
        )

    def clear_stop(self) -> bytes:
        return b""  # it holds none: after a silence it takes the next speed

    def _take(self, kind: int, one: int, data: bytes) -> None:
        if one not in self._ids:
            return
        if kind == STATUS and len(data) >= 8:
            self._erpm.put(one, float(_SPEED.unpack_from(data)[0]))
        elif kind == STATUS_4 and len(data) >= 6:
            self._amperes.put(one, _CURRENT.unpack_from(data)[0] / 10.0)
        elif kind == STATUS_5 and len(data) >= 6:
            count, voltage_dv = _COUNT.unpack_from(data)
            self._volts.put(one, voltage_dv / 10.0)
            self._counts.setdefault(one, CounterOf32Bits()).add(count)

    def _report(self, erpm: dict[int, float], voltage_v: float) -> BoardReport:
        turns = self._electrical_turns
        steps = STEPS_PER_ELECTRICAL_TURN * turns / math.tau
        a, b, c, d = (self._counts[one].total / steps for one in self._wheels)
        e, f, g, h = (erpm[one] * math.tau / 60.0 / turns for one in self._wheels)
        amperes = self._amperes.take()
        return BoardReport(
            wheels=WheelSample(t_s=0.0, angle_rad=(a, b, c, d), speed_radps=(e, f, g, h)),
            battery=BatterySample(
                t_s=0.0, voltage_v=voltage_v, charge_ratio=math.nan,
                current_a=sum(amperes.values()) if len(amperes) == len(self._ids) else math.nan,
            ),
            board=BoardSample(t_s=0.0, inputs=("battery",)),
        )  # fmt: skip


def make_board(robot: RobotSpec, options: UriOptions) -> VescCanBoard:
    """Make it of `ids`, `pole_pairs` and `gear`.

    Raises: ConfigError: an invalid option, or no ids.
    """
    ids = read_ids(options.pop_text("ids", ""), "ids=11,12")
    if LOCAL in ids:
        raise ConfigError("ids: 'local' is the controller on a serial line; on CAN each has an id")
    return VescCanBoard(ids, *read_gearing(options))
