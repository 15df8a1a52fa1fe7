"""`agribot bench in-row`: names of plants or rules of the tool, what leaves weeds in the row."""

from __future__ import annotations

import argparse
import json
import sys

import msgspec

from agribot.cli.ranges import check_within, finite
from agribot.cli.standard_error import print_line
from agribot.core import extras
from agribot.core.config import DEFAULT_MODEL
from agribot.lab.sweep.plan import read_seeds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", default="1", metavar="LIST", help="such as 1-4")
    parser.add_argument(
        "--length", type=finite, default=12.0, metavar="M", help="of the row (default: %(default)s)"
    )
    parser.add_argument(
        "--seconds", type=finite, default=None, metavar="S",
        help="of each drive (default: to the end of the row)",
    )  # fmt: skip
    parser.add_argument("--model", default=DEFAULT_MODEL, help="name, or path to an .onnx file")


def run(options: argparse.Namespace) -> int:
    """Return 1 where the shipped rules hit a crop with the shipped network."""
    extras.require("sim", "agribot bench in-row")
    from agribot.lab.bench import in_row

    check_within("--length", options.length, 2.0, 100.0, "m")
    if options.seconds is not None:
        check_within("--seconds", options.seconds, 1.0, 3600.0)
    drives = []
    for seed in read_seeds(options.seeds):
        outcomes = in_row.drive_row(seed, options.length, options.model, options.seconds)
        print_line(f"seed {seed}\n{in_row.format_table(outcomes)}\n")
        drives.append((seed, outcomes))
    pooled = in_row.pool([outcome for _, outcomes in drives for outcome in outcomes])
    if len(drives) > 1:
        print_line(f"all seeds\n{in_row.format_table(pooled)}")
    if options.json:
        result = {
            "model": options.model,
            "drives": [
                {"seed": seed, "tools": msgspec.to_builtins(outcomes)} for seed, outcomes in drives
            ],
            "pooled": msgspec.to_builtins(pooled),
        }
        sys.stdout.write(json.dumps(result) + "\n")
    return int(pooled[0].crops_hit > 0)
