"""`agribot dataset`: draw labelled images, check any set of images and masks, split without leaks."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

from agribot.commands.counting import CountProgress
from agribot.commands.stopping import stop_on_signal
from agribot.errors import ConfigError
from agribot.workers import results, usable_cpus

LARGEST_SIDE_PX = 8192


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    generate = actions.add_parser(
        "generate",
        help="draw labelled images of random crop fields",
        epilog="example: agribot dataset generate --images 1000 --seed 1 --out fields; run it "
        "again to go on where it was stopped",
    )
    generate.add_argument("--images", type=int, required=True, metavar="N")
    generate.add_argument("--seed", type=int, default=0)
    generate.add_argument("--out", type=Path, required=True, metavar="DIR")
    generate.add_argument("--width", type=int, default=640, metavar="PX")
    generate.add_argument("--height", type=int, default=480, metavar="PX")
    generate.add_argument(
        "--supersample", type=int, default=2, metavar="K", help="K x K samples a pixel (default 2)"
    )
    generate.add_argument("--views", type=int, default=8, help="images of one field (default 8)")
    generate.add_argument("--format", choices=("png", "jpg"), default="png", help="of the images")
    generate.add_argument("--colour", action="store_true", help="red, green and blue masks as well")
    generate.add_argument(
        "--workers", type=int, default=usable_cpus(), help="processes (default: one for each CPU)"
    )
    generate.add_argument("--json", action="store_true", help="print a summary as the last line")


def run(options: argparse.Namespace) -> int:
    return _generate(options)


def _generate(options: argparse.Namespace) -> int:
    _check_ranges(options)
    from agribot.dataset.drawing import draw_field, missing_fields
    from agribot.dataset.records import Recipe, claim
    from agribot.dataset.tables import write_tables

    folder = options.out
    recipe = Recipe(
        seed=options.seed,
        width_px=options.width,
        height_px=options.height,
        supersample=options.supersample,
        views_per_field=options.views,
        format=options.format,
        colour_masks=options.colour,
    )
    claim(folder, recipe)
    jobs = missing_fields(folder, recipe, options.images)
    done = there = options.images - sum(len(job.indices) for job in jobs)
    progress = CountProgress(options.images, "images")
    started_s = time.monotonic()
    with stop_on_signal() as stop:
        progress(done)
        for drawn in results(draw_field, jobs, options.workers, lambda: bool(stop)):
            done += drawn
            progress(done)
        progress.close()
        summary = write_tables(folder, recipe)
    summary |= {"drawn_now": done - there, "wall_s": time.monotonic() - started_s}
    _show(options, {"folder": str(folder), "seed": options.seed, **summary}, _text(summary, folder))
    if done < options.images:
        sys.stderr.write(
            f"agribot dataset: interrupted after {done} of {options.images} images; all of them "
            "are complete, the same command draws the rest\n"
        )
        return 130
    return 0


def _text(summary: dict[str, Any], folder: Path) -> str:
    ratio = summary["pixel_ratio"]
    return (
        f"{summary['images']} images of {summary['fields']} fields, {summary['plants']} plants; "
        f"pixels: crop {ratio['crop']:.1%}, weed {ratio['weed']:.1%}, soil {ratio['soil']:.1%}\n"
        f"  {folder}\n"
        if summary["images"]
        else f"no image yet in {folder}\n"
    )


def _show(options: argparse.Namespace, result: dict[str, Any], text: str) -> None:
    sys.stderr.write(text)
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")


def _check_ranges(options: argparse.Namespace) -> None:
    limits = {
        "images": (1, 999_999),
        "seed": (0, math.inf),
        "width": (16, LARGEST_SIDE_PX),
        "height": (16, LARGEST_SIDE_PX),
        "supersample": (1, 4),
        "views": (1, 10_000),
        "workers": (1, 1024),
    }
    for name, (least, most) in limits.items():
        value = getattr(options, name)
        if not least <= value <= most:
            wanted = f"from {least} to {most}" if most < math.inf else f"at least {least}"
            raise ConfigError(f"--{name} {value}: must be {wanted}")
