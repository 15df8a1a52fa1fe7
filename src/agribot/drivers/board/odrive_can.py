"""ODrives on a CAN bus by CANSimple: `can:can0?board=odrive&nodes=0,1`, a node for each side.

Source: ODrive's documentation, "CAN Protocol" (firmware 0.5 and 0.6): identifiers of 11 bits, node
and five bits of the command; numbers have their low byte first. Heartbeats come by themselves;
what else is asked for by remote frames comes once for each. A watchdog is switched on with the
maker's program, for CANSimple cannot do it; a velocity feeds it.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable

from agribot.core.errors import ConfigError
from agribot.core.messages import Four, ImplementCommand, SafetyInput
from agribot.core.robot import RobotSpec
from agribot.drivers.board.can_frames import CanDecoder, CanFrame
from agribot.drivers.board.motor_board import BoardReport, FreshValues, StampedReport
from agribot.drivers.board.odrive import (
    CLOSED_LOOP,
    ROUND_TICKS,
    WATCHDOG_EXPIRED,
    AxisState,
    SideAxes,
    read_machine,
)
from agribot.drivers.line.uri_options import UriOptions

HEARTBEAT, SET_STATE, ESTIMATES, SET_VELOCITY, BUS_VOLTAGE, CLEAR_ERRORS = (
    0x01, 0x07, 0x09, 0x0D, 0x17, 0x18,
)  # fmt: skip
COMMAND_BITS = 5
MOST_NODES = 0x3F
_HEARTBEAT, _TWO, _STATE = struct.Struct("<IB"), struct.Struct("<ff"), struct.Struct("<I")


class OdriveCanBoard:
    """`nodes` are those of the right and the left side.

    It drives no wheel before both axes are in closed loop, and holds a stop until then. Nodes whose
    heartbeats stay away are not reported, but for their motion.
    """

    inputs: frozenset[SafetyInput] = frozenset({"battery", "motors"})
    latency_s = 0.002
    trouble = ""

    def __init__(
        self, nodes: tuple[int, int], gear_ratio: float, error: str = "error",
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """`error` is what a firmware calls the faults of an axis: 0.6 has `active_errors`."""
        self._nodes, self._gear, self._now_s = nodes, gear_ratio, now_s
        self._sides = SideAxes(nodes, gear_ratio, WATCHDOG_EXPIRED[error], "node")
        self.open()

    def open(self) -> bytes:
        self._decoder = CanDecoder()
        self._states = FreshValues[AxisState](self._now_s)
        self._motion = FreshValues[tuple[float, float]](self._now_s)
        self._volts = FreshValues[float](self._now_s)
        self._heard_nodes: set[int] = set()  # nodes whose heartbeat came since the last command
        self._polls, self._is_changing, self._is_known = 0, False, False
        return b""

    def poll(self) -> bytes:
        wanted = [ESTIMATES, *([BUS_VOLTAGE] if self._polls % ROUND_TICKS == 0 else [])]
        self._polls += 1
        return b"".join(
            CanFrame(node << COMMAND_BITS | one, is_remote=True).pack()
            for node in self._nodes
            for one in wanted
        )

    def feed(self, data: bytes) -> list[StampedReport]:
        found = []
        for frame in self._decoder.feed(data):
            node, command = divmod(frame.identifier, 1 << COMMAND_BITS)
            if frame.is_extended or frame.is_remote or node not in self._nodes:
                continue
            self._take(node, command, frame.data)
            if len(self._motion) == 2 and (report := self._make_report()):
                found.append(StampedReport(0.0, report))
        return found

    def drive(self, speeds_radps: Four, implement: ImplementCommand) -> bytes:
        to_turns = self._gear / math.tau
        return b"".join(
            self._write(node, SET_VELOCITY, _TWO.pack(speed * to_turns, 0.0))
            for node, speed in zip(self._nodes, speeds_radps[:2], strict=True)
        )

    def clear_stop(self) -> bytes:
        """Clear the errors of nodes that stand, and put them in closed loop.

        No further command goes to them before both have reported their state again.
        """
        if self._is_changing:
            return b""
        self._is_changing, self._heard_nodes = True, set()
        states = self._states.take()
        standing = [n for n in self._nodes if self._sides.is_standing(states.get(n))]
        return b"".join(
            self._write(node, SET_VELOCITY, _TWO.pack(0.0, 0.0))
            + self._write(node, CLEAR_ERRORS, b"\0")
            + self._write(node, SET_STATE, _STATE.pack(CLOSED_LOOP))
            for node in standing
        )

    def _make_report(self) -> BoardReport | None:
        """Make a reading once both have reported their motion, and each its state at least once."""
        motion, states = self._motion.take(), self._states.take()
        self._is_known |= len(states) == 2
        if len(motion) < 2 or not self._is_known:
            return None
        self._motion.clear()
        voltage_v = min(self._volts.take().values(), default=math.nan)
        return self._sides.report(motion, states if len(states) == 2 else None, voltage_v)

    def _take(self, node: int, command: int, data: bytes) -> None:
        if command == HEARTBEAT and len(data) >= _HEARTBEAT.size:
            self._states.put(node, AxisState(*_HEARTBEAT.unpack_from(data)))
            self._heard_nodes.add(node)
            self._is_changing &= len(self._heard_nodes) < 2
        elif command in (ESTIMATES, BUS_VOLTAGE) and len(data) >= _TWO.size:
            first, second = _TWO.unpack_from(data)
            if not math.isfinite(first + second):
                return
            if command == ESTIMATES:
                self._motion.put(node, (first, second))
            else:
                self._volts.put(node, first)

    @staticmethod
    def _write(node: int, command: int, data: bytes) -> bytes:
        return CanFrame(node << COMMAND_BITS | command, data).pack()


def make_board(robot: RobotSpec, options: UriOptions) -> OdriveCanBoard:
    """Make it of `nodes`, `gear` and `errors`.

    Raises: ConfigError: an invalid option.
    """
    text = options.pop_text("nodes", "0,1")
    words = text.split(",")
    nodes = tuple(int(word) for word in words if word.strip().isdecimal())
    if len(words) != 2 or len(set(nodes)) != 2 or max(nodes) > MOST_NODES:
        raise ConfigError(
            f"nodes={text}: not two nodes; name right and left, up to {MOST_NODES}, as in nodes=0,1"
        )
    return OdriveCanBoard((nodes[0], nodes[1]), *read_machine(options))
