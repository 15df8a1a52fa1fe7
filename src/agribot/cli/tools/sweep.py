"""`agribot sweep`: many seeds and settings of one mission, one table of their reports."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agribot.app.workers import usable_cpus
from agribot.cli.counting import CountProgress
from agribot.cli.ranges import threads
from agribot.cli.stopping import stop_on_signal
from agribot.core import extras
from agribot.lab.sweep.execution import (
    Assignment,
    Executor,
    ProcessExecutor,
    RayExecutor,
    RunOutcome,
)
from agribot.lab.sweep.plan import plan, read_seeds
from agribot.lab.sweep.tables import SweepFolder, format_markdown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("profile", nargs="?", default="farm", help="as of agribot run")
    parser.add_argument("--seeds", default="1-8", metavar="LIST", help="such as 1-8 or 1,3,10-12")
    parser.add_argument(
        "--set", action="append", default=[], metavar="A.B=C", help="any setting, for all runs"
    )
    parser.add_argument(
        "--vary", action="append", default=[], metavar="A.B=C,D", help="one run for each value"
    )
    add_workers(parser)
    parser.add_argument("--ray", metavar="ADDRESS", help="a Ray cluster instead of processes")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: runs/<UTC time>-sweep")
    parser.add_argument("--json", action="store_true", help="print the summary as the last line")


def add_workers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--workers", type=threads, default=usable_cpus(),
        help="processes (default: one for each CPU)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    if not options.ray:
        extras.require("sim", "a sweep on this machine")
    jobs = plan(options.profile, read_seeds(options.seeds), options.set, options.vary)
    executor: Executor = (
        RayExecutor(options.ray) if options.ray else ProcessExecutor(options.workers)
    )
    path = options.out or Path("runs") / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-sweep"
    result = drive(SweepFolder(path.resolve(), jobs), executor)
    if options.json:
        sys.stdout.write(json.dumps({"folder": str(path), **result}) + "\n")
    return status(result)


def drive(
    folder: SweepFolder, executor: Executor, describe_progress: Callable[[], str] = lambda: ""
) -> dict[str, Any]:
    """Run what is missing, write the tables and print them; return what sweep-report.json holds."""
    errors = drive_all(folder, executor, describe_progress)
    result = folder.write_tables(errors)
    done = f"{result['runs_ok']} of {result['runs_total']} runs good"
    files = f"{folder.path}/runs.csv, summary.csv, summary.md, sweep-report.json"
    sys.stderr.write(f"{done}\n\n{format_markdown(result['summary'])}\n{files}\n")
    return result


def status(result: dict[str, Any]) -> int:
    """Return the command's status: 0 where every run was good."""
    if result["runs_done"] + len(result["errors"]) < result["runs_total"]:
        return end_early()
    return 0 if result["runs_ok"] == result["runs_total"] else 1


def end_early() -> int:
    """Say what becomes of interrupted work; return the command's status."""
    sys.stderr.write(
        "agribot: interrupted; finished runs are kept, the same command runs the rest\n"
    )
    return 130


def drive_all(
    folder: SweepFolder, executor: Executor, describe_progress: Callable[[], str] = lambda: ""
) -> list[RunOutcome]:
    """Run what is missing; return the runs that gave no report.

    `describe_progress` is asked again and again for news of the runs that are on their way.
    """
    done = set(folder.read_finished())
    missing = [
        Assignment(job=job, out_dir=folder.run_dir(job))
        for job in folder.jobs
        if job.name not in done
    ]
    progress = CountProgress(len(folder.jobs), "runs")
    count, errors = len(done), []
    with stop_on_signal() as stop:

        def must_stop() -> bool:
            if news := describe_progress():
                progress(count, news)
            return bool(stop)

        progress(count)
        for outcome in executor.run(missing, must_stop):
            count += 1
            if outcome.report is None:
                errors.append(outcome)
                progress(count, f"{outcome.job.name}: error: {outcome.error}")
            else:
                folder.keep(outcome.job, outcome.report)
                state = "ok" if outcome.report.ok else "NOT OK"
                progress(count, f"{outcome.job.name}: {state}: {outcome.report.reason}")
        progress.close()
    return errors
