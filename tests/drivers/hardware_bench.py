"""A robot on a table: boards and receiver at the far ends of pseudo-terminals, in real time."""

from __future__ import annotations

import contextlib
import datetime as dt
import threading
import time
from pathlib import Path

from agribot.core.config import FieldConfig
from tests.drivers.board_emulator import TICK_S, BoardEmulator, turn_of
from tests.drivers.lines import Line
from tests.drivers.moving_robot import COUNTS_PER_TURN, MovingRobot
from tests.drivers.receiver_bytes import EPOCH
from tests.waiting import wait_for

FIX_EVERY = 10  # ticks of the board
FULL_RADPS = 40.0  # of a wheel at full voltage
PATIENT_S = 60.0  # of the board with a busy machine


class Plug(Line):
    """A line that is plugged and unplugged by one thread while another one speaks."""

    def __init__(self, folder: Path, name: str) -> None:
        self._lock = threading.Lock()
        super().__init__(folder, name)

    def plug_in(self) -> None:
        with self._lock:
            super().plug_in()

    def unplug(self) -> None:
        with self._lock:
            super().unplug()

    def exchange(self, data: bytes) -> bytes:
        """Send `data`, and read what waits; nothing if the other end is not open."""
        with self._lock:
            if self._far < 0:
                return b""
            with contextlib.suppress(OSError):  # the other end is closed
                self.blurt(data)
            return self.hear()


class HardwareBench:
    """Lives in a thread: wheels turn as commanded, and the robot moves as they turn.

    `pose` is where it is in the map (x, y, yaw), `pace` that of its time over real time.
    """

    def __init__(
        self, folder: Path, pose: tuple[float, float, float], field: FieldConfig, pace: float = 1.0
    ) -> None:
        self._tick_s, self._tick = TICK_S / pace, 0
        self.board = BoardEmulator(timeout_s=PATIENT_S)
        self.base, self.gnss = Plug(folder, "ttyBASE"), Plug(folder, "ttyGNSS")
        self._robot = MovingRobot(pose, field)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> HardwareBench:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.base.unplug()
        self.gnss.unplug()

    @property
    def pose(self) -> tuple[float, float, float]:
        return self._robot.pose

    @property
    def base_uri(self) -> str:
        """Of the motor board, with what its motors are."""
        motors = f"counts_per_turn={COUNTS_PER_TURN:g}&full_speed_radps={FULL_RADPS:g}"
        return f"serial:{self.base.path}?baud=115200&{motors}"

    @property
    def sources(self) -> list[str]:
        return ["--source", f"base={self.base_uri}",
                "--source", f"gnss=serial:{self.gnss.path}"]  # fmt: skip

    def forget_commands(self) -> None:
        """Drop all commands of the robot until now, those still in the line too."""
        heard = self._tick + 1
        wait_for(lambda: self._tick > heard, "the line to be heard")
        self.board.commands.clear()

    def _run(self) -> None:
        next_s = time.monotonic()
        while not self._ended.wait(max(next_s - time.monotonic(), 0.0)):
            next_s, self._tick = next_s + self._tick_s, self._tick + 1
            self.board.feed(self.base.exchange(self.board.advance()))
            right, left, *_ = turn_of(self.board, COUNTS_PER_TURN)
            self._robot.roll(right, left, TICK_S)
            self.board.gyro_radps, self.board.mag_t = self._robot.gyro_radps, self._robot.mag_t
            if self._tick % FIX_EVERY == 0:
                at = EPOCH + self._tick * dt.timedelta(seconds=TICK_S)
                self.gnss.exchange(self._robot.fix(at))
