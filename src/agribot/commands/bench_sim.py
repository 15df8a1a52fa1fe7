"""`agribot bench sim`: how fast the simulator, the network and the whole robot run here."""

from __future__ import annotations

import argparse
import json
import sys

from agribot.bench.sim import FIGURES
from agribot.bench.sim import run as measure
from agribot.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--only", metavar="NAME,NAME", help=f"these figures alone: {', '.join(FIGURES)}"
    )
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    names = options.only.split(",") if options.only else []
    for name in names:
        if name not in FIGURES:
            raise ConfigError(f"--only {name}: no such figure; there are {', '.join(FIGURES)}")
    result = measure(names, _say)
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    return 0


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
