"""`agribot teleop`: drive a running robot from a terminal or with a gamepad, without a page."""

from __future__ import annotations

import argparse
import os
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

from agribot.cli.ranges import check_within, finite
from agribot.cli.robot_address import add_robot_arguments, find_robot
from agribot.cli.run import teleop_ros
from agribot.cli.run.joint_jogging import add_joint_arguments, open_jogger
from agribot.cli.run.terminal import ReadKeys, has_mouse, open_keys
from agribot.cli.stopping import stop_on_signal
from agribot.core import extras
from agribot.core.errors import ConfigError, PlatformError, explain_os_error
from agribot.ui.hand.inputs import (
    KEY_REQUESTS,
    HandRates,
    KeyHand,
    MouseHand,
    StickHand,
    TerminalInput,
    Twist,
    Wish,
)
from agribot.ui.hand.joystick import JoystickState
from agribot.ui.hand.remote import Remote
from agribot.ui.hand.stick_table import TableHand, read_table

MOUSE_ON, MOUSE_OFF = "\x1b[?1002h\x1b[?1006h", "\x1b[?1006l\x1b[?1002l"
ASK_TERMINAL = "\x1b[5n"  # question for its state, which it answers at once
HELP = {
    "keyboard": "arrows or w a s d drive, space stops, q quits; , and . move the row's line 1 cm",
    "mouse": "press, drag up to drive and sideways to turn, let go to stand; space stops, q quits",
    "joystick": "hold the dead-man button and move the stick; Ctrl-C quits",
}
DEADMAN, AXES = 4, "1,0"

Read = Callable[[float], Wish]  # one look at the device, as long as a period


def add_arguments(parser: argparse.ArgumentParser) -> None:
    rates = HandRates()
    parser.add_argument("device", choices=("keyboard", "mouse", "joystick"))
    add_robot_arguments(parser)
    teleop_ros.add_ros_arguments(parser)
    parser.add_argument("--take-over", action="store_true", help="take the seat from its holder")
    parser.add_argument("--rate", dest="rate_hz", type=finite, default=20.0, metavar="HZ")
    parser.add_argument("--scale", type=finite, default=1.0, help="of all speeds, 0 to 1")
    parser.add_argument("--forward", type=finite, default=rates.forward_mps, metavar="MPS")
    parser.add_argument("--backward", type=finite, default=rates.backward_mps, metavar="MPS")
    parser.add_argument("--rotation", type=finite, default=rates.rotation_radps, metavar="RADPS")
    parser.add_argument("--hold", type=finite, default=rates.hold_s, metavar="S",
                        help="of a key, and of a mouse whose terminal is silent")  # fmt: skip
    stick = parser.add_argument_group("joystick")
    stick.add_argument("--joy", default="/dev/input/js0", metavar="DEVICE")
    stick.add_argument("--deadman", type=int, metavar="BUTTON", help=f"default: {DEADMAN}")
    stick.add_argument("--axes", metavar="FORWARD,LEFT", help=f"default: {AXES}")
    stick.add_argument("--dead-zone", type=finite, default=0.1)
    stick.add_argument(
        "--config",
        metavar="TELEOP_YAML",
        help="table of axes and buttons of joy_teleop or teleop_twist_joy, of ROS 1 or 2, in place "
        "of --deadman, --axes and the rates",
    )
    add_joint_arguments(parser)


def run(options: argparse.Namespace) -> int:
    rates = _read_rates(options)
    if options.joints is not None and options.config is None:
        raise ConfigError("--joints is for a joystick with a table; give --config")
    hand = _choose_hand(options, rates) if options.device == "joystick" else None
    if teleop_ros.is_wanted(options):
        return teleop_ros.run(
            options, lambda: _open_hand(options, rates, hand), HELP[options.device]
        )
    extras.require("ui", "agribot teleop")
    door = find_robot(options)
    with (
        _open_hand(options, rates, hand) as read,
        Remote(door, f"teleop {options.device}") as robot,
        stop_on_signal() as stop,
    ):
        robot.take_seat(force=options.take_over)
        sys.stderr.write(f"{HELP[options.device]}\r\n")
        _drive(robot, read, options.rate_hz, stop)
    sys.stderr.write("\n")
    return 0


def _open_hand(
    options: argparse.Namespace, rates: HandRates, hand: StickHand | TableHand | None
) -> AbstractContextManager[Read]:
    return _open_joystick(options, hand) if hand else _open_terminal(options, rates)


def _drive(robot: Remote, read: Read, rate_hz: float, stop: list[int]) -> None:
    """Send a request at every period, also at rest, so that the robot knows the driver is there."""
    while not stop:
        twist, requests = read(1.0 / rate_hz)
        for request in requests:
            robot.request(*request)
        if twist is None:
            return
        robot.drive(*twist)
        robot.listen()
        for verdict in robot.verdicts():
            sys.stderr.write(f"\r{verdict}\x1b[K\r\n")
        _show(robot, twist)


def _show(robot: Remote, twist: Twist) -> None:
    state = robot.state
    if sys.stderr.isatty() and state is not None:
        now = f"{twist[0]:+.2f} m/s {twist[1]:+.2f} rad/s  robot {state.v_mps or 0:+.2f} m/s"
        sys.stderr.write(f"\r{now}  {state.mode} {state.reason[:60]}\x1b[K")
        sys.stderr.flush()


def _read_rates(options: argparse.Namespace) -> HandRates:
    if options.config is not None and options.device != "joystick":
        raise ConfigError(f"--config is for a joystick, not for {options.device}; leave it out")
    if not 0.0 <= options.dead_zone < 1.0:
        raise ConfigError(
            f"--dead-zone {options.dead_zone:g}: out of range; give at least 0 and below 1"
        )
    numbers = {
        "--scale": (options.scale, 1.0),
        "--forward": (options.forward, 2.0),
        "--backward": (options.backward, 2.0),
        "--rotation": (options.rotation, 3.0),
        "--hold": (options.hold, 1.0),
    }
    for name, (value, limit) in numbers.items():
        check_within(name, value, 0.0, limit)
    check_within("--rate", options.rate_hz, 5.0, 50.0, "Hz")
    return HandRates(
        forward_mps=options.forward,
        backward_mps=options.backward,
        rotation_radps=options.rotation,
        hold_s=options.hold,
        scale=options.scale,
    )


@contextmanager
def _open_terminal(options: argparse.Namespace, rates: HandRates) -> Iterator[Read]:
    """Read keys and mouse of the terminal on stdin."""
    if not sys.stdin.isatty():
        raise ConfigError(
            f"teleop {options.device} needs a terminal on its standard input; start it in one"
        )
    is_mouse = options.device == "mouse"
    if is_mouse and not has_mouse():
        raise ConfigError("teleop mouse: this console reports no mouse; use keyboard or the page")
    with open_keys() as read_keys:
        _write(MOUSE_ON if is_mouse else "")
        try:
            yield _TerminalHand(rates, read_keys, is_mouse=is_mouse).read
        finally:
            _write(MOUSE_OFF if is_mouse else "")


class _TerminalHand:
    """Keys and the mouse of a terminal as a hand."""

    def __init__(self, rates: HandRates, read_keys: ReadKeys, *, is_mouse: bool) -> None:
        self._rates, self._read_keys, self._is_mouse = rates, read_keys, is_mouse
        self._words, self._keys, self._mouse = TerminalInput(), KeyHand(rates), MouseHand(rates)

    def read(self, timeout_s: float) -> Wish:
        asked: list[str] = []
        end_s = time.monotonic() + timeout_s
        if self._mouse.is_held:
            _write(ASK_TERMINAL)
        while data := self._read_keys(max(0.0, end_s - time.monotonic())):
            for word, column, row in self._words.feed(data):
                if word == "quit":
                    return _make_request(None, asked)
                asked += [word] if word in KEY_REQUESTS else []
                self._take(word, column, row)
        if data is None:  # the terminal was closed
            return _make_request(None, asked)
        return _make_request(self._find_twist(time.monotonic()), asked)

    def _take(self, word: str, column: int, row: int) -> None:
        self._keys.press(word, time.monotonic())
        if self._is_mouse:
            said = "release" if word == "stop" else word
            self._mouse.move(said, column, row, time.monotonic())

    def _find_twist(self, now_s: float) -> Twist:
        was_held = self._mouse.is_held
        twist = self._mouse.twist(now_s) if self._is_mouse else self._keys.twist(now_s)
        if was_held and not self._mouse.is_held:
            hold_s = self._rates.hold_s
            _write(f"\rthe terminal was silent for {hold_s:g} s; press anew\x1b[K\r\n")
        return twist


def _write(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()


def _make_request(twist: Twist | None, asked: list[str]) -> Wish:
    return Wish(twist, tuple(KEY_REQUESTS[word] for word in asked))


@contextmanager
def _open_joystick(options: argparse.Namespace, hand: StickHand | TableHand) -> Iterator[Read]:
    """Read a joystick or gamepad, whose buttons may move joints.

    Raises: ConfigError: no such device, or no such joint. PlatformError: it was pulled out.
        BridgeError: the network of the joints cannot be reached.
    """
    joints = open_jogger(options, hand) if isinstance(hand, TableHand) else ExitStack()
    with joints:
        yield from _read_joystick(options, hand)


def _read_joystick(options: argparse.Namespace, hand: StickHand | TableHand) -> Iterator[Read]:
    with explain_os_error(
        f"cannot open joystick {options.joy}", "plug it in or choose --joy", ConfigError
    ):
        handle = os.open(options.joy, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    state = JoystickState()

    def read(timeout_s: float) -> Wish:
        end_s = time.monotonic() + timeout_s
        while select.select([handle], [], [], max(0.0, end_s - time.monotonic()))[0]:
            try:
                data = os.read(handle, 4096)
            except BlockingIOError:
                break
            except OSError as error:
                raise PlatformError(
                    f"joystick {options.joy} is gone: {error.strerror}; plug it in and start again"
                ) from error
            if not data:
                raise PlatformError(f"joystick {options.joy} is gone; plug it in and start again")
            state.feed(data)
        return hand.wish(state)

    try:
        yield read
    finally:
        os.close(handle)


def _choose_hand(options: argparse.Namespace, rates: HandRates) -> StickHand | TableHand:
    """Read a table of the axes, or the options for them.

    Raises: ConfigError: the table or the axes make no sense.
    """
    if options.config is not None:
        if options.deadman is not None or options.axes is not None:
            raise ConfigError("--config has buttons and axes of its own; drop --deadman and --axes")
        return read_table(Path(options.config), options.scale, options.dead_zone)
    axes = options.axes or AXES
    try:
        forward_axis, left_axis = (int(axis) for axis in axes.split(","))
    except ValueError as error:
        raise ConfigError(f"--axes {axes}: not two numbers; write them as in {AXES}") from error
    deadman = DEADMAN if options.deadman is None else options.deadman
    return StickHand(rates, deadman, forward_axis, left_axis, options.dead_zone)
