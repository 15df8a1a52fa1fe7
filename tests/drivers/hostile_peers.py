"""Boards at the other end of a hostile line, their codecs, and the lines themselves."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from agribot.description.loader import load_robot
from agribot.drivers.board import board_kinds
from agribot.drivers.board import board_protocol as wire
from agribot.drivers.board.board_codec import BoardDecoder, encode
from agribot.drivers.board.can_frames import FRAME, CanFrame
from agribot.drivers.board.motor_board import MotorBoard
from agribot.drivers.board.odrive import OdriveBoard
from agribot.drivers.board.odrive_can import OdriveCanBoard
from agribot.drivers.board.vesc import LOCAL, VescBoard
from agribot.drivers.board.vesc_can import VescCanBoard
from tests.drivers.board_emulator import TICK_S as BOARD_TICK_S
from tests.drivers.board_emulator import BoardEmulator
from tests.drivers.can_fakes import FakeOdriveBus, FakeVescBus
from tests.drivers.esc_fakes import CLOSED_LOOP, IDLE, FakeOdrive, FakeVesc
from tests.drivers.hostile_line import Hostility

ROBOT = load_robot()
GYRO_RADPS2 = 0.5
Clock = Callable[[], float]


class Peer(Protocol):
    """A board at the other end of the line."""

    def advance(self, dt_s: float) -> bytes: ...
    def hear(self, data: bytes) -> bytes: ...
    def set_fault(self, *, is_there: bool) -> None: ...
    def turned_rad(self) -> tuple[float, float]: ...


class OdrivePeer:
    """Its left axis has the fault, the other one goes on."""

    def __init__(self, fake: FakeOdrive) -> None:
        self.fake = fake
        fake.states, fake._turns = [CLOSED_LOOP, CLOSED_LOOP], [1000.0, -500.0]
        fake.timeouts_s = [math.inf, math.inf]  # of the watchdogs, which others test

    def advance(self, dt_s: float) -> bytes:
        self.fake._left_s = [math.inf, math.inf]
        self.fake.advance(dt_s)
        return b""

    def hear(self, data: bytes) -> bytes:
        return self.fake.answer(data)

    def set_fault(self, *, is_there: bool) -> None:
        self.fake.errors[1] = 0x40 if is_there else 0
        self.fake.states[1] = 1 if is_there else CLOSED_LOOP

    def turned_rad(self) -> tuple[float, float]:
        right, left = (turns * math.tau / 10.0 for turns in self.fake._turns)
        return right, left


class IdlePeer(OdrivePeer):
    """One that was just switched on."""

    def __init__(self) -> None:
        super().__init__(FakeOdrive())
        self.fake.states = [IDLE, IDLE]

    def set_fault(self, *, is_there: bool) -> None:
        """It has none."""


class PlainOdrive(FakeOdrive):
    """One whose answers have no checksums."""

    @staticmethod
    def _reply(text: str, *, has_checksum: bool) -> bytes:
        return f"{text}\r\n".encode() if text else b""


class VescPeer:
    """Tachometers begin at zero, as the codec counts them."""

    def __init__(self, fake: FakeVesc, left: int) -> None:
        self.fake, self._left = fake, left

    def advance(self, dt_s: float) -> bytes:
        self.fake.advance(dt_s)
        return b""

    def hear(self, data: bytes) -> bytes:
        return self.fake.answer(data)

    def set_fault(self, *, is_there: bool) -> None:
        self.fake.faults[self._left] = 9 if is_there else 0

    def turned_rad(self) -> tuple[float, float]:
        right, left = (steps * math.tau / 6.0 / 70.0 for steps in self.fake._steps.values())
        return right, left


class OurPeer:
    """The board of `firmware/`, whose fault is its red button."""

    def __init__(self) -> None:
        self.fake = BoardEmulator(timeout_s=math.inf)

    def advance(self, dt_s: float) -> bytes:
        return b"".join(self.fake.advance() for _ in range(round(dt_s / BOARD_TICK_S)))

    def hear(self, data: bytes) -> bytes:
        self.fake.feed(data)
        return b""

    def set_fault(self, *, is_there: bool) -> None:
        self.fake.is_button_pressed = is_there

    def turned_rad(self) -> tuple[float, float]:
        right, left, *_ = (count * math.tau / 4096.0 for count in self.fake._counts)
        return right, left


def make_ours(now_s: Clock) -> MotorBoard:
    motors = {"counts_per_turn": 4096.0, "full_speed_radps": 40.0}
    return board_kinds.open_board("tcp://localhost:1?board=agribot", ROBOT, motors).board


SERIAL = Hostility(loss_ratio=2e-4, stray_hz=1.0, strays=(
    b"unknown command\r\n", b"invalid property\r\n", b"8\r\n", b"\xff\x00*", b"\r\n", b"0.25 ",
    b"\x02\x1a\x32\x00\x00", b"0 *7",
))  # fmt: skip
BUS = Hostility(
    loss_ratio=0.02, stray_hz=5.0, unit=FRAME.size,
    strays=(CanFrame(0x7E1, b"12345678").pack(), CanFrame(0x51, b"\x08\0\0\0\0\0\0\0").pack()),
)  # fmt: skip


class Kind(NamedTuple):
    """A board and its codec, the line between them, and the safety input of its fault."""

    make_board: Callable[[Clock], MotorBoard]
    make_peer: Callable[[], Peer]
    line: Hostility
    input: str = "motors"


KINDS = {
    "odrive": Kind(lambda now: OdriveBoard((0, 1), 10.0, now_s=now),
                   lambda: OdrivePeer(FakeOdrive()), SERIAL),
    "odrive_can": Kind(lambda now: OdriveCanBoard((0, 1), 10.0, "active_errors", now),
                       lambda: OdrivePeer(FakeOdriveBus()), BUS),
    "vesc": Kind(lambda now: VescBoard((LOCAL, 12), 7, 10.0, now),
                 lambda: VescPeer(FakeVesc(3, (12,), math.inf), 12), SERIAL),
    "vesc_can": Kind(lambda now: VescCanBoard((11, 12), 7, 10.0, now),
                     lambda: VescPeer(FakeVescBus((11, 12), math.inf), 12), BUS, ""),
    "agribot": Kind(make_ours, OurPeer, SERIAL, "red button"),
}  # fmt: skip


class ImuBoard:
    """The IMU board of `firmware/`, which turns ever faster; frames once it was asked for them."""

    def __init__(self) -> None:
        self._decoder, self._seq, self.t_s, self._is_asked = BoardDecoder("host"), 0, 0.0, False

    def advance(self, dt_s: float) -> bytes:
        self.t_s += dt_s
        if not self._is_asked:
            return b"A0B0C16384D0E0F0G\r\n"
        self._seq += 1
        return encode(self._seq & 0xFF, wire.BoardImu(
            t_us=round(self.t_s * 1e6), accel_mps2=(0.0, 0.0, 9.81), temperature_c=20.0,
            gyro_radps=(0.0, 0.0, GYRO_RADPS2 * self.t_s), mag_t=(0.0, 3e-5, -3e-5), mag_count=0,
            flags=wire.BoardFlag(0),
        ))  # fmt: skip

    def hear(self, data: bytes) -> bytes:
        for frame in self._decoder.feed(data):
            self._is_asked |= isinstance(frame.message, wire.AskVersion)
        return b""
