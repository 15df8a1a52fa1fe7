"""What passes between the robot's program and its motor board, whatever carries the bytes.

`HardwarePlatform` gives it the bytes of a real line and the moments of the clock on the wall; a
simulation gives it those of a simulated one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec

from agribot.core.errors import PlatformError
from agribot.core.messages import (
    STOP,
    BoardSample,
    ImplementCommand,
    OperatorEvent,
    RobotCommand,
)
from agribot.core.robot import DriveSpec
from agribot.core.stamp_clock import SampleQueue
from agribot.drivers.line_watch import LineWatch
from agribot.drivers.motor_board import BoardReport, CountsBroken, MotorBoard

# A person cleared the stop: the board is told so until it has let go, but no longer.
CLEARING_S = 2.0


class BoardLink:
    """Reports of the board by tick, and its bytes for each command; `board` is its codec."""

    def __init__(self, board: MotorBoard, drive: DriveSpec, now_s: Callable[[], float]) -> None:
        self.board, self._drive = board, drive
        # The IMU's readings may have the times of the others: each kind has a queue of its own. But
        # the board has one clock, and readings that come later than the others are late.
        self._queue: SampleQueue[BoardReport] = SampleQueue(
            now_s, latency_s=board.latency_s, is_of_its_own=True
        )
        self._imu_queue: SampleQueue[BoardReport] = SampleQueue(
            now_s, latency_s=board.latency_s, clock=self._queue.clock
        )
        self._watch = LineWatch("motor board")
        self.has_spoken = False
        self._clearing_until_s = -math.inf

    @property
    def uncertainty_s(self) -> float:
        """How far the times of reports may be off."""
        return self._queue.uncertainty_s

    def feed(self, data: bytes, arrived_s: float) -> None:
        """Take bytes in, in any thread."""
        for stamped in self.board.feed(data):
            is_imu = stamped.report.imu is not None
            self.has_spoken |= not is_imu
            queue = self._imu_queue if is_imu else self._queue
            queue.put(stamped.stamp_s, arrived_s, stamped.report)

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

    def watch_line(self, t_s: float) -> tuple[OperatorEvent, ...]:
        """Note that the line breaks many messages, or that it does not any more."""
        board = self.board
        return self._watch.update(t_s, board.broken if isinstance(board, CountsBroken) else 0)

    def clear(
        self, t_s: float, events: tuple[OperatorEvent, ...], told: tuple[BoardSample, ...]
    ) -> bytes:
        """Make what tells the board that a person cleared the stop, until it has let go."""
        actions = [event.action for event in events]
        if "clear_stop" in actions:
            self._clearing_until_s = t_s + CLEARING_S
        last = told[-1] if told else None
        has_let_go = last is not None and not last.stopped  # the next stop is a new one
        if "stop" in actions or has_let_go or (last is not None and last.is_button_pressed):
            self._clearing_until_s = -math.inf
        is_held = t_s < self._clearing_until_s and last is not None and bool(last.stopped)
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
                "is not finite; the motor board is not told"
            )
        speeds = (right, left, right, left)
        return self.board.poll() + self.board.drive(speeds, command.implement)

    def stop(self) -> bytes:
        """Make the bytes that let wheels and tool rest."""
        left, right = self._drive.wheel_speeds_radps(STOP.v_mps, STOP.yaw_rate_radps)
        return self.board.drive((right, left, right, left), ImplementCommand())


def _stamp(report: BoardReport) -> BoardReport:
    """Give the parts the time of their report."""
    parts = {
        name: msgspec.structs.replace(part, t_s=report.t_s)
        for name, part in msgspec.structs.asdict(report).items()
        if isinstance(part, msgspec.Struct)
    }
    return msgspec.structs.replace(report, **parts)
