"""An ODrive as a motor board: `serial:/dev/ttyACM0?board=odrive`, its axes the two sides.

Source: ODrive's documentation, "ASCII Protocol" (firmware 0.5 and 0.6): `v AXIS TURNS_PER_S 0`
sets a velocity and feeds the axis' watchdog, `f AXIS` answers position and velocity in turns,
`r PROPERTY` its value, `sc` clears errors; answers come in the order of the questions and do not
say to which. Of its firmware (MotorControl/axis.cpp): a watchdog counts in every state, and what
was never fed has expired when it is switched on; an axis with an error enters no closed loop.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from agribot.core.errors import ConfigError
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
from agribot.drivers.motor_board import GEAR_HOW, BoardReport, StampedReport
from agribot.drivers.uri_options import UriOptions

LONGEST_LINE = 256
MOST_OPEN = 24  # questions; more without an answer are those of a line that lost some
# Faults, states and voltage are asked once in so many readings, and the watchdogs switched on once
# in so many commands: an ODrive that began anew has forgotten them.
ROUND_TICKS = 10
WATCHDOG_S = 0.3
IDLE, CLOSED_LOOP = 1, 8  # AXIS_STATE_IDLE, AXIS_STATE_CLOSED_LOOP_CONTROL
# What firmwares call the errors of an axis (0.5, 0.6), and WATCHDOG_TIMER_EXPIRED among them.
WATCHDOG_EXPIRED = {"error": 0x800, "active_errors": 0x0100_0000}
_VOLTAGE = "vbus_voltage"


class OdriveBoard:
    """`axes` are those of the right and the left side. It tells no time, and of no red button.

    It drives no wheel before both axes are in closed loop, which an ODrive is not when it was just
    switched on, nor after an error: it holds a stop until then.
    """

    inputs: frozenset[SafetyInput] = frozenset({"battery", "motors"})
    latency_s = 0.002
    trouble = ""

    def __init__(self, axes: tuple[int, int], gear_ratio: float, error: str = "error") -> None:
        """`error` is what a firmware calls the faults of an axis: 0.6 has `active_errors`."""
        self._axes, self._gear = axes, gear_ratio
        self._sides = SideAxes(axes, gear_ratio, WATCHDOG_EXPIRED[error])
        self._errors = {f"axis{axis}.{error}": axis for axis in axes}
        self._state_names = {f"axis{axis}.current_state": axis for axis in axes}
        self._asked: deque[str] = deque()
        self._line = bytearray()
        self._polls = self._drives = 0
        self._motion: dict[int, tuple[float, float]] = {}
        self._faults: dict[int, int] = {}
        self._states: dict[int, int] = {}
        self._round: dict[str, float] = {}  # what the round tells that is not whole yet
        self._is_changing = False  # axes were told to go to closed loop, and none has told since
        self._voltage_v = math.nan
        self.bad = 0

    def open(self) -> bytes:
        """Ask and drive from the beginning; the empty line ends what was half sent."""
        self._forget_questions()
        self._line.clear()
        self._faults.clear()
        self._states.clear()
        self._drives = 0
        return b"\n"

    def poll(self) -> bytes:
        if len(self._asked) > MOST_OPEN:
            self._forget_questions()
            self.bad += 1
        questions = [f"f {axis}" for axis in self._axes]
        if self._polls % ROUND_TICKS == 0:
            names = (*self._errors, *self._state_names, _VOLTAGE)
            questions += [f"r {name}" for name in names]
        self._polls += 1
        self._asked.extend(questions)
        return "".join(f"{question}\n" for question in questions).encode()

    def feed(self, data: bytes) -> list[StampedReport]:
        *lines, rest = (bytes(self._line) + data).split(b"\n")
        self._line = bytearray(rest[-LONGEST_LINE:])
        found = []
        for line in lines:
            words = line.decode("ascii", "replace").split()
            if words and (report := self._answer(words)):
                found.append(StampedReport(0.0, report))
        return found

    def drive(self, speeds_radps: Four, implement: ImplementCommand) -> bytes:
        """Set the velocities; a watchdog is switched on after it was fed, else it has expired."""
        turns = [speed * self._gear / math.tau for speed in speeds_radps[:2]]
        told = "".join(
            f"v {axis} {speed:.5f} 0\n" for axis, speed in zip(self._axes, turns, strict=True)
        )
        if self._drives % ROUND_TICKS == 0:
            names = [f"axis{axis}.config" for axis in self._axes]
            limits = "".join(f"w {name}.watchdog_timeout {WATCHDOG_S}\n" for name in names)
            told = limits + told + "".join(f"w {name}.enable_watchdog 1\n" for name in names)
        self._drives += 1
        return told.encode()

    def clear_stop(self) -> bytes:
        """Clear the errors of axes that stand, and put them in closed loop.

        Their watchdogs are fed first, which have expired where nobody drove. What the axes made of
        it is asked next, and they are told nothing more before they have answered: one that is in
        closed loop already would let go of its motor for a moment.
        """
        if self._is_changing:
            return b""
        self._is_changing, self._polls = True, 0
        fed = "".join(f"v {axis} 0 0\n" for axis in self._axes)
        standing = [axis for axis in self._axes if self._states.get(axis) != CLOSED_LOOP]
        states = "".join(f"w axis{axis}.requested_state {CLOSED_LOOP}\n" for axis in standing)
        return f"{fed}sc\n{states}".encode()

    def _forget_questions(self) -> None:
        """Ask all of it anew: which answer is to which question is not known any more."""
        self._asked.clear()
        self._motion.clear()
        self._round.clear()
        self._is_changing, self._polls = False, 0

    def _answer(self, words: list[str]) -> BoardReport | None:
        """Put an answer to its question.

        One that does not fit is of a line that lost some: all questions begin anew.
        """
        asked = self._asked.popleft() if self._asked else ""
        numbers = [_read_number(word) for word in words]
        is_motion = asked.startswith("f ")
        if len(numbers) != (2 if is_motion else 1) or None in numbers or not asked:
            self._forget_questions()
            self.bad += 1
            return None
        values = [number for number in numbers if number is not None]
        name = asked[2:]
        if not is_motion:
            self._take_property(name, values[0])
            return None
        axis = int(name)
        self._motion[axis] = values[0], values[1]
        is_known = len(self._motion) == len(self._faults) == len(self._states) == 2
        if axis != self._axes[-1] or not is_known:
            return None
        states = {one: AxisState(self._faults[one], self._states[one]) for one in self._axes}
        return self._sides.report(self._motion, states, self._voltage_v)

    def _take_property(self, name: str, value: float) -> None:
        """Take a value of the round in, and all of them with the last: none is another's then."""
        self._round[name] = value
        if name != _VOLTAGE:
            return
        told, self._round = self._round, {}
        if len(told) < 1 + len(self._errors) + len(self._state_names):
            return
        self._faults = {axis: int(told[one]) for one, axis in self._errors.items()}
        self._states = {axis: int(told[one]) for one, axis in self._state_names.items()}
        self._voltage_v, self._is_changing = value, False


class AxisState(NamedTuple):
    """Errors of an axis, 0 for none, and what it does."""

    error: int
    state: int


class SideAxes:
    """What two axes, right and left, tell of the robot; a wheel is the wheel of its side."""

    def __init__(
        self, axes: tuple[int, int], gear_ratio: float, expired: int, word: str = "axis"
    ) -> None:
        """`expired` are the bits of an error that mean a watchdog; `word` is what an axis is."""
        self._axes, self._gear, self._expired, self._word = axes, gear_ratio, expired, word

    def report(
        self, motion: dict[int, tuple[float, float]], states: dict[int, AxisState],
        voltage_v: float,
    ) -> BoardReport:  # fmt: skip
        """Make a reading of positions and velocities in turns; no voltage is NaN."""
        right, left = (motion[axis] for axis in self._axes)
        to_rad = math.tau / self._gear
        right_rad, left_rad = right[0] * to_rad, left[0] * to_rad
        v_right, v_left = right[1] * to_rad, left[1] * to_rad
        bad = [bool(states[axis].error) for axis in self._axes]
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
            board=BoardSample(
                t_s=0.0, inputs=("battery", "motors") if is_known else ("motors",),
                stopped=" and ".join(
                    filter(None, (self._why_standing(axis, states[axis]) for axis in self._axes))
                ),
                faults=tuple(
                    filter(None, (self._name_error(axis, states[axis]) for axis in self._axes))
                ),
            ),
        )  # fmt: skip

    def is_standing(self, state: AxisState | None) -> bool:
        """Tell whether an axis does not drive its wheels, as far as is known."""
        return state is None or bool(state.error) or state.state != CLOSED_LOOP

    def _name_error(self, axis: int, state: AxisState) -> str:
        expired = " (its watchdog heard no command in time)" if state.error & self._expired else ""
        return f"{self._word} {axis}: error {state.error:#x}{expired}" if state.error else ""

    def _why_standing(self, axis: int, state: AxisState) -> str:
        """Say why an axis does not drive its wheels; empty where it does."""
        if state.error:
            return f"{self._word} {axis} has an error"
        if not self.is_standing(state):
            return ""
        does = "idle" if state.state == IDLE else f"in state {state.state}"
        return f"{self._word} {axis} is {does}"


def make_board(robot: RobotSpec, options: UriOptions) -> OdriveBoard:
    """Make it of `axes`, `gear` and `errors`.

    Raises: ConfigError: an option that is none.
    """
    text = options.pop_text("axes", "0,1")
    if text not in ("0,1", "1,0"):
        raise ConfigError(f"axes={text}: write axes=0,1, right before left, or axes=1,0")
    right = int(text[0])
    return OdriveBoard((right, 1 - right), *read_machine(options))


def read_machine(options: UriOptions) -> tuple[float, str]:
    """Read `gear`, turns of a motor for one of its wheel, and what the firmware calls `errors`.

    Raises: ConfigError: a gear that nobody stated or out of range, or no such firmware.
    """
    error = options.pop_text("errors", "error")
    if error not in WATCHDOG_EXPIRED:
        raise ConfigError(f"errors={error}: firmware 0.5 has error, 0.6 active_errors")
    return options.pop_stated("gear", 0.1, 1000.0, GEAR_HOW), error


def _read_number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
