"""`agribot calibrate camera --rows`: the camera's mount from pictures of rows of known distance."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from agribot.cli.ranges import check_within
from agribot.core.config import DEFAULT_MODEL
from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    from agribot.app.calibration.row_mount import RowMountResult

LENS_DEG = (20.0, 150.0)
SPACING_M = (0.1, 3.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `agribot calibrate camera` that go with --rows."""
    group = parser.add_argument_group("rows of known distance")
    group.add_argument(
        "--rows",
        action="store_true",
        help="find height, pitch and roll by the rows in pictures, without any drive",
    )
    group.add_argument("--pictures", type=Path, metavar="DIR", help="of a camera along rows")
    group.add_argument(
        "--row-spacing", type=float, metavar="M", help="default: that of the recording's field"
    )
    group.add_argument(
        "--lens-deg", type=float, metavar="DEG",
        help="horizontal angle of the lens (default: the robot's camera)",
    )  # fmt: skip
    group.add_argument("--model", default=DEFAULT_MODEL, help="network that finds plants on soil")


def calibrate_by_rows(options: argparse.Namespace) -> tuple[RowMountResult, str]:
    """Find the mount by the rows in a folder of pictures or in a recording.

    Raises: ConfigError: options that are missing, out of range, or of no use here.
    """
    from agribot.app.calibration.row_mount import (
        calibrate_row_mount,
        format_row_mount,
        list_pictures,
        open_recording,
    )
    from agribot.autonomy.perceive.segmenter import Segmenter
    from agribot.description.loader import load_robot
    from agribot.record.picture_files import read_pictures

    if (options.pictures is None) == (options.recording is None):
        raise ConfigError("--rows needs pictures; give either --pictures DIR or --recording FILE")
    spacing_m = _check("--row-spacing", options.row_spacing, SPACING_M)
    lens_deg = _check("--lens-deg", options.lens_deg, LENS_DEG)
    network = Segmenter(options.model)
    if options.recording is not None:
        robot, config, pictures = open_recording(Path(options.recording))
        if spacing_m is None and config.field.row_count > 1:
            spacing_m = config.field.row_pitch_m
    else:
        robot = load_robot(options.robot)
        pictures = list(read_pictures(list_pictures(options.pictures)))
    if spacing_m is None:
        raise ConfigError("--rows needs the distance from row to row; give --row-spacing M")
    lens_rad = None if lens_deg is None else math.radians(lens_deg)
    result = calibrate_row_mount(pictures, network, robot, spacing_m, lens_rad)
    return result, format_row_mount(result)


def check_options(options: argparse.Namespace) -> None:
    """Refuse options that need --rows where it is not given.

    Raises: ConfigError: there is one.
    """
    given = ("pictures", "row_spacing", "lens_deg")
    for name in given:
        if not options.rows and getattr(options, name) is not None:
            raise ConfigError(f"--{name.replace('_', '-')} goes with --rows; add it")


def _check(name: str, value: float | None, limits: tuple[float, float]) -> float | None:
    if value is not None:
        check_within(name, value, *limits)
    return value
