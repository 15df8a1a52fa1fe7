"""The options of `agribot train` for images that the simulator draws."""

from __future__ import annotations

import argparse
from pathlib import Path

from agribot.core.errors import ConfigError


def add_drawn_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--variety",
        choices=("standard", "wide"),
        default="standard",
        help="wide: all species, and soil with residue, stones and wet patches",
    )
    group.add_argument("--images", type=int, default=2000, help="to train on")
    group.add_argument(
        "--row-images",
        type=int,
        metavar="N",
        help="as many of them from the robot's camera along rows (default: half)",
    )
    group.add_argument(
        "--turn-images",
        type=int,
        metavar="N",
        help="as many of them from the robot's camera in turns beside rows (default: 1 of 6)",
    )
    group.add_argument("--test-images", type=int, default=120, help="of each test set")
    group.add_argument("--cache", type=Path, help="where they lie (default: OUT/images)")


def check_drawn_options(args: argparse.Namespace) -> None:
    """Fill in shares that were left out.

    Raises: ConfigError: a count that is out of range.
    """
    if args.with_sim < 0 or (args.with_sim and args.data == "sim"):
        raise ConfigError(
            f"--with-sim {args.with_sim}: a number of images to add to photographs; leave it out "
            "with --data sim"
        )
    if args.row_images is None:
        args.row_images = args.images // 2
    if args.turn_images is None:
        args.turn_images = args.images // 6
    for option in ("row_images", "turn_images"):
        if not 0 <= (count := getattr(args, option)) <= args.images:
            flag = option.replace("_", "-")
            raise ConfigError(f"--{flag} {count}: must be from 0 to --images")
    if (on_robot := args.row_images + args.turn_images) > args.images:
        raise ConfigError(
            f"--row-images and --turn-images ask for {on_robot} of the {args.images} of --images; "
            "give more images, or fewer of these"
        )
