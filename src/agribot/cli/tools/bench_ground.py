"""`agribot bench ground`: power, slip and turning of wheels on soil."""

from __future__ import annotations

import argparse
import json
import sys

from agribot.cli.ranges import check_within
from agribot.cli.standard_error import print_line
from agribot.core import extras
from agribot.core.errors import ConfigError

CLASSES = ("rigid", "firm", "tilled", "soft")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--soil", default="firm", metavar="CLASS",
        help=f"{', '.join(CLASSES)} (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--moisture", type=float, default=0.0, metavar="RATIO",
        help="0 (dry) to 1 (saturated; default: %(default)s)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    if options.soil not in CLASSES:
        classes = ", ".join(CLASSES)
        raise ConfigError(f"--soil {options.soil}: not known; there are {classes}")
    check_within("--moisture", options.moisture, 0.0, 1.0, "(dry to saturated)")
    extras.require("sim", "agribot bench ground")
    from agribot.lab.bench.ground import measure

    result = measure(options.soil, options.moisture, print_line)
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    return 0
