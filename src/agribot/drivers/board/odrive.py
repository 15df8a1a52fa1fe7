"""An ODrive as a motor board: `serial:/dev/ttyACM0?board=odrive`, its axes the two sides.

Source: ODrive's documentation, "ASCII Protocol" (firmware 0.5 and 0.6): `v AXIS TURNS_PER_S 0`
sets a velocity and feeds the axis' watchdog, `f AXIS` answers position and velocity in turns,
`r PROPERTY` its value, `sc` clears errors. Of its firmware (MotorControl/axis.cpp): a watchdog
counts in every state, and what was never fed has expired when it is switched on; an axis with an
error enters no closed loop.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

from agribot.core.errors import ConfigError
from agribot.core.facts import AxisError, AxisStands, join_facts
from agribot.core.messages import (
    WHEEL_NAMES,
    BatterySample,
    BoardSample,
    Four,
    ImplementCommand,
    SafetyInput,
    WheelSample,
)
from agribot.core.robot import RobotSpec
from agribot.drivers.board.motor_board import GEAR_HOW, STATE_S, BoardReport, StampedReport
from agribot.drivers.board.odrive_line import VOLTAGE, OdriveAnswers, OdriveLine, write_line
from agribot.drivers.line.uri_options import UriOptions

ROUND_TICKS = 5  # ticks between two questions for faults, states and voltage
# Commands between two that set the watchdogs: an ODrive that began anew has forgotten them.
WATCHDOG_TICKS = 5
WATCHDOG_S = 0.3
IDLE, CLOSED_LOOP = 1, 8  # AXIS_STATE_IDLE, AXIS_STATE_CLOSED_LOOP_CONTROL
# Names and values of an axis' errors by firmware (0.5, 0.6); WATCHDOG_TIMER_EXPIRED is one of them.
WATCHDOG_EXPIRED = {"error": 0x800, "active_errors": 0x0100_0000}


class OdriveBoard:
    """`axes` are those of the right and the left side. It reports no time and no red button.

    It drives no wheel before both axes are in closed loop, which an ODrive is not when it was just
    switched on, nor after an error: it holds a stop until then. What the axes do that was asked
    more than `STATE_S` ago is not known any more, and not reported.
    """

    inputs: frozenset[SafetyInput] = frozenset({"battery", "motors"})
    latency_s = 0.002
    trouble = ""

    def __init__(
        self, axes: tuple[int, int], gear_ratio: float, error: str = "error",
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """`error` is what a firmware calls the faults of an axis: 0.6 has `active_errors`."""
        self._axes, self._gear, self._now_s = axes, gear_ratio, now_s
        self._sides = SideAxes(axes, gear_ratio, WATCHDOG_EXPIRED[error])
        self._motions = {axis: f"f {axis}" for axis in axes}
        self._errors = {axis: f"r axis{axis}.{error}" for axis in axes}
        self._state_names = {axis: f"r axis{axis}.current_state" for axis in axes}
        self._line = OdriveLine(self._motions[axes[0]], now_s)
        self.open()

    @property
    def broken(self) -> int:
        """Count of lines that did not fit, or did not come."""
        return self._line.bad

    bad = broken

    @property
    def is_waiting(self) -> bool:
        """Whether answers to questions are under way."""
        return self._line.is_waiting

    def open(self) -> bytes:
        """Ask and drive from the beginning; the empty line ends what was half sent."""
        self._line.open()
        self._polls = self._drives = 0
        self._asked_polls, self._round_polls = 0, -ROUND_TICKS  # at the newest round, and answered
        self._states: dict[int, AxisState] = {}
        self._voltage_v, self._states_s = math.nan, -math.inf
        self._is_changing = False  # axes got the command for closed loop, and have not answered
        self._is_change_asked = False
        return b"\n"

    def poll(self) -> bytes:
        self._polls += 1
        is_due = self._polls - self._round_polls >= ROUND_TICKS
        names = (*self._errors.values(), *self._state_names.values(), VOLTAGE)
        asked = self._line.ask([*self._motions.values(), *(names if is_due else ())])
        if asked and is_due:
            self._asked_polls, self._is_change_asked = self._polls, self._is_changing
        return asked

    def feed(self, data: bytes) -> list[StampedReport]:
        reports = (self._report(answers) for answers in self._line.feed(data))
        return [StampedReport(0.0, report) for report in reports if report]

    def drive(self, speeds_radps: Four, implement: ImplementCommand) -> bytes:
        """Set the velocities; a watchdog is switched on after it was fed, else it has expired.

        It is not when its time is set first, which may get lost: one without time expires at once.
        """
        turns = [speed * self._gear / math.tau for speed in speeds_radps[:2]]
        reported = [
            f"v {axis} {speed:.5f} 0" for axis, speed in zip(self._axes, turns, strict=True)
        ]
        if self._drives % WATCHDOG_TICKS == 0:
            names = [f"axis{axis}.config" for axis in self._axes]
            limits = [f"w {name}.watchdog_timeout {WATCHDOG_S}" for name in names]
            enables = [f"w {name}.enable_watchdog 1" for name in names] if self._drives else []
            reported = [*limits, *reported, *enables]
        self._drives += 1
        return _write(reported)

    def clear_stop(self) -> bytes:
        """Clear the errors of axes that stand, and put them in closed loop.

        Their watchdogs are fed first, since they expire while no command drives. What the axes made
        of it is asked next, and nothing more is sent before they have answered: one that is in
        closed loop already would let go of its motor for a moment.
        """
        if self._is_changing or not self._states:
            return b""
        self._is_changing, self._round_polls = True, self._polls - ROUND_TICKS
        standing = [a for a in self._axes if self._states[a].state != CLOSED_LOOP]
        return _write([
            *(f"v {axis} 0 0" for axis in self._axes), "sc",
            *(f"w axis{axis}.requested_state {CLOSED_LOOP}" for axis in standing),
        ])  # fmt: skip

    def _report(self, answers: OdriveAnswers) -> BoardReport | None:
        reported, now_s = answers.by_question, self._now_s()
        if VOLTAGE in reported:
            self._take_round(reported, answers.asked_s)
        if not self._states or now_s - answers.asked_s > STATE_S:
            return None
        motion = {
            axis: (reported[name][0], reported[name][1]) for axis, name in self._motions.items()
        }
        is_known = now_s - self._states_s <= STATE_S
        return self._sides.report(
            motion, self._states if is_known else None, self._voltage_v if is_known else math.nan
        )

    def _take_round(self, reported: Mapping[str, tuple[float, ...]], asked_s: float) -> None:
        self._states = {
            axis: AxisState(
                int(reported[self._errors[axis]][0]), int(reported[self._state_names[axis]][0])
            )
            for axis in self._axes
        }
        self._voltage_v, self._states_s = reported[VOLTAGE][0], asked_s
        if self._is_change_asked or not self._is_changing:
            self._round_polls, self._is_changing = self._asked_polls, False


class AxisState(NamedTuple):
    """Errors of an axis, 0 for none, and what it does."""

    error: int
    state: int


class SideAxes:
    """Reports of two axes, right and left; a wheel is the wheel of its side."""

    def __init__(
        self, axes: tuple[int, int], gear_ratio: float, expired: int, word: str = "axis"
    ) -> None:
        """`expired` are the bits of an error that mean a watchdog; `word` is what an axis is."""
        self._axes, self._gear, self._expired, self._word = axes, gear_ratio, expired, word

    def report(
        self, motion: Mapping[int, tuple[float, float]],
        states: Mapping[int, AxisState] | None, voltage_v: float,
    ) -> BoardReport:  # fmt: skip
        """Make a reading of positions and velocities in turns.

        States that are not known are None, and a voltage NaN: they are then not reported.
        """
        right, left = (motion[axis] for axis in self._axes)
        to_rad = math.tau / self._gear
        right_rad, left_rad = right[0] * to_rad, left[0] * to_rad
        v_right, v_left = right[1] * to_rad, left[1] * to_rad
        bad = [states is not None and bool(states[axis].error) for axis in self._axes]
        is_known = not math.isnan(voltage_v)
        return BoardReport(
            wheels=WheelSample(
                t_s=0.0, angle_rad=(right_rad, left_rad, right_rad, left_rad),
                speed_radps=(v_right, v_left, v_right, v_left),
                faults=tuple(name for k, name in enumerate(WHEEL_NAMES) if bad[k % 2]),
            ),
            battery=BatterySample(
                t_s=0.0, voltage_v=voltage_v, current_a=math.nan, charge_ratio=math.nan
            ) if is_known else None,
            board=None if states is None else self._describe(states, is_powered=is_known),
        )  # fmt: skip

    def _describe(self, states: Mapping[int, AxisState], *, is_powered: bool) -> BoardSample:
        why = (self._find_standing(axis, states[axis]) for axis in self._axes)
        errors = (self._find_error(axis, states[axis]) for axis in self._axes)
        return BoardSample(
            t_s=0.0, inputs=("battery", "motors") if is_powered else ("motors",),
            stop=join_facts([one for one in why if one]),
            fault=join_facts([one for one in errors if one]),
        )  # fmt: skip

    def is_standing(self, state: AxisState | None) -> bool:
        """Return whether an axis does not drive its wheels, as far as is known."""
        return state is None or bool(state.error) or state.state != CLOSED_LOOP

    def _find_error(self, axis: int, state: AxisState) -> AxisError | None:
        is_expired = bool(state.error & self._expired)
        error = AxisError(self._word, str(axis), state.error, is_expired)
        return error if state.error else None

    def _find_standing(self, axis: int, state: AxisState) -> AxisStands | None:
        """Find why an axis does not drive its wheels; None where it does."""
        if not self.is_standing(state):
            return None
        by_state: Literal["idle", "state"] = "idle" if state.state == IDLE else "state"
        why = "error" if state.error else by_state
        return AxisStands(self._word, str(axis), why, state.state)


def make_board(robot: RobotSpec, options: UriOptions) -> OdriveBoard:
    """Make it of `axes`, `gear` and `errors`.

    Raises: ConfigError: an invalid option.
    """
    text = options.pop_text("axes", "0,1")
    if text not in ("0,1", "1,0"):
        raise ConfigError(f"axes={text}: unknown; write axes=0,1, right before left, or axes=1,0")
    right = int(text[0])
    return OdriveBoard((right, 1 - right), *read_machine(options))


def read_machine(options: UriOptions) -> tuple[float, str]:
    """Read `gear`, turns of a motor for one of its wheel, and what the firmware calls `errors`.

    Raises: ConfigError: a gear that is not stated or out of range, or no such firmware.
    """
    error = options.pop_text("errors", "error")
    if error not in WATCHDOG_EXPIRED:
        raise ConfigError(
            f"errors={error}: unknown; write error for firmware 0.5, active_errors for 0.6"
        )
    return options.pop_stated("gear", 0.1, 1000.0, GEAR_HOW), error


def _write(commands: Sequence[str]) -> bytes:
    return "".join(map(write_line, commands)).encode()
