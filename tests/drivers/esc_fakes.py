"""Motor controllers of other makers, as their published protocols say, without a line."""

from __future__ import annotations

import struct

from agribot.drivers.board.odrive_line import compute_checksum, split_answer
from agribot.drivers.board.vesc_packets import VescDecoder, make_packet

IDLE, CLOSED_LOOP = 1, 8  # of an ODrive's axis


class FakeVesc:
    """The controller on the line, and those behind it on CAN; speeds are taken at once.

    One that hears no speed for `timeout_s` lets go of its motor, and takes the next one.
    """

    def __init__(self, local: int, others: tuple[int, ...], timeout_s: float = 0.3) -> None:
        self._local, self._timeout_s = local, timeout_s
        self.erpm = dict.fromkeys((local, *others), 0)
        self.faults = dict.fromkeys(self.erpm, 0)
        self._steps = dict.fromkeys(self.erpm, 0.0)
        self._silent_s = dict.fromkeys(self.erpm, 0.0)
        self._decoder = VescDecoder()

    def advance(self, dt_s: float) -> None:
        for one, erpm in self.erpm.items():
            self._steps[one] += erpm / 60.0 * 6.0 * dt_s
            self._silent_s[one] += dt_s
            if self._silent_s[one] > self._timeout_s:
                self.erpm[one] = 0

    def answer(self, data: bytes) -> bytes:
        out = b""
        for payload in self._decoder.feed(data):
            one, command = self._local, payload
            if payload[0] == 34:
                one, command = payload[1], payload[2:]
            if command[0] == 8:
                (self.erpm[one],) = struct.unpack(">i", command[1:5])
                self._silent_s[one] = 0.0
            elif command[0] == 0:
                out += make_packet(b"\x00\x06\x05" + b"60_MK6\0" + bytes(12))
            elif command[0] == 62 and one == self._local:
                out += make_packet(bytes((62, *(other for other in self.erpm if other != one))))
            elif command[0] == 50:
                out += make_packet(self._tell(one, *struct.unpack(">I", command[1:5])))
        return out

    def _tell(self, one: int, mask: int) -> bytes:
        """Encode the values that the bits of `mask` ask for, in their order."""
        steps = round(self._steps[one])
        values = (
            ("h", 251), ("h", 300), ("i", 120), ("i", 80), ("i", 0), ("i", 0), ("h", 100),
            ("i", self.erpm[one]), ("h", 246), ("i", 0), ("i", 0), ("i", 0), ("i", 0), ("i", steps),
            ("i", abs(steps)), ("B", self.faults[one]), ("i", 0), ("B", one),
        )  # fmt: skip
        asked = [value for bit, value in enumerate(values) if mask >> bit & 1]
        formats = "".join(kind for kind, _ in asked)
        return struct.pack(f">BI{formats}", 50, mask, *(number for _, number in asked))


class FakeOdrive:
    """Both axes; velocities are taken at once by an axis in closed loop.

    As in its firmware a watchdog that is on counts in every state, `v` feeds it, and an axis with
    an error enters no closed loop. 24 of its control loops pass while a line arrives, so that a
    watchdog without time has expired before the next one.
    """

    def __init__(self, firmware: tuple[int, int] = (0, 5)) -> None:
        self.firmware = firmware
        self.restart()

    def restart(self) -> None:
        """Begin anew, as after a brown-out: what was not saved is forgotten."""
        self.states, self.errors = [IDLE, IDLE], [0, 0]
        self.watchdogs: set[int] = set()
        self.timeouts_s, self._left_s = [0.0, 0.0], [0.0, 0.0]
        self._turns, self._speeds = [0.0, 0.0], [0.0, 0.0]
        self._line = b""
        self.is_broken = False  # it has an error again as soon as it was cleared
        self.clears = 0
        self.lets_go: list[int] = []  # axes that were put into a state

    @property
    def _error(self) -> str:
        """What this firmware calls the errors of an axis."""
        return "active_errors" if self.firmware >= (0, 6) else "error"

    def speed(self, axis: int) -> float:
        return self._speeds[axis] if self.states[axis] == CLOSED_LOOP else 0.0

    def advance(self, dt_s: float) -> None:
        for axis in (0, 1):
            self._turns[axis] += self.speed(axis) * dt_s
            if axis in self.watchdogs:
                self._left_s[axis] -= dt_s
        self._check()

    def answer(self, data: bytes) -> bytes:
        *lines, self._line = (self._line + data).split(b"\n")
        said = b""
        for line in lines:
            told = split_answer(line)
            if told is None:  # one with a wrong checksum is left out
                continue
            try:
                said += self._reply(self._do(told[0].split()), has_checksum=told[1])
            except (ValueError, IndexError):
                said += self._reply("invalid command format", has_checksum=told[1])
            self._check()
        return said

    @staticmethod
    def _reply(text: str, *, has_checksum: bool) -> bytes:
        checksum = f"*{compute_checksum(text)}" if has_checksum else ""
        return f"{text}{checksum}\r\n".encode() if text else b""

    def _check(self) -> None:
        for axis in self.watchdogs:
            if self._left_s[axis] <= 0.0:
                self.errors[axis] |= 0x800
        for axis, error in enumerate(self.errors):
            if error:
                self.states[axis] = IDLE

    def _do(self, words: list[str]) -> str:
        match words:
            case ["v", "0" | "1" as axis, speed, _]:
                self._speeds[int(axis)] = float(speed)
                self._left_s[int(axis)] = self.timeouts_s[int(axis)]
            case ["f", "0" | "1" as axis]:
                return f"{self._turns[int(axis)]:f} {self.speed(int(axis)):f}"
            case ["r", name]:
                return self._read(name)
            case ["w", name, value]:
                self._write(name, value)
            case ["sc"]:
                self.clears += 1
                self.errors = [0x200 * self.is_broken] * 2
            case [_, *_]:
                return "unknown command"
        return ""

    def _read(self, name: str) -> str:
        axis = int(name[4]) if name.startswith("axis") else 0
        known = {
            "vbus_voltage": "24.3",
            "fw_version_major": self.firmware[0],
            "fw_version_minor": self.firmware[1],
            f"axis{axis}.current_state": self.states[axis],
            f"axis{axis}.{self._error}": self.errors[axis],
        }
        return str(known.get(name, "invalid property"))

    def _write(self, name: str, value: str) -> None:
        axis = int(name[4])
        if name.endswith("requested_state") and not self.errors[axis]:
            self.states[axis] = int(value)
            self.lets_go.append(axis)
        elif name.endswith("watchdog_timeout"):
            self.timeouts_s[axis] = float(value)
        elif name.endswith("enable_watchdog") and value == "1":
            self.watchdogs.add(axis)
