"""`agribot calibrate`: what a drive tells of wheels, compass, antenna and camera."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from agribot import config as settings
from agribot.calibration.camera import (
    CameraResult,
    RowViewResult,
    Seen,
    camera_of,
    camera_text,
    row_view_of,
    row_view_text,
    seen_in_recording,
)
from agribot.calibration.figure import FIGURE, TURNS, Drive, Motion, drive_figure, gain
from agribot.calibration.sensors import (
    AntennaResult,
    MagResult,
    antenna_of_drive,
    antenna_text,
    magnetometer_of_drive,
    magnetometer_of_recording,
    magnetometer_text,
)
from agribot.calibration.wheels import WheelsResult, judge, wheels_text
from agribot.commands.calibration_camera import seen_in_drive, toml
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.estimate.drive_fit import TAPE_STD_M, fit_drive
from agribot.robot import DriveSpec, RobotSpec
from agribot.sim.platform import SimPlatform
from agribot.sim.random_streams import stream

Outcome = tuple[WheelsResult | MagResult | AntennaResult | CameraResult | RowViewResult, str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    subjects = parser.add_subparsers(dest="subject", metavar="WHAT", required=True)
    drive = subjects.add_parser("drive", help="wheel radius and effective separation")
    for parser_of in (
        drive,
        subjects.add_parser("magnetometer", help="the robot's own iron, hard and soft"),
        subjects.add_parser("antenna", help="where the GNSS antenna sits"),
    ):
        _add_common(parser_of)
    camera = subjects.add_parser("camera", help="pitch, yaw, roll and height of its mount")
    row_view = subjects.add_parser("row-view", help="whether rows are seen where they stand")
    for parser_of, profile in ((camera, "farm"), (row_view, "rows-10x12")):
        _add_robot(parser_of)
        parser_of.add_argument(
            "--profile", default=profile, metavar="NAME|FILE",
            help="whose mission is driven for a while (default: %(default)s)",
        )  # fmt: skip
    for name in ("magnetometer", "camera", "row-view"):
        subjects.choices[name].add_argument(
            "--recording", metavar="FILE", help="of a mission that turned, instead of a drive"
        )
    drive.add_argument(
        "--tape",
        action="store_true",
        help="measure the legs by tape (simulated: to 1 cm), where GNSS is too coarse",
    )


def _add_common(drive: argparse.ArgumentParser) -> None:
    drive.add_argument("--world", default="empty", metavar="NAME|FILE", help="needs 8 m x 8 m")
    _add_robot(drive)


def _add_robot(drive: argparse.ArgumentParser) -> None:
    drive.add_argument("--robot", default="agribot", metavar="NAME|FILE", help="to be calibrated")
    drive.add_argument(
        "--machine",
        metavar="NAME|FILE",
        help="build the simulated machine from this description instead, to see an error found",
    )
    drive.add_argument("--sensors", default="rtk", metavar="PRESET", help="default: rtk")
    drive.add_argument("--seed", type=int, default=0, metavar="N", help="of all randomness")
    drive.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    robot = load_robot(options.robot)
    machine = load_robot(options.machine) if options.machine else robot
    runners: dict[str, Callable[[argparse.Namespace, RobotSpec, RobotSpec], Outcome]] = {
        "drive": _wheels, "magnetometer": _magnetometer, "antenna": _antenna,
        "camera": _camera, "row-view": _row_view,
    }  # fmt: skip
    result, text = runners[options.subject](options, robot, machine)
    sys.stderr.write(text)
    if options.json:
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
    return 0 if result.ok else 1


def _wheels(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Outcome:
    described = _drive(options, machine, robot.drive)
    told = _drive(options, machine, robot.drive.told())
    fit = fit_drive(described.batches, described.stretches)
    result = judge(robot.drive, fit, gain(described, fit), gain(told, fit))
    return result, wheels_text(robot.drive, result)


def _magnetometer(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Outcome:
    if options.recording:
        result = magnetometer_of_recording(Path(options.recording))
    else:
        result = magnetometer_of_drive(_drive(options, machine, robot.drive, TURNS), 0.0)
    return result, magnetometer_text(result)


def _antenna(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Outcome:
    result = antenna_of_drive(_drive(options, machine, robot.drive, TURNS), robot)
    return result, antenna_text(result)


def _camera(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Outcome:
    result = camera_of(_seen(options, robot, machine))
    return result, camera_text(result)


def _row_view(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Outcome:
    result = row_view_of(_seen(options, robot, machine))
    return result, row_view_text(result)


def _seen(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Seen:
    if options.recording:
        return seen_in_recording(Path(options.recording))
    return seen_in_drive(robot, machine, options.profile, options.sensors, options.seed)


def _drive(
    options: argparse.Namespace,
    machine: RobotSpec,
    board: DriveSpec,
    figure: Sequence[Motion] = FIGURE,
) -> Drive:
    """Drive the figure with a machine whose motor board believes in the geometry `board`."""
    config = settings.load(
        "farm",
        [
            "perception.enabled=false",
            f"sim.sensors={toml(options.sensors)}",
            f"seed={toml(options.seed)}",
        ],
    )
    platform = SimPlatform(config, machine, load_world(options.world), board=board)
    rng = stream(options.seed, "tape")

    def tape() -> tuple[float, float]:
        truth = platform.truth()
        x_error_m, y_error_m = (TAPE_STD_M / math.sqrt(2.0) * rng.standard_normal(2)).tolist()
        return truth.x_map_m + x_error_m, truth.y_map_m + y_error_m

    try:
        uses_tape = options.subject == "drive" and options.tape
        return drive_figure(platform, board, tape if uses_tape else None, figure)
    finally:
        platform.close()
