"""`agribot bench missions`: every profile over many seeds in the full simulator, one table."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from agribot.cli.tools.sweep import add_workers, drive, status
from agribot.cli.word_list import parse_names
from agribot.core import extras
from agribot.description.conditions import load_condition_preset
from agribot.lab.bench import missions
from agribot.lab.sweep.plan import read_seeds

PROFILES = tuple(dict.fromkeys(case.profile for case in missions.CASES))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--profiles", default=",".join(PROFILES), metavar="LIST", help="default: all, %(default)s"
    )
    parser.add_argument(
        "--seeds",
        metavar="LIST",
        help="such as 1-3 (default: 10; 20 of rows-10x12 and farm with rtk, 5 of beet)",
    )
    parser.add_argument(
        "--preset", default=missions.PRESET, metavar="NAME|FILE",
        help="of the worlds: kind, field, hard, or a file (default: %(default)s)",
    )  # fmt: skip
    add_workers(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("runs/missions"), metavar="DIR",
        help="what is finished there is not driven again (default: %(default)s)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Return 1 where a mission failed or the cross-track error is above its limit."""
    from agribot.lab.sweep.execution import ProcessExecutor
    from agribot.lab.sweep.tables import SweepFolder

    profiles = parse_names("--profiles", options.profiles, PROFILES)
    extras.require("sim", "agribot bench missions")
    load_condition_preset(options.preset)
    seeds = read_seeds(options.seeds) if options.seeds else None
    wanted = missions.list_jobs(profiles, seeds, options.preset)
    result = drive(SweepFolder(options.out.resolve(), wanted), ProcessExecutor(options.workers))
    short = missions.find_shortfalls(result["summary"])
    for line in short:
        sys.stderr.write(f"agribot bench missions: {line}\n")
    if options.json:
        sys.stdout.write(json.dumps({"folder": str(options.out), **result, "short": short}) + "\n")
    return status(result) or int(bool(short))
