"""An ODrive as a motor board: `serial:/dev/ttyACM0?board=odrive`, its axes the two sides.

Source: ODrive's documentation, "ASCII Protocol" (firmware 0.5 and 0.6): `v AXIS TURNS_PER_S 0`
sets a velocity and feeds the axis' watchdog, `f AXIS` answers position and velocity in turns,
`r PROPERTY` its value; answers come in the order of the questions and do not say to which.
"""

from __future__ import annotations

import math
from collections import deque

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
from agribot.drivers.motor_board import BoardReport, StampedReport
from agribot.drivers.uri_options import UriOptions

LONGEST_LINE = 256
MOST_OPEN = 24  # questions; more without an answer are those of a line that lost some
ROUND_TICKS = 10  # faults and voltage are asked once in so many readings
WATCHDOG_S = 0.3
CLOSED_LOOP = 8  # AXIS_STATE_CLOSED_LOOP_CONTROL
_VOLTAGE = "vbus_voltage"


class OdriveBoard:
    """`axes` are those of the right and the left side. It tells no time, and of no red button."""

    inputs: frozenset[SafetyInput] = frozenset({"battery", "motors"})
    latency_s = 0.002
    trouble = ""

    def __init__(self, axes: tuple[int, int], gear_ratio: float, error: str = "error") -> None:
        """`error` is what a firmware calls the faults of an axis: 0.6 has `active_errors`."""
        self._axes, self._gear = axes, gear_ratio
        self._errors = {f"axis{axis}.{error}": axis for axis in axes}
        self._asked: deque[str] = deque()
        self._line = bytearray()
        self._polls = 0
        self._motion: dict[int, tuple[float, float]] = {}
        self._faults: dict[int, int] = {}
        self._voltage_v = math.nan
        self.bad = 0

    def open(self) -> bytes:
        """Let the watchdogs of the axes watch; the empty line ends what was half sent."""
        self._asked.clear()
        self._line.clear()
        self._motion.clear()
        told = "\n"
        for axis in self._axes:
            told += f"w axis{axis}.config.watchdog_timeout {WATCHDOG_S}\n"
            told += f"w axis{axis}.config.enable_watchdog 1\n"
        return told.encode()

    def poll(self) -> bytes:
        if len(self._asked) > MOST_OPEN:
            self._asked.clear()
            self.bad += 1
        questions = [f"f {axis}" for axis in self._axes]
        if self._polls % ROUND_TICKS == 0:
            questions += [f"r {name}" for name in (*self._errors, _VOLTAGE)]
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
        right, left = speeds_radps[:2]
        turns = [speed * self._gear / math.tau for speed in (right, left)]
        return "".join(
            f"v {axis} {speed:.5f} 0\n" for axis, speed in zip(self._axes, turns, strict=True)
        ).encode()

    def clear_stop(self) -> bytes:
        states = "".join(f"w axis{axis}.requested_state {CLOSED_LOOP}\n" for axis in self._axes)
        return f"sc\n{states}".encode()

    def _answer(self, words: list[str]) -> BoardReport | None:
        """Put an answer to its question.

        One that does not fit is of a line that lost some: all questions begin anew.
        """
        asked = self._asked.popleft() if self._asked else ""
        numbers = [_read_number(word) for word in words]
        is_motion = asked.startswith("f ")
        if len(numbers) != (2 if is_motion else 1) or None in numbers or not asked:
            self._asked.clear()
            self._motion.clear()
            self.bad += 1
            return None
        values = [number for number in numbers if number is not None]
        name = asked[2:]
        if not is_motion:
            self._take_property(name, values[0])
            return None
        axis = int(name)
        self._motion[axis] = values[0], values[1]
        is_whole = axis == self._axes[-1] and len(self._motion) == 2 and len(self._faults) == 2
        return self._report() if is_whole else None

    def _take_property(self, name: str, value: float) -> None:
        if name in self._errors:
            self._faults[self._errors[name]] = int(value)
        else:
            self._voltage_v = value

    def _report(self) -> BoardReport:
        """Make a reading of the last answers; a wheel that turns is the wheel of its side."""
        right, left = (self._motion[axis] for axis in self._axes)
        to_rad = math.tau / self._gear
        right_rad, left_rad = right[0] * to_rad, left[0] * to_rad
        v_right, v_left = right[1] * to_rad, left[1] * to_rad
        bad = [bool(self._faults[axis]) for axis in self._axes]
        return BoardReport(
            wheels=WheelSample(
                t_s=0.0, angle_rad=(right_rad, left_rad, right_rad, left_rad),
                speed_radps=(v_right, v_left, v_right, v_left),
                faults=tuple(name for k, name in enumerate(WHEEL_NAMES) if bad[k % 2]),
            ),
            battery=None if math.isnan(self._voltage_v) else BatterySample(
                t_s=0.0, voltage_v=self._voltage_v, current_a=math.nan, charge_ratio=math.nan
            ),
            board=BoardSample(
                t_s=0.0,
                inputs=("motors",) if math.isnan(self._voltage_v) else ("battery", "motors"),
                faults=tuple(f"axis {axis}: error {self._faults[axis]:#x}"
                             for axis in self._axes if self._faults[axis]),
            ),
        )  # fmt: skip


def make_board(robot: RobotSpec, options: UriOptions) -> OdriveBoard:
    """Make it of `axes`, `gear` and `errors`.

    Raises: ConfigError: an option that is none.
    """
    text = options.pop_text("axes", "0,1")
    if text not in ("0,1", "1,0"):
        raise ConfigError(f"axes={text}: write axes=0,1, right before left, or axes=1,0")
    right = int(text[0])
    error = options.pop_text("errors", "error")
    if error not in ("error", "active_errors"):
        raise ConfigError(f"errors={error}: firmware 0.5 has error, 0.6 active_errors")
    gear = options.pop_number("gear", robot.drive.gear_ratio, 0.1, 1000.0)
    return OdriveBoard((right, 1 - right), gear, error)


def _read_number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
