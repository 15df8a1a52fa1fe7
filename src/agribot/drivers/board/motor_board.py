"""A motor board without its line: bytes in become what it reports, wheel speeds become bytes out.

A board of your own is one class in one file and a line in `board_kinds`. It is given bytes, cut
anywhere, and never opens a port: `HardwarePlatform` does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar, runtime_checkable

import msgspec

from agribot.core.messages import (
    BatterySample,
    BoardSample,
    BumperSample,
    Four,
    ImplementCommand,
    ImuSample,
    MagSample,
    SafetyInput,
    WheelSample,
)

STATE_S = 0.5  # age from which the state of the motors is unknown
GEAR_HOW = "write gear=N, turns of the motor for one of its wheel, 1 for a motor in the hub"


Value = TypeVar("Value")


class FreshValues(Generic[Value]):
    """The last values of each of several controllers, while they are not older than `STATE_S`."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._newest: dict[int, tuple[float, Value]] = {}

    def put(self, controller: int, value: Value) -> None:
        self._newest[controller] = self._now_s(), value

    def take(self) -> dict[int, Value]:
        """Give what is known now."""
        now_s = self._now_s()
        return {one: value for one, (t_s, value) in self._newest.items() if now_s - t_s <= STATE_S}

    def clear(self) -> None:
        self._newest.clear()

    def __len__(self) -> int:
        """Count those that reported since it was cleared, however long ago."""
        return len(self._newest)


class BoardReport(msgspec.Struct, frozen=True, kw_only=True):
    """Measurements of a board at one moment; None where it does not measure.

    The times of the parts are those of the report, which the platform puts in. Inertial and
    magnetic readings come in reports of their own.
    """

    t_s: float = 0.0
    wheels: WheelSample | None = None
    imu: ImuSample | None = None
    mag: MagSample | None = None
    battery: BatterySample | None = None
    bumper: BumperSample | None = None
    board: BoardSample | None = None


class StampedReport(msgspec.Struct, frozen=True):
    """`stamp_s` is of the board's clock, which may begin anew with it; 0 where it has none."""

    stamp_s: float
    report: BoardReport


class MotorBoard(Protocol):
    """One kind of board. `inputs` are the safety inputs that it can read.

    `latency_s` passes at least between the measurement and the last byte of its report. `trouble`
    says why this board cannot be driven, such as a firmware of another age; empty where it can.
    """

    inputs: frozenset[SafetyInput]
    latency_s: float
    trouble: str

    def open(self) -> bytes:
        """Begin with a board that was just connected; returns what is to be sent to it at once."""
        ...

    def poll(self) -> bytes:
        """Make the questions and commands that are now due; called once a tick."""
        ...

    def feed(self, data: bytes) -> list[StampedReport]:
        """Take bytes in; broken ones are left out."""
        ...

    def drive(self, speeds_radps: Four, implement: ImplementCommand) -> bytes:
        """Make the command for the wheels, in the order of WHEEL_NAMES; called once a tick."""
        ...

    def clear_stop(self) -> bytes:
        """Make the command that clears the board's stop, once a person cleared it."""
        ...


@runtime_checkable
class SpeaksFirst(Protocol):
    """A board that reports its state unasked, and is sent nothing before.

    Opening its line resets an Arduino, whose bootloader takes a byte within its first second for
    the first of a new program, and then waits for the rest of it instead of starting the old one.
    """

    @property
    def frames_heard(self) -> int:
        """Count of whole frames since its line was opened."""
        ...


@runtime_checkable
class CountsBroken(Protocol):
    """A board that notices what breaks on its line."""

    @property
    def broken(self) -> int:
        """Count its broken messages, and those to it where it reports them."""
        ...
