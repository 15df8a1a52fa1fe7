"""A robot on a plane whose motor board is real firmware on a serial line, in real time."""

from __future__ import annotations

import ctypes
import datetime as dt
from collections.abc import Callable, Sequence
from pathlib import Path

from agribot.drivers.board.board_protocol import GRAVITY_MPS2
from firmware.bench.avr_bench import AvrBench
from firmware.bench.board_on_line import STEP_S, BoardOnLine
from firmware.build import PREBUILT
from tests.drivers.moving_robot import COUNTS_PER_TURN, MovingRobot

FIX_PERIOD_S = 0.2


class RobotOnLine(BoardOnLine):
    """Its wheels move it, its IMU measures that, and its receiver sends it as UBX to `say`.

    All of it goes by the clock of the board.
    """

    def __init__(
        self, library: ctypes.CDLL, robot: MovingRobot, say: Callable[[bytes], None],
        bootloader: Path, pace: float,
    ) -> None:  # fmt: skip
        bench = AvrBench(library, PREBUILT / "motor_board.hex", COUNTS_PER_TURN, bootloader)
        super().__init__(bench, pace)
        self.robot, self._say = robot, say
        self._begun = dt.datetime.now(dt.UTC).replace(microsecond=0)
        self._fixes = 0

    def _move(self, duty_ratio: Sequence[float]) -> None:
        super()._move(duty_ratio)
        rear_right, rear_left, front_right, front_left = self.speed_radps
        self.robot.roll((rear_right + front_right) / 2.0, (rear_left + front_left) / 2.0, STEP_S)
        self.bench.set_imu((0.0, 0.0, GRAVITY_MPS2), self.robot.gyro_radps)
        self.bench.set_mag(self.robot.mag_t)
        if self.bench.t_s >= self._fixes * FIX_PERIOD_S:
            self._say(
                self.robot.fix(self._begun + self._fixes * dt.timedelta(seconds=FIX_PERIOD_S))
            )
            self._fixes += 1
