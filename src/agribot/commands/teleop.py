"""`agribot teleop`: drive a running robot from a terminal or with a gamepad, without a page."""

from __future__ import annotations

import argparse
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from agribot.commands.door import add_door_arguments, door_of
from agribot.commands.stopping import stop_on_signal
from agribot.errors import ConfigError, PlatformError
from agribot.ui.hand import HandRates, KeyHand, MouseHand, StickHand, TerminalInput, Twist
from agribot.ui.joystick import JoystickState
from agribot.ui.remote import Remote

MOUSE_ON, MOUSE_OFF = "\x1b[?1002h\x1b[?1006h", "\x1b[?1006l\x1b[?1002l"
HELP = {
    "keyboard": "arrows or w a s d drive, space stops, q quits",
    "mouse": "press, drag up to drive and sideways to turn, let go to stand; space stops, q quits",
    "joystick": "hold the dead-man button and move the stick; Ctrl-C quits",
}

# One look at the device: the twist now, or None to quit; True with it for an emergency stop.
Read = Callable[[float], tuple[Twist | None, bool]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    rates = HandRates()
    parser.add_argument("device", choices=("keyboard", "mouse", "joystick"))
    add_door_arguments(parser)
    parser.add_argument("--take-over", action="store_true", help="take the seat from its holder")
    parser.add_argument("--rate", dest="rate_hz", type=float, default=20.0, metavar="HZ")
    parser.add_argument("--scale", type=float, default=1.0, help="of all speeds, 0 to 1")
    parser.add_argument("--forward", type=float, default=rates.forward_mps, metavar="MPS")
    parser.add_argument("--backward", type=float, default=rates.backward_mps, metavar="MPS")
    parser.add_argument("--rotation", type=float, default=rates.rotation_radps, metavar="RADPS")
    parser.add_argument("--hold", type=float, default=rates.hold_s, metavar="S", help="of a key")
    stick = parser.add_argument_group("joystick")
    stick.add_argument("--joy", default="/dev/input/js0", metavar="DEVICE")
    stick.add_argument("--deadman", type=int, default=4, metavar="BUTTON")
    stick.add_argument("--axes", default="1,0", metavar="FORWARD,LEFT")
    stick.add_argument("--dead-zone", type=float, default=0.1)


def run(options: argparse.Namespace) -> int:
    rates = _rates(options)
    door = door_of(options)
    opened = _joystick if options.device == "joystick" else _terminal
    with (
        opened(options, rates) as read,
        Remote(door, f"teleop {options.device}") as robot,
        stop_on_signal() as stop,
    ):
        robot.take_seat(force=options.take_over)
        sys.stderr.write(f"{HELP[options.device]}\r\n")
        _drive(robot, read, options.rate_hz, stop)
    sys.stderr.write("\n")
    return 0


def _drive(robot: Remote, read: Read, rate_hz: float, stop: list[int]) -> None:
    """A request at every period, also at rest, so that the robot knows that somebody is there."""
    while not stop:
        twist, is_stop = read(1.0 / rate_hz)
        if is_stop:
            robot.send(k="stop")
        if twist is None:
            return
        robot.drive(*twist)
        robot.listen()
        _show(robot, twist)


def _show(robot: Remote, twist: Twist) -> None:
    state = robot.state
    if sys.stderr.isatty() and state:
        now = f"{twist[0]:+.2f} m/s {twist[1]:+.2f} rad/s  robot {state['vel'][0] or 0:+.2f} m/s"
        sys.stderr.write(f"\r{now}  {state['mode']} {state['reason'][:60]}\x1b[K")
        sys.stderr.flush()


def _rates(options: argparse.Namespace) -> HandRates:
    numbers = {
        "--scale": (options.scale, 1.0),
        "--forward": (options.forward, 2.0),
        "--backward": (options.backward, 2.0),
        "--rotation": (options.rotation, 3.0),
        "--hold": (options.hold, 1.0),
    }
    for name, (value, limit) in numbers.items():
        if not 0.0 <= value <= limit:
            raise ConfigError(f"{name} {value:g}: must be between 0 and {limit:g}")
    if not 5.0 <= options.rate_hz <= 50.0:
        raise ConfigError(f"--rate {options.rate_hz:g}: must be between 5 and 50 Hz")
    return HandRates(
        forward_mps=options.forward,
        backward_mps=options.backward,
        rotation_radps=options.rotation,
        hold_s=options.hold,
        scale=options.scale,
    )


@contextmanager
def _terminal(options: argparse.Namespace, rates: HandRates) -> Iterator[Read]:
    """Keys and mouse of the terminal on stdin. Raises: ConfigError: it is no terminal."""
    if not sys.stdin.isatty():
        raise ConfigError(f"teleop {options.device} needs a terminal on its standard input")
    handle = sys.stdin.fileno()
    words, keys, mouse = TerminalInput(), KeyHand(rates), MouseHand(rates)
    is_mouse = options.device == "mouse"

    def read(timeout_s: float) -> tuple[Twist | None, bool]:
        is_stop, end_s = False, time.monotonic() + timeout_s
        while select.select([handle], [], [], max(0.0, end_s - time.monotonic()))[0]:
            try:
                data = os.read(handle, 1024)
            except OSError:
                return None, is_stop  # the terminal was closed
            for word, column, row in words.feed(data):
                if word == "quit":
                    return None, is_stop
                is_stop |= word == "stop"
                keys.press(word, time.monotonic())
                mouse.move("release" if word == "stop" else word, column, row)
        return (mouse.twist() if is_mouse else keys.twist(time.monotonic())), is_stop

    before = termios.tcgetattr(handle)
    tty.setcbreak(handle)
    sys.stderr.write(MOUSE_ON if is_mouse else "")
    sys.stderr.flush()
    try:
        yield read
    finally:
        sys.stderr.write(MOUSE_OFF if is_mouse else "")
        termios.tcsetattr(handle, termios.TCSADRAIN, before)


@contextmanager
def _joystick(options: argparse.Namespace, rates: HandRates) -> Iterator[Read]:
    """Raises: ConfigError: no such device. PlatformError: it was pulled out."""
    try:
        forward_axis, left_axis = (int(axis) for axis in options.axes.split(","))
        handle = os.open(options.joy, os.O_RDONLY | os.O_NONBLOCK)
    except ValueError as error:
        raise ConfigError(f"--axes {options.axes}: write two numbers, as in 1,0") from error
    except OSError as error:
        raise ConfigError(
            f"cannot open joystick {options.joy}: {error.strerror}; plug it in or choose --joy"
        ) from error
    state = JoystickState()
    hand = StickHand(rates, options.deadman, forward_axis, left_axis, options.dead_zone)

    def read(timeout_s: float) -> tuple[Twist | None, bool]:
        end_s = time.monotonic() + timeout_s
        while select.select([handle], [], [], max(0.0, end_s - time.monotonic()))[0]:
            try:
                data = os.read(handle, 4096)
            except BlockingIOError:
                break
            except OSError as error:
                raise PlatformError(f"joystick {options.joy} is gone: {error.strerror}") from error
            if not data:
                raise PlatformError(f"joystick {options.joy} is gone")
            state.feed(data)
        return hand.twist(state), False

    try:
        yield read
    finally:
        os.close(handle)
