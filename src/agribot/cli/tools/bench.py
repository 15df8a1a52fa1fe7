"""`agribot bench`: what the parts of the robot can do, measured; one benchmark per name."""

from __future__ import annotations

import argparse
import importlib

# name -> (module with add_arguments and run, one line of help, an example)
BENCHMARKS = {
    "sim": (
        "agribot.cli.tools.bench_sim",
        "CPU cost of physics, sensors, camera, network and the whole robot",
        "agribot bench sim --only physics_rtf,network_ms",
    ),
    "nav": (
        "agribot.cli.tools.bench_nav",
        "drive ROWS-10x12 on hundreds of seeds: missions, cross-track error, crushed plants",
        "agribot bench nav --sensors m8n --seeds 1-100 --json",
    ),
    "missions": (
        "agribot.cli.tools.bench_missions",
        "whole missions in the full simulator: profiles, receivers, seeds, with pixels and network",
        "agribot bench missions --profiles farm --seeds 1-2 --out runs/missions",
    ),
    "long": (
        "agribot.cli.tools.bench_long",
        "one mission of many kilometres with RTK: kilometres for each time that it needs a person",
        "agribot bench long --km 0.5 --json",
    ),
    "ground": (
        "agribot.cli.tools.bench_ground",
        "drive slopes of soil: power, slip, side slip, turning, shaking",
        "agribot bench ground --soil tilled --json",
    ),
    "faults": (
        "agribot.cli.tools.bench_faults",
        "let one thing go wrong in each drive: noticed, how soon, what was done, what it cost",
        "agribot bench faults --faults gnss.jump,motor.dead --seeds 1 --no-camera",
    ),
    "encounters": (
        "agribot.cli.tools.bench_encounters",
        "let people, animals and things step into the robot's way: who is touched, and how fast",
        "agribot bench encounters --seeds 1-4 --json",
    ),
    "perception": (
        "agribot.cli.tools.bench_perception",
        "time every network end to end, the original's beside them",
        "agribot bench perception --size 800x608 --json",
    ),
    "closed-loop": (
        "agribot.cli.tools.bench_closed_loop",
        "drive fields and judge what the network sees, by crop, growth and light",
        "agribot bench closed-loop --fields beet,farm --lights noon",
    ),
    "in-row": (
        "agribot.cli.tools.bench_in_row",
        "drive a weedy row: what names of plants and rules of the tool leave in it",
        "agribot bench in-row --seeds 1-3 --json",
    ),
    "plants": (
        "agribot.cli.tools.bench_plants",
        "find single plants by their stems: rows that close, carpets of weeds, other crops",
        "agribot bench plants --scenes beet-7-9,weeds-90 --preset kind --json",
    ),
    "ui": (
        "agribot.cli.tools.bench_ui",
        "serve the page to 0, 1 and 16 clients: server CPU and memory, rates, missed ticks",
        "agribot bench ui --seconds 20 --json",
    ),
    "all": (
        "agribot.cli.tools.bench_all",
        "every benchmark in its short form",
        "agribot bench all --json",
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = parser.add_subparsers(dest="benchmark", metavar="BENCHMARK", required=True)
    for name, (module_name, help_line, example) in BENCHMARKS.items():
        benchmark = names.add_parser(
            name, help=help_line, description=help_line, epilog=f"example: {example}"
        )
        add_options(benchmark, module_name)


def add_options(parser: argparse.ArgumentParser, module_name: str) -> None:
    """Add the options of a benchmark, and those that all of them have."""
    importlib.import_module(module_name).add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    return int(importlib.import_module(BENCHMARKS[options.benchmark][0]).run(options))
