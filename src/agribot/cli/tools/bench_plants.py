"""`agribot bench plants`: single plants in rows that close and in carpets of weeds, by truth."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from agribot.cli.ranges import above, seed, whole
from agribot.cli.standard_error import print_line
from agribot.cli.word_list import parse_names
from agribot.core import extras
from agribot.core.config import DEFAULT_MODEL, PerceptionConfig
from agribot.core.errors import MAKE_ROOM, explain_os_error
from agribot.core.whole_file import write_at_once
from agribot.description.conditions import load_condition_preset
from agribot.lab.bench.plant_scenes import SCENES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--model", default=DEFAULT_MODEL, help="name, or path to an .onnx file")
    parser.add_argument(
        "--preset", default="field", metavar="NAME|FILE",
        help="of ground, light and sowing: kind, field, hard, or a file (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--scenes", metavar="NAME,NAME", help=f"these alone (default: {', '.join(SCENES)})"
    )
    parser.add_argument(
        "--frames", type=whole(1, 10_000), default=12, metavar="N",
        help="pictures of each scene (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--range", type=above(0.0, 10.0), default=PerceptionConfig().max_range_m, metavar="M",
        help="judge plants up to M from the point below the camera (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write plants.md and plants.json there"
    )


def run(options: argparse.Namespace) -> int:
    names = parse_names("--scenes", options.scenes, SCENES)
    extras.require("sim", "agribot bench plants")
    load_condition_preset(options.preset)
    from agribot.lab.bench import plants
    from agribot.lab.plant_table import format_table

    scenes = [SCENES[name] for name in names]
    result = plants.judge_scenes(
        scenes, options.model, options.preset, options.frames, options.seed, options.range,
        print_line,
    )  # fmt: skip
    if options.out is not None:
        _write(options.out, "plants.md", format_table(plants.list_scores(result)))
        _write(options.out, "plants.json", json.dumps(result, indent=1) + "\n")
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    return 0


def _write(folder: Path, name: str, text: str) -> None:
    with explain_os_error(f"cannot write {folder / name}", MAKE_ROOM):
        folder.mkdir(parents=True, exist_ok=True)
        write_at_once(folder / name, text.encode())
