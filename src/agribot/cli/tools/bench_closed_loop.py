"""`agribot bench closed-loop`: what the network sees while the robot drives, judged by truth."""

from __future__ import annotations

import argparse
import json
import sys

from agribot.cli.ranges import check_within, finite
from agribot.cli.standard_error import print_line
from agribot.cli.word_list import parse_names
from agribot.core.config import DEFAULT_MODEL
from agribot.core.errors import ConfigError
from agribot.description.conditions import load_condition_preset
from agribot.lab.sweep.plan import read_seeds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from agribot.lab.bench import closed_loop

    parser.add_argument(
        "--fields",
        default=",".join(closed_loop.FIELDS),
        metavar="NAME,NAME",
        help="default: all, %(default)s",
    )
    parser.add_argument(
        "--lights",
        default=",".join(closed_loop.LIGHTS),
        metavar="NAME,NAME",
        help="default: all, %(default)s",
    )
    parser.add_argument(
        "--heights",
        default=",".join(f"{ratio:g}" for ratio in closed_loop.HEIGHT_RATIOS),
        metavar="R,R",
        help="growth, times the middle height of the crop (default: %(default)s)",
    )
    parser.add_argument("--seeds", default="1", metavar="LIST", help="such as 1-4")
    parser.add_argument("--seconds", type=finite, default=25.0, metavar="S", help="of each drive")
    parser.add_argument(
        "--preset", default=closed_loop.PRESET, metavar="NAME|FILE",
        help="how ground, plants and camera differ from seed to seed; light and growth are the "
        "benchmark's own (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--model", default=DEFAULT_MODEL, help="name, or path to an .onnx file")


def run(options: argparse.Namespace) -> int:
    """Return 1 where the beet field was driven and the network missed its limits."""
    from agribot.lab.bench import closed_loop

    fields = parse_names("--fields", options.fields, closed_loop.FIELDS)
    lights = parse_names("--lights", options.lights, closed_loop.LIGHTS)
    try:
        ratios = [float(word) for word in options.heights.split(",")]
    except ValueError as error:
        raise ConfigError(
            f"--heights {options.heights}: not numbers; write them as in 0.5,1"
        ) from error
    for ratio in ratios:
        check_within("--heights", ratio, 0.2, 3.0)
    check_within("--seconds", options.seconds, 1.0, 3600.0)
    load_condition_preset(options.preset)
    wanted = closed_loop.conditions(fields, lights, ratios, read_seeds(options.seeds))
    result = closed_loop.run_conditions(
        wanted, options.seconds, options.model, print_line, options.preset
    )
    print_line("\n" + closed_loop.format_table(result))
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    return 0 if closed_loop.meets_limits(result) else 1
