"""The option `--ids`, for every command that reads masks; apart, so that help loads no pictures."""

from __future__ import annotations

import argparse


def add_ids_option(parser: argparse._ActionsContainer) -> None:
    parser.add_argument(
        "--ids",
        metavar="0=soil,1=crop,2=weed",
        help="what the values of the masks mean, or their colours: 000000=soil,800000=crop "
        "(default: what a labelmap.txt or another table of colours beside them says; else 0 weed, "
        "1 crop, 2 soil, 255 ignored, or red, green and black or blue)",
    )
