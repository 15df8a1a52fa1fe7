"""What a hand wants of the robot: keys, a stick or a mouse as a body twist. It knows no clock."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import msgspec

from agribot.ui import wire
from agribot.ui.hand.joystick import JoystickState

Twist = tuple[float, float]
STILL: Twist = (0.0, 0.0)


class HandRequest(NamedTuple):
    """What a hand asks for beside driving, and what to call it."""

    name: str
    request: wire.PageRequest


class Wish(NamedTuple):
    """Input from one look at a device; no twist: the driver has quit."""

    twist: Twist | None
    requests: tuple[HandRequest, ...] = ()


# Keys of a terminal that ask for something beside driving.
KEY_REQUESTS = {
    "stop": HandRequest("stop", wire.PressStop()),
    "nudge_left": HandRequest("nudge_left", wire.ControlMission(action="nudge_left")),
    "nudge_right": HandRequest("nudge_right", wire.ControlMission(action="nudge_right")),
}

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_WORDS = re.compile(r"\x1b\[<(\d+);(\d+);(\d+)([Mm])|\x1b[\[O]([ABCD])|\x1b\[0(n)|([\s\S])")
_LETTERS = {"w": "up", "s": "down", "a": "left", "d": "right", " ": "stop", "q": "quit",
            ",": "nudge_left", ".": "nudge_right"}  # fmt: skip
_DIRECTION = {"up": (1, 0), "down": (-1, 0), "left": (0, 1), "right": (0, -1)}


class HandRates(msgspec.Struct, frozen=True, kw_only=True):
    """Those of the original's key teleop; `scale` is on top, for all of them."""

    forward_mps: float = 0.8
    backward_mps: float = 0.5
    rotation_radps: float = 1.0
    # A terminal repeats pressed keys and reports no release; mouse events have to be requested.
    hold_s: float = 0.4
    scale: float = 1.0

    def twist(self, forward: float, left: float) -> Twist:
        """Return the twist of two deflections in [-1, 1]."""
        speed_mps = self.forward_mps if forward > 0 else self.backward_mps
        return (self.scale * forward * speed_mps, self.scale * left * self.rotation_radps)


class TerminalInput:
    """A terminal's bytes as keys and mouse places; pieces of any size."""

    def __init__(self) -> None:
        self._rest = ""

    def feed(self, data: bytes) -> list[tuple[str, int, int]]:
        """(word, column, row): up, down, left, right, stop, quit, press, drag, release or "".

        "alive" is a terminal's answer to the question for its state (DSR 5).
        """
        text = self._rest + data.decode("latin-1")
        self._rest = ""
        tail = re.search(r"\x1b(\[(<[\d;]*|0)?)?$", text)
        if tail and len(text) > 1 and tail.group(0) != "\x1b":
            text, self._rest = text[: tail.start()], tail.group(0)
        return [_word(match) for match in _WORDS.finditer(text)]


def _word(match: re.Match[str]) -> tuple[str, int, int]:
    button, column, row, end, arrow, alive, letter = match.groups()
    if button is not None:
        kind = "release" if end == "m" else ("drag" if int(button) & 32 else "press")
        return kind, int(column), int(row)
    if arrow is not None:
        return _ARROWS[arrow], 0, 0
    if alive is not None:
        return "alive", 0, 0
    return ("quit" if letter == "\x03" else _LETTERS.get(letter.lower(), "")), 0, 0


class KeyHand:
    """Drives while keys repeat, stands `hold_s` after the last one."""

    def __init__(self, rates: HandRates) -> None:
        self._rates = rates
        self._pressed_s: dict[str, float] = {}

    def press(self, key: str, now_s: float) -> None:
        if key in _DIRECTION:
            opposite = {"up": "down", "down": "up", "left": "right", "right": "left"}[key]
            self._pressed_s.pop(opposite, None)
            self._pressed_s[key] = now_s
        else:
            self._pressed_s.clear()

    def twist(self, now_s: float) -> Twist:
        held = [
            k for k, at_s in self._pressed_s.items() if 0.0 <= now_s - at_s < self._rates.hold_s
        ]
        forward = sum(_DIRECTION[key][0] for key in held)
        left = sum(_DIRECTION[key][1] for key in held)
        return self._rates.twist(forward, left)


class MouseHand:
    """Press, drag up for forward and sideways to turn; letting go stands still.

    A mouse that is held still says nothing, as a terminal whose connection is cut: one that was
    silent for `hold_s` has let go, and has to press anew.
    """

    def __init__(self, rates: HandRates, reach: int = 10) -> None:
        """`reach` is how many rows of the terminal are full speed; columns are half as wide."""
        self._rates, self._reach = rates, reach
        self._from: tuple[int, int] | None = None
        self._deflection = (0.0, 0.0)
        self._heard_s = -math.inf

    @property
    def is_held(self) -> bool:
        return self._from is not None

    def move(self, word: str, column: int, row: int, now_s: float) -> None:
        """Take in what the terminal says, its mouse or not."""
        self._heard_s = now_s
        if word == "press":
            self._from, self._deflection = (column, row), (0.0, 0.0)
        elif word == "drag" and self._from is not None:
            forward = (self._from[1] - row) / self._reach
            left = (self._from[0] - column) / (2.0 * self._reach)
            self._deflection = (_limit(forward), _limit(left))
        elif word == "release":
            self._from, self._deflection = None, (0.0, 0.0)

    def twist(self, now_s: float) -> Twist:
        if not 0.0 <= now_s - self._heard_s < self._rates.hold_s:
            self._from, self._deflection = None, (0.0, 0.0)
        return self._rates.twist(*self._deflection)


class StickHand:
    """A gamepad: it drives only while the dead-man button is held."""

    def __init__(
        self,
        rates: HandRates,
        deadman: int = 4,
        forward_axis: int = 1,
        left_axis: int = 0,
        dead_zone: float = 0.1,
    ) -> None:
        self._rates, self._deadman, self._dead_zone = rates, deadman, dead_zone
        self._axes = (forward_axis, left_axis)

    def twist(self, stick: JoystickState) -> Twist:
        """Up and left on a stick are negative in Linux's interface."""
        if not stick.buttons.get(self._deadman, False):
            return STILL
        forward, left = (-stick.axis(axis, self._dead_zone) for axis in self._axes)
        return self._rates.twist(forward, left)

    def wish(self, stick: JoystickState) -> Wish:
        return Wish(self.twist(stick))


def _limit(value: float) -> float:
    return min(max(value, -1.0), 1.0)
