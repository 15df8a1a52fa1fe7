"""The option `--keep-misplaced`, for every command that believes labels."""

from __future__ import annotations

import argparse


def add_misplaced_option(parser: argparse._ActionsContainer) -> None:
    parser.add_argument(
        "--keep-misplaced",
        action="store_true",
        help="take pictures whose labels do not lie on their plants, too (default: they are named "
        "and left out; more than a quarter of them end the command)",
    )
