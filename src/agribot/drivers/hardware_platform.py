"""A real robot: its motor board on a line, ticks by the monotonic clock.

Other sensors come from sources (`--source gnss=...`), which `MixedPlatform` puts into the same
batches. The batch of a tick holds what had arrived by then, and a recording holds the batches: the
stack that runs on it again gives the same commands.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable

from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError, PlatformError
from agribot.core.facts import AnyFact, DeviceSaid
from agribot.core.messages import (
    DeviceNote,
    Inbox,
    RobotCommand,
    SafetyInput,
    SensorBatch,
)
from agribot.core.robot import RobotSpec
from agribot.drivers.board.board_kinds import open_board
from agribot.drivers.board.board_link import BoardLink
from agribot.drivers.board.motor_board import MotorBoard
from agribot.drivers.line.byte_streams import ByteStream, OpenStream, StreamReader
from agribot.drivers.line.clock_watch import ClockWatch
from agribot.drivers.line.stream_writer import StreamWriter

MOTOR_SETTINGS = ("counts_per_turn", "full_speed_radps", "winding_ohm")  # settings of `calibration`
FIRST_REPORT_S = 5.0  # a board that the line's opening resets starts for two of them
POLL_S = 0.02
MOST_SAID = 32  # notes of threads between two ticks


class HardwarePlatform:
    """`read` waits for the next tick of `tick_hz`; ticks that were missed are left out.

    Every command goes to the board at once and none is sent again: a board that hears none for its
    timeout stops by itself. One that speaks first is sent nothing until it does.
    """

    def __init__(
        self,
        robot: RobotSpec,
        tick_hz: float,
        board: MotorBoard,
        open_stream: OpenStream,
        name: str,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the line and wait until the board has spoken.

        Raises: ConfigError: no such line. PlatformError: a board that is silent or unfit.
        """
        self.inbox = Inbox()
        self._said: deque[AnyFact] = deque(maxlen=MOST_SAID)  # notes of threads
        self._period_s = 1.0 / tick_hz
        self._name, self._now_s = f"motor board on {name}", now_s
        self._link = BoardLink(board, robot.drive, now_s)
        self._clock = ClockWatch(self._name, lambda: self._link.uncertainty_s)
        self._began_s, self._tick = math.nan, 0
        self._reader = StreamReader(
            self._name, open_stream, self._link.feed, now_s, self._note, self._greet
        )
        self._writer = StreamWriter(self._name, self._write, now_s)
        try:
            self._await_board()
        except BaseException:
            self.close()
            raise

    def read(self) -> SensorBatch:
        """Wait for the next tick and return what arrived until then."""
        t_s = self._wait_for_tick()
        samples = self._link.take(t_s)
        clock = self._clock.update(t_s)
        requests, hand = self.inbox.drain(t_s)
        self._writer.send(self._link.clear(t_s, requests, samples["board"]))
        said = [DeviceNote(t_s=t_s, fact=self._said.popleft()) for _ in range(len(self._said))]
        notes = (*clock, *self._link.watch_line(t_s), *said)
        return SensorBatch(t_s=t_s, requests=requests, notes=notes, hand=hand, **samples)

    def write(self, command: RobotCommand) -> None:
        """Send a command to the board; the line may take its time.

        Raises: PlatformError: a number is not finite.
        """
        self._writer.send(self._link.command(command))

    def close(self) -> None:
        """Stop the wheels and the tool, and let go of the line. Safe to call twice."""
        self._writer.send(self._link.stop())
        self._writer.close()
        self._reader.close()

    def _await_board(self) -> None:
        """Wait for the first report: a fixed count of polls, however slow the machine is."""
        for _ in range(round(FIRST_REPORT_S / POLL_S)):
            if self._link.has_spoken:
                return
            if self._link.board.trouble:
                raise PlatformError(f"{self._name}: {self._link.board.trouble}")
            self._writer.send(self._link.board.poll())
            time.sleep(POLL_S)
        if not self._link.has_spoken:
            silence = f"for {FIRST_REPORT_S:g} s it {self._link.describe_silence()}"
            raise PlatformError(f"{self._name}: {silence}")

    def _wait_for_tick(self) -> float:
        now_s = self._now_s()
        if math.isnan(self._began_s):
            self._began_s = now_s
        late = (now_s - self._began_s) / self._period_s
        self._tick = max(self._tick + 1, math.floor(late))
        t_s = self._tick * self._period_s
        wait_s = self._began_s + t_s - now_s
        if wait_s > 0.0:
            time.sleep(wait_s)
        return t_s

    def _greet(self, stream: ByteStream) -> None:
        stream.write(self._link.open())

    def _write(self, data: bytes) -> bool:
        return self._link.may_send and self._reader.write(data)

    def _note(self, text: str) -> None:
        self._said.append(DeviceSaid(text))


def check_inputs(board: MotorBoard, name: str, must_report: tuple[SafetyInput, ...]) -> None:
    """Refuse a board that cannot read what the robot must have.

    Raises: ConfigError: it lacks an input.
    """
    lacking = [one for one in must_report if one not in board.inputs]
    if lacking:
        left = ", ".join(f'"{one}"' for one in must_report if one in board.inputs)
        raise ConfigError(
            f"{name} cannot read the {' and the '.join(lacking)}, which this robot must have; use "
            "a board that can, or wire it so that it cuts the power without any board, and say "
            f"so: --set 'safety.must_report=[{left}]'"
        )


def open_platform(config: RunConfig, robot: RobotSpec) -> HardwarePlatform:
    """Open the motor board of `sources.base`.

    Raises: AgribotError: none is named, it cannot be opened, or it does not fit this robot.
    """
    motors = {name: getattr(config.calibration, name) for name in MOTOR_SETTINGS}
    stated = {name: value for name, value in motors.items() if value is not None}
    board, open_stream, name = open_board(config.sources.base, robot, stated, config.plugins)
    must_report = config.safety.must_report
    check_inputs(board, name, must_report or ())
    return HardwarePlatform(robot, config.tick_hz, board, open_stream, name)
