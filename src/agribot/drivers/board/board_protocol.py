"""What the robot and its boards say to each other: the one table of their messages.

A message is a struct here, a packed struct in `firmware/wire.h` and a row of
docs/board-messages.md; both are written from this file. On the line it is `type u8, seq u8, fields
little-endian, CRC-16 u16`, stuffed by COBS and ended by a zero byte (`board_codec`). Wheels come in
the order of WHEEL_NAMES.
A board counts what its encoders count, four for each line of the disc; how many make a turn of the
wheel knows the robot's program alone.
"""

from __future__ import annotations

import binascii
import functools
import math
import typing
from enum import IntEnum, IntFlag
from typing import Annotated, ClassVar, Literal, NamedTuple

import msgspec

from agribot.core.messages import Four, Vec3

PROTOCOL = 1
BAUD = 250_000  # speed that 16 MHz divide without an error
TELEMETRY_HZ = 100
COMMAND_TIMEOUT_S = 0.3  # longest time without a command before wheels and tool go off
CLEAR_KEY = 0x5AFE
GRAVITY_MPS2 = 9.80665
# Ranges of the MPU-9250 as the boards set it, and the 16 bits of its AK8963.
ACCEL_RANGE_G, GYRO_RANGE_DPS, MAG_LSB_T = 4.0, 500.0, 0.15e-6

Sender = Literal["host", "board"]
Kind = Literal["u8", "i8", "u16", "i16", "u32", "i32"]
FourInts = tuple[int, int, int, int]


class Wire(NamedTuple):
    """Encoding of a field: `length` numbers of a kind, each times `scale` is the field's unit."""

    kind: Kind
    length: int = 1
    scale: float = 1.0
    unit: str = ""


class BoardFlag(IntFlag):
    """State of a board."""

    ESTOP_PRESSED = 1 << 0  # pressed, or its wire is broken
    BUMPER_PRESSED = 1 << 1  # pressed, or its wire is broken
    STOP_LATCHED = 1 << 2  # until ClearLatch
    NO_COMMAND = 1 << 3  # for COMMAND_TIMEOUT_S
    NOT_CONFIGURED = 1 << 4  # no BoardConfig since the board began
    WAITS_FOR_ZERO = 1 << 5  # the wheels turn again after a command of no speed
    BATTERY_LOW = 1 << 6
    MOTOR_FAULT = 1 << 7
    ENCODER_FAULT = 1 << 8  # steps that no encoder makes, since the last state
    IMU_FAULT = 1 << 9
    MAG_FAULT = 1 << 10
    WATCHDOG_RESET = 1 << 11  # the board hung and began anew


class StopCause(IntFlag):
    """Causes of the latched stop, all since it was cleared."""

    BEGAN = 1 << 0  # the board was switched on or reset
    ESTOP = 1 << 1
    BUMPER = 1 << 2
    BATTERY = 1 << 3
    MOTOR = 1 << 4
    REVERSED = 1 << 5  # a wheel turns against its motor; the high bits of motor_faults name it


class AckResult(IntEnum):
    """Result of a message that is answered."""

    DONE = 0
    BAD_LENGTH = 1
    BAD_VALUE = 2
    UNKNOWN_TYPE = 3
    STILL_PRESSED = 4  # the stop cannot be cleared: emergency stop
    STILL_LOW = 5  # the stop cannot be cleared: battery


class BoardKind(IntEnum):
    """Kind of a board."""

    MOTOR = 1
    IMU = 2


class BoardMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One row of the table."""

    number: ClassVar[int]
    sender: ClassVar[Sender]


class WheelCommand(BoardMessage, frozen=True, kw_only=True):
    """Turn the wheels so fast, and switch these outputs of the tool; echoed in BoardState."""

    number: ClassVar[int] = 0x10
    sender: ClassVar[Sender] = "host"
    speed_countps: Annotated[FourInts, Wire("i16", 4, unit="count/s")]
    tool: Annotated[int, Wire("u8", unit="bits")] = 0


class ClearLatch(BoardMessage, frozen=True, kw_only=True):
    """End a latched stop, as a person wants it; answered."""

    number: ClassVar[int] = 0x11
    sender: ClassVar[Sender] = "host"
    key: Annotated[int, Wire("u16")] = CLEAR_KEY


class AskVersion(BoardMessage, frozen=True, kw_only=True):
    """Ask for BoardVersion; an IMU board speaks frames from then on instead of lines."""

    number: ClassVar[int] = 0x12
    sender: ClassVar[Sender] = "host"


class BoardConfig(BoardMessage, frozen=True, kw_only=True):
    """Settings of this robot's motor board; answered. Without them the wheels do not turn.

    `full_speed_countps` is what the motors reach without load; `kp_ratio` is duty per speed error,
    both as shares of full: above 2 a wheel in the air shakes. `ti_s` is the integral's time.
    Bit k of the flips turns motor or encoder of wheel k round.
    """

    number: ClassVar[int] = 0x13
    sender: ClassVar[Sender] = "host"
    full_speed_countps: Annotated[int, Wire("u16", unit="count/s")]  # at full duty, no load
    max_speed_countps: Annotated[int, Wire("u16", unit="count/s")]
    max_accel_countps2: Annotated[int, Wire("u16", scale=10.0, unit="count/s²")]
    kp_ratio: Annotated[float, Wire("u16", scale=1 / 256, unit="1")] = 1.5
    ti_s: Annotated[float, Wire("u16", scale=0.001, unit="s")] = 0.25
    current_limit_a: Annotated[float, Wire("u16", scale=0.001, unit="A")] = 10.0
    battery_cutoff_v: Annotated[float, Wire("u16", scale=0.001, unit="V")] = 18.0
    motor_flips: Annotated[int, Wire("u8", unit="bits")] = 0
    encoder_flips: Annotated[int, Wire("u8", unit="bits")] = 0


class BoardState(BoardMessage, frozen=True, kw_only=True):
    """Wheels and inputs of the motor board, a hundred times a second.

    `command_seq` is that of the last WheelCommand that was taken; low bits of `motor_faults` are
    currents over the limit, the four high ones wheels that do not follow their motor.
    """

    number: ClassVar[int] = 0x81
    sender: ClassVar[Sender] = "board"
    t_us: Annotated[int, Wire("u32", unit="µs")]
    counts: Annotated[FourInts, Wire("i32", 4, unit="count")]
    speed_countps: Annotated[FourInts, Wire("i16", 4, unit="count/s")]
    duty_ratio: Annotated[Four, Wire("i8", 4, 0.01, "1")]
    current_a: Annotated[Four, Wire("u16", 4, 0.001, "A")]
    battery_v: Annotated[float, Wire("u16", scale=0.001, unit="V")]
    flags: Annotated[BoardFlag, Wire("u16", unit="BoardFlag")]
    stop_causes: Annotated[StopCause, Wire("u8", unit="StopCause")]
    motor_faults: Annotated[int, Wire("u8", unit="bits")]
    tool: Annotated[int, Wire("u8", unit="bits")]
    command_seq: Annotated[int, Wire("u8")]
    bad_frames: Annotated[int, Wire("u8", unit="modulo 256")]
    encoder_errors: Annotated[int, Wire("u8", unit="modulo 256")]


class BoardVersion(BoardMessage, frozen=True, kw_only=True):
    """Version of the board; `layout` is that of its table, and must be LAYOUT."""

    number: ClassVar[int] = 0x82
    sender: ClassVar[Sender] = "board"
    protocol: Annotated[int, Wire("u8")]
    board: Annotated[BoardKind, Wire("u8", unit="BoardKind")]
    layout: Annotated[int, Wire("u16")]
    firmware: Annotated[tuple[int, int, int], Wire("u8", 3)]
    reset_cause: Annotated[int, Wire("u8", unit="MCUSR")]


class BoardImu(BoardMessage, frozen=True, kw_only=True):
    """Inertial and magnetic readings in the axes of the MPU's chip, a hundred times a second.

    `mag_count` goes on with every new reading of the magnetometer.
    """

    number: ClassVar[int] = 0x83
    sender: ClassVar[Sender] = "board"
    t_us: Annotated[int, Wire("u32", unit="µs")]
    accel_mps2: Annotated[Vec3, Wire("i16", 3, ACCEL_RANGE_G * GRAVITY_MPS2 / 32768, "m/s²")]
    temperature_c: Annotated[float, Wire("i16", scale=0.01, unit="°C")]
    gyro_radps: Annotated[Vec3, Wire("i16", 3, math.radians(GYRO_RANGE_DPS) / 32768, "rad/s")]
    mag_t: Annotated[Vec3, Wire("i16", 3, MAG_LSB_T, "T")]
    mag_count: Annotated[int, Wire("u8", unit="modulo 256")]
    flags: Annotated[BoardFlag, Wire("u16", unit="BoardFlag")]


class BoardAck(BoardMessage, frozen=True, kw_only=True):
    """Result of the message of this type and sequence number."""

    number: ClassVar[int] = 0x84
    sender: ClassVar[Sender] = "board"
    of_type: Annotated[int, Wire("u8")]
    of_seq: Annotated[int, Wire("u8")]
    result: Annotated[AckResult, Wire("u8", unit="AckResult")]


MESSAGES: tuple[type[BoardMessage], ...] = (
    WheelCommand, ClearLatch, AskVersion, BoardConfig,
    BoardState, BoardVersion, BoardImu, BoardAck,
)  # fmt: skip


class WireField(NamedTuple):
    """A field of a message, with the type that it has in Python."""

    name: str
    wire: Wire
    python_type: type


@functools.cache
def list_fields(message: type[BoardMessage]) -> tuple[WireField, ...]:
    """List the fields of a message in the order in which they cross."""
    hints = typing.get_type_hints(message, include_extras=True)
    found = []
    for field in msgspec.structs.fields(message):
        python_type, wire = typing.get_args(hints[field.name])
        found.append(WireField(field.name, wire, typing.get_origin(python_type) or python_type))
    return tuple(found)


def compute_layout() -> int:
    """Compute the CRC-16/XMODEM of all that host and board must agree on."""
    lines = [f"{PROTOCOL}"]
    for message in MESSAGES:
        fields = " ".join(
            f"{f.name}:{f.wire.kind}*{f.wire.length}*{f.wire.scale:.9g}"
            for f in list_fields(message)
        )
        lines.append(f"{message.number:#x} {message.__name__} {fields}")
    lines += [f"{one.__name__}={int(value)}" for one in NAMED_NUMBERS for value in one]
    return binascii.crc_hqx("\n".join(lines).encode(), 0)


NAMED_NUMBERS: tuple[type[IntFlag] | type[IntEnum], ...] = (
    BoardFlag, StopCause, AckResult, BoardKind,
)  # fmt: skip
LAYOUT = compute_layout()
