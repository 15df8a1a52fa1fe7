"""The motor board of `firmware/`: its frames as wheels, safety inputs and faults."""

from __future__ import annotations

import math
from typing import get_args

from agribot.core.errors import ConfigError
from agribot.core.facts import (
    AnyFact,
    BoardCause,
    BoardHung,
    BoardStopped,
    BoardUnconfigured,
    Wheel,
    WheelsReversed,
    join_facts,
)
from agribot.core.messages import (
    WHEEL_NAMES,
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
from agribot.core.robot import RobotSpec
from agribot.drivers.board.board_codec import BoardDecoder, BoardEncoder
from agribot.drivers.board.board_protocol import (
    LAYOUT,
    AckResult,
    AskVersion,
    BoardAck,
    BoardConfig,
    BoardFlag,
    BoardImu,
    BoardKind,
    BoardMessage,
    BoardState,
    BoardVersion,
    ClearLatch,
    StopCause,
    WheelCommand,
)
from agribot.drivers.board.letter_imu import Axes, read_axes, turn_axes
from agribot.drivers.board.motor_board import BoardReport, StampedReport
from agribot.drivers.board.motor_watch import MotorWatch
from agribot.drivers.line.uri_options import UriOptions

POLLS_PER_QUESTION = 10  # a board that did not answer is asked again
MOST_COUNTPS, MOST_FULL_COUNTPS = 32767, 65535
SUPPLY_V = 24.0  # supply of the motors' full speed, and the default without a measured battery
WRAP_US = 1 << 32
WRAP_SPAN_US = 60_000_000  # a clock that goes back from its last minute to its first wrapped around
# Least voltage that feeds motors; below it the board runs on its USB line, and has no battery.
USB_V = 6.0
TOOL_OUTPUTS = 8
_HOW = (
    "measure the counts (agribot board show), read the full speed from the data sheet, and keep "
    "both: agribot calibrate motors (docs/first-drive.md, step 3)"
)
CAUSES: dict[StopCause, BoardCause] = {
    StopCause.BEGAN: "began",
    StopCause.ESTOP: "button",
    StopCause.BUMPER: "bumper",
    StopCause.BATTERY: "battery",
    StopCause.MOTOR: "motor",
    StopCause.REVERSED: "reversed",
}


class AgribotBoard:
    """One board. It reads every safety input; how its motors are wired is in `config`."""

    inputs: frozenset[SafetyInput] = frozenset({"red button", "bumper", "battery", "motors"})
    latency_s = 0.003  # the IMU is read meanwhile, then 60 bytes go out at 250,000 baud

    def __init__(
        self, config: BoardConfig, counts_per_turn: float, bumper_x_m: float, axes: Axes,
        pack_v: tuple[float, float] = (0.0, 0.0), motors: MotorWatch | None = None,
    ) -> None:  # fmt: skip
        """`counts_per_turn` of a wheel; the bumper is `bumper_x_m` ahead of the robot's middle.

        `axes` says which of the IMU's axes point forward, left and up. `pack_v` are the voltages
        of the empty and the full battery, from which its charge follows; 0 where they are unknown.
        `motors` is None where no current is measured, or the windings are unknown.
        """
        self._pack_v, self._motors = pack_v, motors
        self._config, self._counts_per_rad = config, counts_per_turn / math.tau
        self._bumper_x_m, self._axes = bumper_x_m, axes
        self._mag_count: int | None = None
        self._encoder, self._decoder = BoardEncoder(), BoardDecoder()
        self._is_known = self._is_configured = self._is_config_refused = False
        self._polls = self.frames_heard = 0
        self._broken_commands, self._bad_frames, self._state_us = 0, 0, 0
        self._clock = MicrosecondClock()
        self.trouble = ""

    @property
    def lost(self) -> int:
        """Frames of the board that were lost since its line was opened."""
        return self._decoder.lost + self._decoder.bad

    @property
    def broken(self) -> int:
        """Frames that were broken on their way from the board, or to it."""
        return self._decoder.bad + self._broken_commands

    def open(self) -> bytes:
        self._decoder = BoardDecoder()
        self._is_known = self._is_configured = self._is_config_refused = False
        self._polls = self.frames_heard = 0
        self._clock = MicrosecondClock()
        return b""

    def poll(self) -> bytes:
        """Ask what it is, and configure it, once it has spoken."""
        if not self.frames_heard or (self._is_known and self._is_configured):
            return b""
        self._polls += 1
        return self._ask() if self._polls % POLLS_PER_QUESTION == 1 else b""

    def feed(self, data: bytes) -> list[StampedReport]:
        found = []
        for frame in self._decoder.feed(data):
            self.frames_heard += 1
            if isinstance(frame.message, BoardVersion):
                self._check(frame.message)
            elif isinstance(frame.message, BoardAck):
                self._note_answer(frame.message)
            elif isinstance(frame.message, BoardState) and self._is_known:
                found.append(self._read(frame.message))
            elif isinstance(frame.message, BoardImu) and self._is_known:
                found.append(self._read_imu(frame.message))
        return found

    def drive(self, speeds_radps: Four, implement: ImplementCommand) -> bytes:
        most, scale = self._config.max_speed_countps, self._counts_per_rad
        a, b, c, d = (min(max(round(w * scale), -most), most) for w in speeds_radps)
        sections = implement.sections_on[:TOOL_OUTPUTS]
        tool = sum(1 << k for k, is_on in enumerate(sections) if is_on)
        return self._write(WheelCommand(speed_countps=(a, b, c, d), tool=tool))

    def clear_stop(self) -> bytes:
        return self._write(ClearLatch())

    def _ask(self) -> bytes:
        return b"\0" + self._write(AskVersion()) + self._write(self._config)

    def _write(self, message: BoardMessage) -> bytes:
        return self._encoder.encode(message)[1]

    def _check(self, version: BoardVersion) -> None:
        number = ".".join(map(str, version.firmware))
        if version.board is not BoardKind.MOTOR:
            self.trouble = "this is the IMU board; give it to --source imu, and base its own line"
        elif version.layout != LAYOUT:
            self.trouble = (
                f"its firmware {number} speaks another table of messages (layout "
                f"{version.layout:#06x}, wanted {LAYOUT:#06x}); flash the firmware of this version"
            )
        else:
            self.trouble, self._is_known = "", True

    def _note_answer(self, answer: BoardAck) -> None:
        if answer.of_type == BoardConfig.number:
            self._is_config_refused = answer.result is not AckResult.DONE

    def _count_broken(self, state: BoardState) -> None:
        """Count what the board could not read, unless it began anew since."""
        is_new = state.t_us < self._state_us
        more = (state.bad_frames - (0 if is_new else self._bad_frames)) & 0xFF
        self._broken_commands += more
        self._bad_frames, self._state_us = state.bad_frames, state.t_us

    def _read(self, state: BoardState) -> StampedReport:
        self._count_broken(state)
        self._is_configured = BoardFlag.NOT_CONFIGURED not in state.flags
        a, b, c, d = (count / self._counts_per_rad for count in state.counts)
        e, f, g, h = (speed / self._counts_per_rad for speed in state.speed_countps)
        has_battery = state.battery_v > USB_V
        effort_nm, lacking = self._read_motors(state, (e, f, g, h))
        empty_v, full_v = self._pack_v
        left_ratio = (state.battery_v - empty_v) / (full_v - empty_v) if full_v else math.nan
        report = BoardReport(
            wheels=WheelSample(
                t_s=0.0, angle_rad=(a, b, c, d), speed_radps=(e, f, g, h), effort_nm=effort_nm,
                faults=tuple(name for k, name in enumerate(WHEEL_NAMES)
                             if state.motor_faults & (0x11 << k) or name in lacking),
            ),
            battery=BatterySample(
                t_s=0.0, voltage_v=state.battery_v, current_a=sum(state.current_a),
                charge_ratio=min(max(left_ratio, 0.0), 1.0) if full_v else math.nan,
            ) if has_battery else None,
            bumper=BumperSample(t_s=0.0, x_body_m=self._bumper_x_m, y_body_m=0.0)
            if BoardFlag.BUMPER_PRESSED in state.flags else None,
            board=_read_board(
                state, has_battery=has_battery, is_config_refused=self._is_config_refused
            ),
        )  # fmt: skip
        return StampedReport(self._clock.read_s(state.t_us), report)

    def _read_motors(
        self, state: BoardState, speeds_radps: Four
    ) -> tuple[Four | None, tuple[str, ...]]:
        """Read the torques of the wheels, and whose motors draw too little; None: not measured."""
        if self._motors is None:
            return None, ()
        supply_v = state.battery_v if state.battery_v > USB_V else SUPPLY_V
        measured = supply_v, state.duty_ratio, speeds_radps, state.current_a
        return self._motors.torques_nm(*measured), self._motors.update(1e-6 * state.t_us, *measured)

    def _read_imu(self, imu: BoardImu) -> StampedReport:
        sample, field = read_board_imu(imu, self._axes, self._mag_count)
        self._mag_count = imu.mag_count
        return StampedReport(self._clock.read_s(imu.t_us), BoardReport(imu=sample, mag=field))


class MicrosecondClock:
    """Counts on where a board's 32 bits wrap around; a board that began anew is at zero."""

    def __init__(self) -> None:
        self._t_us = self._epoch_us = 0

    def read_s(self, t_us: int) -> float:
        """Say how long the board has run at this reading of its clock."""
        if t_us < self._t_us:
            is_wrapped = self._t_us > WRAP_US - WRAP_SPAN_US and t_us < WRAP_SPAN_US
            self._epoch_us = self._epoch_us + WRAP_US if is_wrapped else 0
        self._t_us = t_us
        return (self._epoch_us + t_us) * 1e-6


def read_board_imu(
    imu: BoardImu, axes: Axes, last_mag_count: int | None
) -> tuple[ImuSample, MagSample | None]:
    """Read an IMU's frame in the axes of the body, and the magnetic field where it is a new one."""
    is_new = last_mag_count is not None and imu.mag_count != last_mag_count
    sample = ImuSample(
        t_s=0.0,
        gyro_radps=turn_axes(imu.gyro_radps, axes),
        accel_mps2=turn_axes(imu.accel_mps2, axes),
    )
    if not is_new or BoardFlag.MAG_FAULT in imu.flags:
        return sample, None
    return sample, MagSample(t_s=0.0, field_t=turn_axes(imu.mag_t, axes))


def _read_board(state: BoardState, *, has_battery: bool, is_config_refused: bool) -> BoardSample:
    flags, causes = state.flags, state.stop_causes
    has_begun = StopCause.BEGAN in causes and BoardFlag.STOP_LATCHED in flags
    has_hung = has_begun and BoardFlag.WATCHDOG_RESET in flags
    found: list[AnyFact] = [BoardHung()] if has_hung else []
    if is_config_refused:
        found.append(BoardUnconfigured())
    if StopCause.REVERSED in causes:
        found.append(_find_reversed(state.motor_faults))
    stop = BoardStopped(tuple(word for cause, word in CAUSES.items() if cause in causes))
    return BoardSample(
        t_s=0.0,
        inputs=("red button", "bumper", "motors", *(("battery",) if has_battery else ())),
        is_button_pressed=BoardFlag.ESTOP_PRESSED in flags,
        stop=stop if BoardFlag.STOP_LATCHED in flags else None,
        fault=join_facts(found),
    )


def _find_reversed(motor_faults: int) -> WheelsReversed:
    bits = enumerate(get_args(Wheel))
    return WheelsReversed(tuple(name for k, name in bits if motor_faults & (0x10 << k)))


def make_board(robot: RobotSpec, options: UriOptions) -> AgribotBoard:
    """Make it for a robot; the options say what its description does not.

    Raises: ConfigError: an invalid option, motors that are not stated, or speeds that the
        frames cannot carry.
    """
    drive = robot.drive
    counts = options.pop_stated("counts_per_turn", 4.0, 1e6, _HOW)
    full = options.pop_stated("full_speed_radps", 0.1, 1e3, _HOW)
    countps_per_mps = counts / math.tau / drive.wheel_radius_m
    half_m = drive.effective_separation_m / 2.0
    top = (drive.max_speed_mps + drive.max_yaw_rate_radps * half_m) * countps_per_mps
    accel = (drive.max_accel_mps2 + drive.max_yaw_accel_radps2 * half_m) * countps_per_mps
    full_countps = full * counts / math.tau
    for what, countps, most in (
        ("the robot's top speed", top, MOST_COUNTPS),
        (f"full_speed_radps={full:g}, motors at full voltage without load,", full_countps,
         MOST_FULL_COUNTPS),
    ):  # fmt: skip
        if countps > most:
            raise ConfigError(
                f"counts_per_turn={counts:g} makes {countps:.0f} counts a second of {what} > "
                f"{most}, more than the board's messages hold; use an encoder with fewer lines"
            )
    config = BoardConfig(
        full_speed_countps=round(full_countps),
        max_speed_countps=round(min(top, full_countps)),
        max_accel_countps2=round(min(accel, 655_350)),
        kp_ratio=options.pop_number("kp", 1.5, 0.0, 2.0),
        ti_s=options.pop_number("ti_s", 0.25, 0.02, 60.0),
        current_limit_a=options.pop_number("current_limit_a", 10.0, 0.0, 65.0),
        battery_cutoff_v=options.pop_number("battery_cutoff_v", 18.0, 0.0, 65.0),
        motor_flips=round(options.pop_number("motor_flips", 0.0, 0.0, 15.0)),
        encoder_flips=round(options.pop_number("encoder_flips", 0.0, 0.0, 15.0)),
    )
    nose_m = drive.wheelbase_m / 2.0 + drive.wheel_radius_m
    bumper_x_m = options.pop_number("bumper_x_m", nose_m, -5.0, 5.0)
    axes = read_axes(options.pop_text("axes", "x,y,z"))
    winding_ohm = options.pop_number("winding_ohm", 0.0, 0.0, 1e3)
    is_watched = bool(config.current_limit_a and winding_ohm)
    motors = MotorWatch(drive, SUPPLY_V / full, winding_ohm) if is_watched else None
    return AgribotBoard(config, counts, bumper_x_m, axes, _read_pack(options), motors)


def _read_pack(options: UriOptions) -> tuple[float, float]:
    """Read the voltages of the empty and the full battery; 0 where they are not stated."""
    empty_v = options.pop_number("battery_empty_v", 0.0, 0.0, 65.0)
    full_v = options.pop_number("battery_full_v", 0.0, 0.0, 65.0)
    if bool(empty_v) != bool(full_v) or (full_v and full_v <= empty_v):
        raise ConfigError(
            f"battery_empty_v={empty_v:g} and battery_full_v={full_v:g}: not a pair in order; give "
            "both, the full one higher, or leave both out"
        )
    return empty_v, full_v
