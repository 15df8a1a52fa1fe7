"""Motor controllers on a CAN bus, as their published protocols say, without a bus."""

from __future__ import annotations

import struct

from agribot.drivers.board.can_frames import CanDecoder, CanFrame
from tests.drivers.esc_fakes import FakeOdrive, FakeVesc

STATUS_PERIOD_S, HEARTBEAT_S = 0.02, 0.1
FEEDS = {0x07, 0x0D}  # commands of CANSimple that feed a watchdog


class FakeVescBus(FakeVesc):
    """Controllers that send their status at 50 Hz; `silent` are switched off."""

    def __init__(self, ids: tuple[int, ...], timeout_s: float = 0.3) -> None:
        super().__init__(ids[0], ids[1:], timeout_s)
        self.silent: set[int] = set()
        self._frames, self._left_s = CanDecoder(), 0.0
        self._out = b""

    def advance(self, dt_s: float) -> None:
        super().advance(dt_s)
        self._left_s -= dt_s
        if self._left_s <= 0.0:
            self._left_s += STATUS_PERIOD_S
            self._out += b"".join(self._tell_status(one) for one in self.erpm)

    def answer(self, data: bytes) -> bytes:
        for frame in self._frames.feed(data):
            kind, one = frame.identifier >> 8, frame.identifier & 0xFF
            if frame.is_extended and kind == 3 and one in self.erpm:
                (self.erpm[one],) = struct.unpack(">i", frame.data)
                self._silent_s[one] = 0.0
        out, self._out = self._out, b""
        return out

    def _tell_status(self, one: int) -> bytes:
        if one in self.silent:
            return b""
        told = {
            9: struct.pack(">ihh", self.erpm[one], 35, 120),
            16: struct.pack(">hhhh", 251, 300, 12, 0),
            27: struct.pack(">ihh", round(self._steps[one]), 246, 0),
        }
        return b"".join(CanFrame(kind << 8 | one, data, True).pack() for kind, data in told.items())


class FakeOdriveBus(FakeOdrive):
    """Two nodes, 0 and 1, that beat ten times a second and answer remote frames.

    Their watchdogs were switched on and saved with the maker's program.
    """

    def __init__(self) -> None:
        super().__init__((0, 6))
        self._frames, self._beat_s, self._out = CanDecoder(), 0.0, b""

    def restart(self) -> None:
        super().restart()
        self.watchdogs = {0, 1}
        self.timeouts_s, self._left_s = [0.3, 0.3], [0.3, 0.3]

    def advance(self, dt_s: float) -> None:
        super().advance(dt_s)
        self._beat_s -= dt_s
        if self._beat_s <= 0.0:
            self._beat_s += HEARTBEAT_S
            for node in (0, 1):
                beat = struct.pack("<IB3x", self.errors[node], self.states[node])
                self._out += CanFrame(node << 5 | 0x01, beat).pack()

    def answer(self, data: bytes) -> bytes:
        for frame in self._frames.feed(data):
            node, command = divmod(frame.identifier, 32)
            if frame.is_remote:
                self._out += CanFrame(frame.identifier, self._tell_node(node, command)).pack()
            else:
                self._obey(node, command, frame.data)
            self._check()
        out, self._out = self._out, b""
        return out

    def _tell_node(self, node: int, command: int) -> bytes:
        if command == 0x17:
            return struct.pack("<ff", 24.3, 1.5)
        return struct.pack("<ff", self._turns[node], self.speed(node))

    def _obey(self, node: int, command: int, data: bytes) -> None:
        if command in FEEDS:
            self._left_s[node] = self.timeouts_s[node]
        if command == 0x0D:
            self._speeds[node] = struct.unpack("<ff", data)[0]
        elif command == 0x18:
            self.clears += 1
            self.errors[node] = 0x200 * self.is_broken
        elif command == 0x07 and not self.errors[node]:
            (self.states[node],) = struct.unpack("<I", data)
            self.lets_go.append(node)

    def _check(self) -> None:
        for node in self.watchdogs:
            if self._left_s[node] <= 0.0:
                self.errors[node] |= 0x0100_0000
        for node, error in enumerate(self.errors):
            if error:
                self.states[node] = 1
