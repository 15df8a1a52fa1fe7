"""`agribot foxglove`: a run that Foxglove watches; it cannot move the robot."""

from __future__ import annotations

import argparse

from agribot.cli.run import run as run_command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    run_command.add_arguments(parser)
    parser.set_defaults(foxglove=True)


def run(options: argparse.Namespace) -> int:
    return run_command.run(options)
