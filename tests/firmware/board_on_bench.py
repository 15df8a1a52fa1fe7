"""The motor board with four motors on it, as a host drives it."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from agribot.core.messages import FloatArray
from agribot.drivers.board.board_codec import BoardDecoder, BoardEncoder
from agribot.drivers.board.board_protocol import (
    AckResult,
    BoardAck,
    BoardConfig,
    BoardFlag,
    BoardMessage,
    BoardState,
    ClearLatch,
    WheelCommand,
)
from firmware.bench.avr_bench import AvrBench

COUNTS_PER_TURN = 2048
COUNTS_PER_RAD = COUNTS_PER_TURN / (2.0 * np.pi)
FULL_RADPS = 30.0  # of a wheel at full duty
MAX_RADPS, MAX_ACCEL_RADPS2 = 15.0, 15.0
STEP_S, COMMAND_PERIOD_S = 0.005, 0.05
REST = (0.0, 0.0, 0.0, 0.0)

Wanted = TypeVar("Wanted", bound=BoardMessage)
Speeds = tuple[float, float, float, float]


class BoardOnBench:
    """Motors of the first order: their speed goes to `gain` * duty * FULL_RADPS with `lag_s`."""

    def __init__(self, bench: AvrBench, lag_s: float = 0.1, gain: float = 1.0) -> None:
        self.bench, self._lag_s, self._gain = bench, lag_s, gain
        self.encoder, self.decoder = BoardEncoder(), BoardDecoder()
        self.speed_radps = np.zeros(4)
        self.is_blocked = np.zeros(4, dtype=bool)
        self.encoder_sign = np.ones(4)  # -1 where A and B are swapped
        self.motor_sign = np.ones(4)  # -1 where its leads are
        self.push_radps2 = 0.0  # of a slope, or of somebody who pushes
        self.history: list[FloatArray] = []  # speeds of the wheels, rad/s
        self.received: list[BoardMessage] = []

    @property
    def state(self) -> BoardState:
        return self.get_all(BoardState)[-1]

    @property
    def is_moving(self) -> bool:
        return any(self.bench.duty_ratio)

    def get_all(self, kind: type[Wanted]) -> list[Wanted]:
        return [message for message in self.received if isinstance(message, kind)]

    def send(self, message: BoardMessage) -> int:
        seq, data = self.encoder.encode(message)
        self.bench.send(data)
        return seq

    def run(self, duration_s: float, speed_radps: Speeds | None = None, tool: int = 0) -> None:
        """Let time pass; with a speed, as a host that commands it again and again."""
        every = round(COMMAND_PERIOD_S / STEP_S)
        for k in range(round(duration_s / STEP_S)):
            if speed_radps is not None and k % every == 0:
                self.send(command(speed_radps, tool))
            shown_radps = (self.encoder_sign * self.speed_radps).tolist()
            duty = self.motor_sign * np.array(self.bench.advance(STEP_S, shown_radps))
            goal = self._gain * FULL_RADPS * duty
            self.speed_radps += (goal - self.speed_radps) * STEP_S / self._lag_s
            self.speed_radps += self.push_radps2 * STEP_S
            self.speed_radps[self.is_blocked] = 0.0
            self.history.append(self.speed_radps.copy())
        self.received += [frame.message for frame in self.decoder.feed(self.bench.receive())]

    def ask(self, message: BoardMessage) -> AckResult:
        """Send a message and wait for its answer."""
        seq = self.send(message)
        self.run(0.02)
        (answer,) = (a for a in self.get_all(BoardAck)[-1:] if a.of_seq == seq)
        return answer.result

    def arm(self, config: BoardConfig | None = None) -> None:
        """Configure the board, clear its latch and command no speed, as a host begins."""
        self.run(0.03)
        assert self.ask(config or configure()) is AckResult.DONE
        assert self.ask(ClearLatch()) is AckResult.DONE
        self.run(0.05, REST)
        stopping = BoardFlag.STOP_LATCHED | BoardFlag.NOT_CONFIGURED | BoardFlag.WAITS_FOR_ZERO
        assert not self.state.flags & stopping


def configure(**changes: float) -> BoardConfig:
    values = {
        "full_speed_countps": round(FULL_RADPS * COUNTS_PER_RAD),
        "max_speed_countps": round(MAX_RADPS * COUNTS_PER_RAD),
        "max_accel_countps2": round(MAX_ACCEL_RADPS2 * COUNTS_PER_RAD),
    }
    return BoardConfig(**{**values, **changes})  # type: ignore[arg-type]


def command(speed_radps: Speeds, tool: int = 0) -> WheelCommand:
    a, b, c, d = (round(speed * COUNTS_PER_RAD) for speed in speed_radps)
    return WheelCommand(speed_countps=(a, b, c, d), tool=tool)
