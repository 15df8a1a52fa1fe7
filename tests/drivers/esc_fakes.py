"""Motor controllers of other makers, as their published protocols say, without a line."""

from __future__ import annotations

import struct

from agribot.drivers.vesc import VescDecoder, make_packet


class FakeVesc:
    """The controller on the line, and those behind it on CAN; speeds are taken at once."""

    def __init__(self, local: int, others: tuple[int, ...]) -> None:
        self._local = local
        self.erpm = dict.fromkeys((local, *others), 0)
        self.faults = dict.fromkeys(self.erpm, 0)
        self._steps = dict.fromkeys(self.erpm, 0.0)
        self._decoder = VescDecoder()

    def advance(self, dt_s: float) -> None:
        for one, erpm in self.erpm.items():
            self._steps[one] += erpm / 60.0 * 6.0 * dt_s

    def answer(self, data: bytes) -> bytes:
        out = b""
        for payload in self._decoder.feed(data):
            one, command = self._local, payload
            if payload[0] == 34:
                one, command = payload[1], payload[2:]
            if command[0] == 8:
                (self.erpm[one],) = struct.unpack(">i", command[1:5])
            elif command[0] == 4:
                out += self._tell(one)
        return out

    def _tell(self, one: int) -> bytes:
        steps = round(self._steps[one])
        values = struct.pack(
            ">BhhiiiihihiiiiiiBiB", 4, 251, 300, 120, 80, 0, 0, 100, self.erpm[one], 246, 0, 0, 0,
            0, steps, abs(steps), self.faults[one], 0, one,
        )  # fmt: skip
        return make_packet(values + bytes(8))  # newer firmware appends more


class FakeOdrive:
    """Both axes; velocities are taken at once by an axis in closed loop."""

    def __init__(self) -> None:
        self.states, self.errors = [1, 1], [0, 0]
        self.watchdogs: set[int] = set()
        self._turns, self._speeds = [0.0, 0.0], [0.0, 0.0]
        self._line = b""

    def advance(self, dt_s: float) -> None:
        for axis, speed in enumerate(self._speeds):
            self._turns[axis] += speed * dt_s

    def answer(self, data: bytes) -> bytes:
        *lines, self._line = (self._line + data).split(b"\n")
        return b"".join(self._do(line.decode().split()) for line in lines)

    def _do(self, words: list[str]) -> bytes:
        match words:
            case ["v", axis, speed, _] if self.states[int(axis)] == 8:
                self._speeds[int(axis)] = float(speed)
            case ["f", axis]:
                return f"{self._turns[int(axis)]:f} {self._speeds[int(axis)]:f}\r\n".encode()
            case ["r", "vbus_voltage"]:
                return b"24.3\r\n"
            case ["r", name] if name.endswith(".error"):
                return f"{self.errors[int(name[4])]}\r\n".encode()
            case ["w", name, value] if name.endswith("requested_state"):
                self.states[int(name[4])] = int(value)
            case ["w", name, "1"] if name.endswith("enable_watchdog"):
                self.watchdogs.add(int(name[4]))
            case ["sc"]:
                self.errors = [0, 0]
        return b""
