"""`agribot bench perception`: what a picture costs each network, end to end."""

from __future__ import annotations

import argparse
import json
import sys

from agribot.cli.ranges import check_within, threads
from agribot.cli.word_list import parse_names
from agribot.lab.bench.perception import HEIGHT_PX, NETWORKS, WIDTH_PX, format_table
from agribot.lab.bench.perception import time_networks as measure
from agribot.lab.train.networks import STRIDE_PX, read_size


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--networks", metavar="NAME,NAME", help=f"these alone (default: {', '.join(NETWORKS)})"
    )
    parser.add_argument("--size", default=f"{WIDTH_PX}x{HEIGHT_PX}", metavar="WxH", help="px")
    parser.add_argument("--threads", type=threads, default=2)
    parser.add_argument("--frames", type=int, default=30, help="pictures for each network")


def run(options: argparse.Namespace) -> int:
    networks = parse_names("--networks", options.networks, NETWORKS)
    for option, most in (("threads", 256), ("frames", 10_000)):
        check_within(f"--{option}", getattr(options, option), 1, most)
    result = measure(networks, options.threads, options.frames, read_size(options.size, STRIDE_PX))
    sys.stderr.write(format_table(result) + "\n")
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    return 0
