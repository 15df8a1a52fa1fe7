"""`agribot calibrate motors`: the numbers of a builder's motors, into the robot's file."""

from __future__ import annotations

import argparse
import math

import msgspec

from agribot.app.calibration.robot_file import RobotFile
from agribot.cli.ranges import number
from agribot.core.home import find_home
from agribot.drivers.board.agribot_board import SUPPLY_V
from agribot.drivers.hardware_platform import MOTOR_SETTINGS

RADPS_PER_RPM = math.tau / 60.0
NEEDED = ("counts_per_turn", "full_speed_radps")


class MotorsResult(msgspec.Struct, frozen=True, kw_only=True):
    """The values that are kept, and their file."""

    counts_per_turn: float
    full_speed_radps: float
    winding_ohm: float | None
    file: str
    ok: bool = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--counts-per-turn", type=number(4.0, 1e6), required=True, metavar="N",
        help="encoder counts of one turn of the wheel: turn it by hand, and read the counts with "
        "agribot board show",
    )  # fmt: skip
    parser.add_argument(
        "--full-speed-rpm", type=number(1.0, 9500.0), required=True, metavar="RPM",
        help="turns a minute of the wheel at 24 V without load: the data sheet of motor and gear",
    )  # fmt: skip
    parser.add_argument(
        "--stall-current-a", type=number(0.1, 1000.0), metavar="A",
        help="of a motor that is held at 24 V: the data sheet; with it, and current sensors, a "
        "motor that does not work is noticed",
    )  # fmt: skip
    parser.add_argument("--robot", default="agribot", metavar="NAME|FILE", help="whose motors")
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def list_unstated(robot: str = "agribot") -> list[str]:
    """List what a motor board needs and the robot's file does not state.

    Raises: ConfigError: that file cannot be read.
    """
    stated = [setting.partition("=")[0] for setting in RobotFile(find_home(), robot).settings()]
    return [name for name in NEEDED if f"calibration.{name}" not in stated]


def keep_motors(options: argparse.Namespace) -> tuple[MotorsResult, str]:
    """Write the numbers into the robot's file.

    Raises: AgribotError: no such robot, a number out of range, or a file that cannot be written.
    """
    from agribot.description.loader import load_robot

    load_robot(options.robot)
    own = RobotFile(find_home(), options.robot)
    stall_a = options.stall_current_a
    result = MotorsResult(
        counts_per_turn=options.counts_per_turn,
        full_speed_radps=round(options.full_speed_rpm * RADPS_PER_RPM, 4),
        winding_ohm=None if stall_a is None else round(SUPPLY_V / stall_a, 4),
        file=str(own.path),
    )
    stated = {name: getattr(result, name) for name in MOTOR_SETTINGS}
    own.add(f"calibration.{name}={value!r}" for name, value in stated.items() if value is not None)
    return result, _format(options.robot, result)


def _format(robot: str, result: MotorsResult) -> str:
    winding = "not stated" if result.winding_ohm is None else f"{result.winding_ohm:g} ohm"
    return (
        f"motors of '{robot}': {result.counts_per_turn:g} counts a turn of the wheel, "
        f"{result.full_speed_radps:g} rad/s at full voltage, winding {winding}; kept in "
        f"{result.file}\n"
    )
