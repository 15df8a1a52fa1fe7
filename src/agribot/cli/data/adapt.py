"""`agribot adapt`: a network learns a field from its rows, without a label by hand."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from agribot.cli.output_names import check_ending
from agribot.cli.ranges import check_above, check_within, finite, seed
from agribot.core.config import DEFAULT_MODEL

MINUTES = 10.0  # minutes of CPU time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        type=Path,
        metavar="PHOTOS|RUN",
        help="folder of photographs of one camera that looks along several rows; or the folder of "
        "a run with recorded pictures, or its run.mcap",
    )
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="MODEL.onnx", help="the weights to write"
    )
    parser.add_argument(
        "--model",
        default=DEFAULT_MODEL,
        metavar="BASE",
        help=f"network to begin with, a name or an .onnx file (default: {DEFAULT_MODEL})",
    )
    budget = parser.add_mutually_exclusive_group()
    budget.add_argument(
        "--minutes", type=finite, default=MINUTES, help=f"CPU time in all (default: {MINUTES:g})"
    )
    budget.add_argument("--steps", type=int, help="optimiser steps, for an exact repetition")
    parser.add_argument("--seed", type=seed, default=0)
    parser.add_argument("--threads", type=int, default=1, help="CPU threads; part of the result")
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    """Raise: AgribotError: no rows to be seen, or an option out of range."""
    _check(options)
    from agribot.lab.adapt.adapting import Listener, Wanted, adapt
    from agribot.lab.adapt.field_training import Budget
    from agribot.lab.train.processes import use_threads

    use_threads(options.threads)
    budget = Budget(options.minutes, options.steps)
    wanted = Wanted(options.source, options.model, options.out, budget, options.seed)
    adapted = adapt(wanted, Listener(_print_line, _count))
    _show(adapted, options)
    return 1 if adapted.problems else 0


def _check(options: argparse.Namespace) -> None:
    check_ending("-o", options.out, "a network", ".onnx")
    options.out = options.out.with_suffix(".onnx")
    check_above("--minutes", options.minutes, 0.0)
    for name in ("steps", "threads"):
        if getattr(options, name) is not None:
            check_within(f"--{name}", getattr(options, name), 1)


def _print_line(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def _count(total: int) -> Callable[[int], None]:
    from agribot.cli.counting import CountProgress

    return CountProgress(total, "pictures")


def _show(adapted: Any, options: argparse.Namespace) -> None:
    import msgspec

    for problem in adapted.problems:
        _print_line(f"left out: {problem}")
    for name, figures in (("before", adapted.before), ("after", adapted.after)):
        _print_line(
            f"{name}, {figures.pictures} pictures kept aside: on rows {_format(figures.on_rows)}; "
            f"between rows {_format(figures.between_rows)}"
        )
    _print_line(
        f"{adapted.model}: {adapted.steps} steps, {adapted.cpu_s / 60.0:.1f} CPU-min in all; "
        f"before and after: {adapted.sheet}"
    )
    if options.json:
        sys.stdout.write(json.dumps(msgspec.to_builtins(adapted)) + "\n")


def _format(shares: dict[str, float | None] | None) -> str:
    if shares is None:
        return "no plants"
    return ", ".join(f"{name} {share:.0%}" for name, share in shares.items() if share is not None)
