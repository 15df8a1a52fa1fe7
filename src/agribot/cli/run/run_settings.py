"""The settings of a run as options: what `agribot run` and `agribot sim` have in common."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from agribot.app.calibration.robot_file import RobotFile
from agribot.app.world_rows import take_world_rows
from agribot.cli.ranges import finite, seed
from agribot.cli.run.origin import HELP, apply_origin
from agribot.core import config
from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError
from agribot.core.home import find_home
from agribot.core.platforms import find_platform

# Option and the setting that it is short for.
_SHORT_FOR = {
    "world": "world",
    "robot": "robot",
    "waypoints": "waypoints",
    "plan": "plan",
    "keep_out": "field.keep_out",
    "task": "task",
    "seed": "seed",
    "platform": "platform",
    "sensors": "sim.sensors",
    "preset": "sim.preset",
    "duration_s": "duration_s",
}


def add_setting_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "profile", nargs="?", default="farm", help="packaged profile or .toml file (default: farm)"
    )
    parser.add_argument("--world", metavar="NAME|FILE", help="empty, Farm, ... or an SDF file")
    parser.add_argument(
        "--robot",
        metavar="NAME|FILE",
        help="another robot description; arguments of a xacro "
        "follow it: 'rover.urdf.xacro wheels:=4'",
    )
    parser.add_argument(
        "--sensors",
        metavar="PRESET",
        help="rtk, rtk-1, rtk-dual, rtk-trees, m8n, m8n-1, m8n-urban, legacy, seed, ideal",
    )
    parser.add_argument(
        "--preset",
        metavar="NAME|FILE",
        help="how the world differs from its map and from seed to seed: kind, field, hard",
    )
    parser.add_argument("--seed", type=seed, metavar="N", help="of all randomness (default: 0)")
    parser.add_argument(
        "--for", dest="duration_s", type=finite, metavar="SECONDS", help="stop after"
    )
    parser.add_argument(
        "--fault", action="append", default=[], metavar="NAME[=VALUE]@T[~RISE][+SECONDS]",
        help="let something go wrong in the simulation at T, in seconds (docs/faults.md)",
    )  # fmt: skip
    parser.add_argument("--origin", metavar="ORIGIN", help=HELP)
    parser.add_argument("--set", action="append", default=[], metavar="A.B=C", help="any setting")


def read_settings(
    options: argparse.Namespace,
    profile: str | None = None,
    before: Sequence[str] = (),
    after: Sequence[str] = (),
) -> RunConfig:
    """Read the settings; an option counts more than `--set`, `before` least and `after` most.

    What was measured of the robot comes from its own file, but not into a run that goes on.

    Raises: ConfigError: a setting that does not exist or does not fit.
    """
    named = {setting: getattr(options, name, None) for name, setting in _SHORT_FOR.items()}
    assigned = [
        f"{setting}={msgspec.json.encode(value).decode()}"
        for setting, value in named.items()
        if value is not None
    ]
    wanted = [*before, *options.set, *assigned, *after]
    if profile is not None:
        if options.origin is not None:
            raise ConfigError("--origin: a run that goes on keeps its map; begin another for it")
        return _add_faults(config.load(profile, wanted), options)
    own = RobotFile(find_home(), config.load(options.profile, wanted).robot)
    measured = own.settings()
    if measured:
        sys.stderr.write(f"measured of this robot, from {own.path}: {', '.join(measured)}\n")
    wanted = [*before, *measured, *options.set, *assigned, *after]
    is_stated = config.is_stated("field.datum", options.profile, wanted)
    settings = apply_origin(config.load(options.profile, wanted), options, is_stated=is_stated)
    return _add_faults(_take_world_rows(settings), options)


def _take_world_rows(settings: RunConfig) -> RunConfig:
    """Take the field of a world that is not the profile's, and report it."""
    taken = take_world_rows(settings)
    field = taken.field
    if settings.field.from_world and find_platform(settings.platform).is_simulated:
        east_m, north_m = field.first_row_start_map_m
        sys.stderr.write(
            f"field of world '{settings.world}': {field.row_count} rows of "
            f"{field.row_length_m:.4g} m, {field.row_pitch_m:.4g} m apart, the first from East "
            f"{east_m:.4g} m, North {north_m:.4g} m\n"
        )
    return taken


def _add_faults(settings: RunConfig, options: argparse.Namespace) -> RunConfig:
    return msgspec.structs.replace(settings, faults=(*settings.faults, *options.fault))


def choose_out_dir(wanted: str | Path | None, kind: str) -> Path:
    """Choose the folder of a run: the requested one, or a new one named by the time."""
    if wanted is not None:
        return Path(wanted)
    folder, number = Path("runs") / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{kind}", 1
    while folder.exists():
        number += 1
        folder = folder.with_name(f"{folder.name.removesuffix(f'-{number - 1}')}-{number}")
    return folder
