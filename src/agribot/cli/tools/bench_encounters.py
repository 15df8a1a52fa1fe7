"""`agribot bench encounters`: people, animals and things step into the way of the robot."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from agribot.cli.tools.sweep import add_workers, drive_all, end_early
from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.lab.bench import encounters


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seeds", default=encounters.DEFAULT_SEEDS, metavar="LIST", help="default: %(default)s"
    )
    parser.add_argument(
        "--speeds", default=encounters.DEFAULT_SPEEDS, metavar="LIST",
        help="speeds of the mission, m/s (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--lidar", action=argparse.BooleanOptionalAction, default=True,
        help="the robot has a lidar (default: yes)",
    )  # fmt: skip
    add_workers(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR",
        help="what is finished there is not driven again (default: runs/encounters, or "
        "runs/encounters-no-lidar)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Return 130 where it was interrupted, else 0: its table is the result."""
    from agribot.lab.sweep.execution import ProcessExecutor
    from agribot.lab.sweep.tables import SweepFolder

    jobs = encounters.list_jobs(
        options.seeds, _read_speeds(options.speeds), has_lidar=options.lidar
    )
    extras.require("sim", "agribot bench encounters")
    ending = "" if options.lidar else "-no-lidar"
    path = options.out or Path("runs") / f"encounters{ending}"
    folder = SweepFolder(path.resolve(), jobs)
    errors = drive_all(folder, ProcessExecutor(options.workers))
    reports = folder.read_finished()
    result = encounters.summarise(reports.values())
    sys.stdout.write(encounters.format_table(result) + "\n" + encounters.describe_result(result))
    for outcome in errors:
        sys.stderr.write(f"agribot bench encounters: {outcome.job.name}: {outcome.error}\n")
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    if len(reports) + len(errors) < len(folder.jobs):
        return end_early()
    return int(bool(errors))


def _read_speeds(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as error:
        raise ConfigError(f"--speeds {text}: not numbers; write them as in 0.4,0.6") from error
