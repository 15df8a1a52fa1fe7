"""What passes between the robot's program and its motor board, whatever carries the bytes.

`HardwarePlatform` gives it the bytes of a real line and the moments of the clock on the wall; a
simulation gives it those of a simulated one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec

from agribot.core.errors import PlatformError
from agribot.core.messages import (
    STOP,
    BoardSample,
    DeviceNote,
    ImplementCommand,
    RequestEvent,
    RobotCommand,
)
from agribot.core.robot import DriveSpec
from agribot.core.stamp_clock import SampleQueue
from agribot.drivers.board.motor_board import (
    BoardReport,
    CountsBroken,
    MotorBoard,
    SpeaksFirst,
    StampedReport,
)
from agribot.drivers.line.line_watch import LineWatch

# longest time for which the board gets the command to clear its stop, until it lets go
CLEARING_S = 2.0
# A board that speaks first has missed ten of its words: it hung or begins anew, and its bootloader
# must hear nothing. A watchdog resets it 0.12 s after its last one.
HUSH_S = 0.1
# Time after opening a line in which bytes from before may still come.
SURE_S = 0.05


class BoardLink:
    """Reports of the board by tick, and its bytes for each command; `board` is its codec."""

    def __init__(self, board: MotorBoard, drive: DriveSpec, now_s: Callable[[], float]) -> None:
        self.board, self._drive, self._now_s = board, drive, now_s
        # The IMU's readings may have the times of the others: each kind has a queue of its own. But
        # the board has one clock, and readings that come later than the others are late.
        self._queue: SampleQueue[BoardReport] = SampleQueue(
            now_s, latency_s=board.latency_s, is_of_its_own=True
        )
        self._imu_queue: SampleQueue[BoardReport] = SampleQueue(
            now_s, latency_s=board.latency_s, clock=self._queue.clock
        )
        self._watch = LineWatch("board", "motor board")
        self.has_spoken, self._bytes_heard = False, 0
        self._first_s, self._heard_s = math.inf, -math.inf
        self._clearing_until_s = -math.inf

    @property
    def uncertainty_s(self) -> float:
        """Error of the times of reports."""
        return self._queue.uncertainty_s

    @property
    def may_send(self) -> bool:
        """Whether the board listens: one that speaks first does while it speaks, others always."""
        is_sure = self._heard_s - self._first_s >= SURE_S
        is_heard = is_sure and self._now_s() - self._heard_s < HUSH_S
        return is_heard or not isinstance(self.board, SpeaksFirst)

    def open(self) -> bytes:
        """Begin with a board whose line was just opened; makes what is sent to it at once."""
        self.has_spoken, self._bytes_heard = False, 0
        self._first_s, self._heard_s = math.inf, -math.inf
        return self.board.open()

    def feed(self, data: bytes, arrived_s: float) -> None:
        """Take bytes in, in any thread."""
        heard = self._count_heard()
        self._bytes_heard += len(data)
        reports = self.board.feed(data)
        if self._count_heard() != heard:
            self._first_s, self._heard_s = min(self._first_s, arrived_s), arrived_s
        for stamped in _join_untimed(reports):
            is_imu = stamped.report.imu is not None
            self.has_spoken |= not is_imu
            queue = self._imu_queue if is_imu else self._queue
            queue.put(stamped.stamp_s, arrived_s, stamped.report)

    def _count_heard(self) -> int:
        return self.board.frames_heard if isinstance(self.board, SpeaksFirst) else 0

    def describe_silence(self) -> str:
        """Describe what came since the line was opened instead of a report, and what to check."""
        if not self._bytes_heard:
            return "says nothing; check its power, its wires, and board= and baud= of --source base"
        if heard := self._count_heard():
            return (
                f"says {heard} messages, but does not answer; check the wire from this computer's "
                "TX to its RX, and that nothing else writes to it"
            )
        return (
            f"says {self._bytes_heard} bytes, but no report that can be read; check board= and "
            "baud= of --source base"
        )

    def take(self, t_s: float) -> dict[str, tuple[Any, ...]]:
        """Take what was measured until `t_s`, by field of the batch."""
        reports = [_stamp(report) for report in self._queue.take(t_s)]
        readings = [_stamp(report) for report in self._imu_queue.take(t_s)]
        return {
            "wheels": tuple(r.wheels for r in reports if r.wheels),
            "imu": tuple(r.imu for r in readings if r.imu),
            "mag": tuple(r.mag for r in readings if r.mag),
            "battery": tuple(r.battery for r in reports if r.battery),
            "bumper": tuple(r.bumper for r in reports if r.bumper),
            "board": tuple(r.board for r in reports if r.board),
        }

    def watch_line(self, t_s: float) -> tuple[DeviceNote, ...]:
        """Note that the line breaks many messages, or that it does not any more."""
        board = self.board
        return self._watch.update(t_s, board.broken if isinstance(board, CountsBroken) else 0)

    def clear(
        self, t_s: float, events: tuple[RequestEvent, ...], reports: tuple[BoardSample, ...]
    ) -> bytes:
        """Make the command that clears the board's stop, sent until the board has let go."""
        words = [event.request.word for event in events]
        if "clear_stop" in words:
            self._clearing_until_s = t_s + CLEARING_S
        last = reports[-1] if reports else None
        has_let_go = last is not None and last.stop is None  # the next stop is a new one
        if "stop" in words or has_let_go or (last is not None and last.is_button_pressed):
            self._clearing_until_s = -math.inf
        is_held = t_s < self._clearing_until_s and last is not None and last.stop is not None
        return self.board.clear_stop() if is_held else b""

    def command(self, command: RobotCommand) -> bytes:
        """Make the bytes of a command, and what else the board is to be asked now.

        Raises: PlatformError: a number is not finite.
        """
        drive = command.drive
        left, right = self._drive.wheel_speeds_radps(drive.v_mps, drive.yaw_rate_radps)
        if not math.isfinite(left + right):
            raise PlatformError(
                f"drive command v = {drive.v_mps} m/s, yaw rate = {drive.yaw_rate_radps} rad/s "
                "is not finite; nothing is sent to the motor board"
            )
        speeds = (right, left, right, left)
        return self.board.poll() + self.board.drive(speeds, command.implement)

    def stop(self) -> bytes:
        """Make the bytes that let wheels and tool rest."""
        left, right = self._drive.wheel_speeds_radps(STOP.v_mps, STOP.yaw_rate_radps)
        return self.board.drive((right, left, right, left), ImplementCommand())


def _join_untimed(reports: Sequence[StampedReport]) -> Iterator[StampedReport]:
    """Join what came at once without times, as after a pause of the line: the last is of now."""
    untimed: dict[bool, dict[str, Any]] = {}  # parts of the IMU's reports and of others
    for stamped in reports:
        if stamped.stamp_s:
            yield stamped
        else:
            parts = msgspec.structs.asdict(stamped.report)
            known = {name: part for name, part in parts.items() if part is not None}
            untimed.setdefault(stamped.report.imu is not None, {}).update(known)
    yield from (StampedReport(0.0, BoardReport(**parts)) for parts in untimed.values())


def _stamp(report: BoardReport) -> BoardReport:
    """Give the parts the time of their report."""
    parts = {
        name: msgspec.structs.replace(part, t_s=report.t_s)
        for name, part in msgspec.structs.asdict(report).items()
        if isinstance(part, msgspec.Struct)
    }
    return msgspec.structs.replace(report, **parts)
