"""`agribot bench sim`: how fast the simulator, the network and the whole robot run here."""

from __future__ import annotations

import argparse
import json
import sys

from agribot.cli.standard_error import print_line
from agribot.cli.word_list import parse_names


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from agribot.lab.bench.sim import FIGURES

    parser.add_argument(
        "--only", metavar="NAME,NAME", help=f"these figures alone: {', '.join(FIGURES)}"
    )


def run(options: argparse.Namespace) -> int:
    from agribot.lab.bench.sim import FIGURES, measure

    result = measure(parse_names("--only", options.only, FIGURES), print_line)
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    return 0
