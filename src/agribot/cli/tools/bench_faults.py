"""`agribot bench faults`: things go wrong in every drive, and the robot is judged by it."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from agribot.cli.ranges import check_within
from agribot.cli.tools import bench_fault_matrix
from agribot.cli.tools.result_files import read_page, write_result
from agribot.cli.tools.sweep import add_workers, drive_all, end_early
from agribot.cli.word_list import parse_names
from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.lab.bench import faults
from agribot.lab.bench.fault_rows import FaultRow, make_rows, summarise_rows
from agribot.lab.bench.fault_tables import (
    describe_result,
    format_open,
    format_table,
    rewrite_block,
    rewrite_rows,
)
from agribot.lab.bench.faults import FaultScenario
from agribot.lab.sweep.plan import SweepJob

MOST_DRIVES = 100_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    bench_fault_matrix.add_arguments(parser)
    parser.add_argument(
        "--in-row", action="store_true",
        help="instead of the matrix, drives into a row in which one thing fails for good; so do "
        "--special, --fault-free, --camera, --no-camera and --platform",
    )  # fmt: skip
    parser.add_argument(
        "--faults", metavar="LIST", help="names such as gnss.jump,motor.dead (default: all)"
    )
    parser.add_argument(
        "--seeds", metavar="LIST",
        help=f"default: {bench_fault_matrix.DEFAULT_SEEDS}, in a row {faults.DEFAULT_SEEDS}",
    )  # fmt: skip
    parser.add_argument(
        "--special", action="store_true",
        help="only the cases that are looked at one by one, and two sensors that lie at once",
    )  # fmt: skip
    parser.add_argument(
        "--fault-free", type=int, metavar="N",
        help="N drives in which nothing goes wrong, in turns of the campaign's drives: false "
        "alarms and kilometres; without a camera unless --camera is given",
    )  # fmt: skip
    add_workers(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR",
        help="what is finished there is not driven again (default: runs/fault-matrix; in a row "
        "runs/faults with what is chosen, such as runs/faults-special-no-camera)",
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
    parser.add_argument(
        "--markdown", type=Path, metavar="PAGE",
        help="put the summary and what is open into their place on a page such as "
        "docs/results/faults-matrix.md, and all cells into the .csv file beside it",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Return 130 where the campaign was interrupted, else 0: its table is the result."""
    if not is_in_row(options):
        return bench_fault_matrix.run(options)
    if options.all or options.shard:
        raise ConfigError("--all and --shard are of the matrix; leave out what drives in a row")
    options.seeds = options.seeds or faults.DEFAULT_SEEDS
    return _run_in_row(options)


def is_in_row(options: argparse.Namespace) -> bool:
    """Whether drives into a row are asked for, and not the matrix."""
    is_free = options.fault_free is not None
    is_other = options.camera is not None or options.platform != "sim"
    return bool(options.in_row or options.special or is_free or is_other)


def _run_in_row(options: argparse.Namespace) -> int:
    from agribot.lab.sweep.tables import SweepFolder

    scenarios, jobs = _choose(options)
    extras.require("sim", "agribot bench faults")
    page = None if options.markdown is None else read_page(options.markdown, _name(options))
    path = options.out or Path("runs") / f"faults{_find_ending(options)}"
    folder = SweepFolder(path.resolve(), jobs)
    jobs = folder.jobs
    errors = drive_all(folder, faults.FaultExecutor(options.workers))
    reports = folder.read_finished()
    rows = make_rows(scenarios, jobs, reports)
    result = summarise_rows(rows, jobs, reports)
    table = format_table(rows)
    write_result(folder.path / "faults.md", table)
    write_result(folder.path / "faults.json", json.dumps(result, indent=1) + "\n")
    sys.stdout.write(f"{table}\n{describe_result(result)}")
    for outcome in errors:
        sys.stderr.write(f"agribot bench faults: {outcome.job.name}: {outcome.error}\n")
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    if len(reports) + len(errors) < len(jobs):
        return end_early()
    if page is not None:
        summary = f"`{_write_command(options)}`: {describe_result(result)}"
        _publish(options.markdown, page, _name(options), summary, rows)
    return int(bool(errors))


def _publish(path: Path, page: str, name: str, summary: str, rows: Sequence[FaultRow]) -> None:
    """Write the rows into the CSV file beside a page, and what they sum up to into the page."""
    table = path.with_suffix(".csv")
    kept = table.read_text(encoding="utf-8") if table.exists() else ""
    write_result(table, rewrite_rows(kept, name, rows))
    write_result(path, rewrite_block(page, name, f"{summary}\n{format_open(rows)}"))


def _choose(options: argparse.Namespace) -> tuple[tuple[FaultScenario, ...], tuple[SweepJob, ...]]:
    """Choose what is driven, each scenario and each run of it."""
    names = parse_names("--faults", options.faults, faults.list_fault_names(options.platform))
    count = options.fault_free
    if count is None:
        scenarios = faults.choose_scenarios(
            names, options.camera, options.platform, is_special=options.special
        )
        return scenarios, faults.list_jobs(scenarios, options.seeds)
    check_within("--fault-free", count, 1, MOST_DRIVES)
    if options.faults or options.special:
        raise ConfigError("--fault-free: nothing goes wrong there; leave out --faults, --special")
    return faults.list_drives(count, options.camera, options.platform)


def _name(options: argparse.Namespace) -> str:
    """Name the block of the page that a campaign fills."""
    camera = " with camera" if options.camera else ""
    if options.fault_free is not None:
        return f"drives without a fault{camera}"
    if options.platform != "sim":
        return str(options.platform)
    if options.special:
        return "special cases"
    if options.camera is None:
        raise ConfigError("--markdown: give --camera or --no-camera; each has a table of its own")
    return "camera" if options.camera else "no camera"


def _find_ending(options: argparse.Namespace) -> str:
    """Distinguish campaigns by the ends of their folders' names."""
    is_free = options.fault_free is not None
    words = ["free"] if is_free else ["special"] if options.special else []
    words += [options.platform] if options.platform != "sim" else []
    if options.camera is not None:
        words.append("camera" if options.camera else "no-camera")
    return "".join(f"-{word}" for word in words)


def _write_command(options: argparse.Namespace) -> str:
    """Write the command that repeats a campaign."""
    words = ["agribot bench faults"]
    words += [f"--platform {options.platform}"] if options.platform != "sim" else []
    words += ["--special"] if options.special else []
    words += [f"--faults {options.faults}"] if options.faults else []
    is_free = options.fault_free is not None
    words += [f"--fault-free {options.fault_free}" if is_free else f"--seeds {options.seeds}"]
    if options.camera is not None:
        words += ["--camera" if options.camera else "--no-camera"]
    return " ".join(words)
