"""`agribot bench sim`: how fast the simulator, the network and the whole robot run here."""

from __future__ import annotations

import argparse
import json
import sys

from agribot.cli.word_list import words_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from agribot.lab.bench.sim import FIGURES

    parser.add_argument(
        "--only", metavar="NAME,NAME", help=f"these figures alone: {', '.join(FIGURES)}"
    )
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    from agribot.lab.bench.sim import FIGURES, measure

    result = measure(words_of("--only", options.only, FIGURES), _say)
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    return 0


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
