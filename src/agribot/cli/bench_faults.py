"""`agribot bench faults`: one thing goes wrong in every drive, and the robot is judged by it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from agribot.app.workers import usable_cpus
from agribot.cli.sweep import drive_all
from agribot.cli.word_list import parse_names
from agribot.core import extras
from agribot.core.errors import ConfigError, RecordingError
from agribot.core.whole_file import write_at_once
from agribot.lab.bench import faults


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--faults", metavar="LIST", help="names such as gnss.jump,motor.dead (default: all)"
    )
    parser.add_argument(
        "--seeds", default=faults.DEFAULT_SEEDS, metavar="LIST", help="default: %(default)s"
    )
    parser.add_argument(
        "--workers", type=int, default=usable_cpus(), help="processes (default: one for each CPU)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs/faults"), metavar="DIR",
        help="what is finished there is not driven again (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--camera", action=argparse.BooleanOptionalAction,
        help="only the scenarios with a camera, or only those without (default: both)",
    )  # fmt: skip
    parser.add_argument(
        "--platform", choices=faults.PLATFORMS, default="sim",
        help="firmware: on the motor board's real program, and only what goes wrong at the board "
        "or below it (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    """Return 130 where the campaign was interrupted, else 0: its table is the result."""
    from agribot.lab.sweep.tables import SweepFolder

    names = parse_names("--faults", options.faults, faults.list_fault_names(options.platform))
    if not 1 <= options.workers <= 1024:
        raise ConfigError(f"--workers {options.workers}: must be from 1 to 1024")
    extras.require("sim", "agribot bench faults")
    scenarios = faults.choose_scenarios(names, options.camera, options.platform)
    jobs = faults.list_jobs(scenarios, options.seeds)
    folder = SweepFolder(options.out.resolve(), jobs)
    errors = drive_all(folder, faults.FaultExecutor(options.workers))
    reports = folder.read_finished()
    rows = faults.make_rows(scenarios, jobs, reports)
    result = faults.summarise_rows(rows, jobs, reports)
    table = faults.format_table(rows)
    _write(folder.path, result, table)
    sys.stdout.write(table)
    for outcome in errors:
        sys.stderr.write(f"agribot bench faults: {outcome.job.name}: {outcome.error}\n")
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    if len(reports) + len(errors) < len(jobs):
        sys.stderr.write("agribot: interrupted; finished runs are kept, the same command runs the "
                         "rest\n")  # fmt: skip
        return 130
    return int(bool(errors))


def _write(path: Path, result: dict[str, Any], table: str) -> None:
    try:
        write_at_once(path / "faults.md", table.encode())
        write_at_once(path / "faults.json", json.dumps(result, indent=1).encode() + b"\n")
    except OSError as error:
        raise RecordingError(
            f"cannot write into {path}: {error.strerror or error}; make room and run the same "
            "command again"
        ) from error
