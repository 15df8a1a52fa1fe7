"""The motor board of `firmware/` as its table of messages describes it, in Python and without time.

It is no firmware: it lets a test speak with what behaves like one, in any line and at any pace.
"""

from __future__ import annotations

import math

from agribot.core.messages import Four
from agribot.drivers.board import board_protocol as wire
from agribot.drivers.board.board_codec import BoardDecoder, encode

TICK_S = 1.0 / wire.TELEMETRY_HZ
Flag, Cause = wire.BoardFlag, wire.StopCause


class BoardEmulator:
    """`feed` takes the bytes of the host, `advance` lives through a tick and gives the board's.

    The wheels follow the command within the acceleration of the configuration. `gyro_radps` and
    `accel_mps2` are what the IMU feels. One that runs away drives all wheels at
    `runaway_countps`, for as long as its motors have power.
    """

    def __init__(
        self, layout: int = wire.LAYOUT, timeout_s: float = wire.COMMAND_TIMEOUT_S
    ) -> None:
        """`timeout_s` is longer than the board's where a busy machine must not matter."""
        self.is_button_pressed = self.is_bumper_pressed = self.is_silent = False
        self.battery_v, self.motor_faults = 25.2, 0
        self.gyro_radps, self.accel_mps2 = (0.0, 0.0, 0.0), (0.0, 0.0, 9.81)
        self.mag_t = (0.0, 3e-5, -3e-5)
        self.runaway_countps, self.has_power = 0.0, True
        self.commands: list[wire.WheelCommand] = []
        self.clears = 0
        self._layout, self.timeout_s = layout, timeout_s
        self.restart()

    def restart(self, *, is_by_watchdog: bool = False) -> None:
        """Begin anew, as after a brown-out."""
        self._decoder, self._out = BoardDecoder("host"), bytearray()
        self._seq = self._ticks = 0
        self._config: wire.BoardConfig | None = None
        self._wanted: wire.WheelCommand | None = None
        self._age_s, self._waits_for_zero = math.inf, True
        self.causes = Cause.BEGAN
        self._hung = Flag.WATCHDOG_RESET if is_by_watchdog else Flag(0)
        self.speed_countps = [0.0] * 4
        self._counts = [0.0] * 4
        self._was_bumper = False

    @property
    def may_work(self) -> bool:
        is_fresh = self._age_s < self.timeout_s
        return not (self.causes or self._waits_for_zero) and is_fresh and self._config is not None

    def feed(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            message = frame.message
            if isinstance(message, wire.WheelCommand):
                self._take(message)
            elif isinstance(message, wire.ClearLatch):
                self._clear()
            elif isinstance(message, wire.BoardConfig):
                self._config, self._waits_for_zero = message, True
            elif isinstance(message, wire.AskVersion):
                self._say(wire.BoardVersion(
                    protocol=wire.PROTOCOL, board=wire.BoardKind.MOTOR, layout=self._layout,
                    firmware=(1, 0, 0), reset_cause=0,
                ))  # fmt: skip

    def advance(self) -> bytes:
        """Live through one tick; gives what is said meanwhile."""
        self._ticks += 1
        self._age_s += TICK_S
        if self.is_button_pressed:
            self.causes |= Cause.ESTOP
        if self.is_bumper_pressed and not self._was_bumper:
            self.causes |= Cause.BUMPER
        if self.motor_faults:
            self.causes |= Cause.MOTOR
        self._was_bumper = self.is_bumper_pressed
        self._turn()
        self._tell()
        said = b"" if self.is_silent else bytes(self._out)
        self._out.clear()
        return said

    def _take(self, command: wire.WheelCommand) -> None:
        self.commands.append(command)
        self._wanted, self._age_s = command, 0.0
        if not any(command.speed_countps) and not self.causes:
            self._waits_for_zero = False

    def _clear(self) -> None:
        self.clears += 1
        if not self.is_button_pressed:
            self.causes, self.motor_faults, self._waits_for_zero = Cause(0), 0, True

    def _turn(self) -> None:
        config, wanted = self._config, self._wanted
        step = TICK_S * (config.max_accel_countps2 if config else 0)
        for k in range(4):
            aim = wanted.speed_countps[k] if wanted and self.may_work else 0.0
            aim = (self.runaway_countps or aim) if self.has_power else 0.0
            speed = self.speed_countps[k]
            self.speed_countps[k] = speed + min(max(aim - speed, -step), step)
            self._counts[k] += self.speed_countps[k] * TICK_S

    def _tell(self) -> None:
        a, b, c, d = (round(count) for count in self._counts)
        e, f, g, h = (round(speed) for speed in self.speed_countps)
        flags, none = self._read_flags(), (0.0, 0.0, 0.0, 0.0)
        t_us = self._ticks * 10_000 & 0xFFFFFFFF
        self._say(wire.BoardState(
            t_us=t_us, counts=(a, b, c, d), speed_countps=(e, f, g, h), duty_ratio=none,
            current_a=none, battery_v=self.battery_v, flags=flags, stop_causes=self.causes,
            motor_faults=self.motor_faults, tool=0, command_seq=0, encoder_errors=0,
            bad_frames=self._decoder.bad & 0xFF,
        ))  # fmt: skip
        self._say(wire.BoardImu(
            t_us=t_us, accel_mps2=self.accel_mps2, temperature_c=20.0, gyro_radps=self.gyro_radps,
            mag_t=self.mag_t, mag_count=self._ticks // 5 & 0xFF, flags=flags,
        ))  # fmt: skip

    def _read_flags(self) -> wire.BoardFlag:
        flags = self._hung
        for is_so, flag in (
            (self.is_button_pressed, Flag.ESTOP_PRESSED),
            (self.is_bumper_pressed, Flag.BUMPER_PRESSED),
            (bool(self.causes), Flag.STOP_LATCHED),
            (self._age_s >= self.timeout_s, Flag.NO_COMMAND),
            (self._config is None, Flag.NOT_CONFIGURED),
            (self._waits_for_zero, Flag.WAITS_FOR_ZERO),
            (bool(self.motor_faults), Flag.MOTOR_FAULT),
        ):
            flags |= flag if is_so else Flag(0)
        return flags

    def _say(self, message: wire.BoardMessage) -> None:
        self._out += encode(self._seq, message)
        self._seq = (self._seq + 1) & 0xFF


def turn_of(board: BoardEmulator, counts_per_turn: float) -> Four:
    """Wheel speeds, rad/s, in the order of WHEEL_NAMES."""
    a, b, c, d = (speed / counts_per_turn * math.tau for speed in board.speed_countps)
    return a, b, c, d
