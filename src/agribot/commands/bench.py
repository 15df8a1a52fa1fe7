"""`agribot bench`: what the parts of the robot can do, measured; one benchmark per name."""

from __future__ import annotations

import argparse
import importlib

# name -> (module with add_arguments and run, one line of help, an example)
BENCHMARKS = {
    "nav": (
        "agribot.commands.bench_nav",
        "drive ROWS-10x12 on hundreds of seeds: missions, cross-track error, crushed plants",
        "agribot bench nav --sensors m8n --seeds 1-100 --json",
    ),
    "ui": (
        "agribot.commands.bench_ui",
        "serve the page to 0, 1 and 16 clients: server CPU and memory, rates, missed ticks",
        "agribot bench ui --seconds 20 --json",
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = parser.add_subparsers(dest="benchmark", metavar="BENCHMARK", required=True)
    for name, (module_name, help_line, example) in BENCHMARKS.items():
        benchmark = names.add_parser(
            name, help=help_line, description=help_line, epilog=f"example: {example}"
        )
        importlib.import_module(module_name).add_arguments(benchmark)


def run(options: argparse.Namespace) -> int:
    return int(importlib.import_module(BENCHMARKS[options.benchmark][0]).run(options))
