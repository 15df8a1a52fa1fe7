"""`agribot ros1`: a run that is a ROS 1 node."""

from __future__ import annotations

import argparse

from agribot.cli.run import run as run_command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    run_command.add_arguments(parser)
    parser.set_defaults(ros1=True)


def run(options: argparse.Namespace) -> int:
    return run_command.run(options)
