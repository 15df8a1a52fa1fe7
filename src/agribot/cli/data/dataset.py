"""`agribot dataset`: draw, import, check, split sets of images and masks, label them by rows."""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path
from typing import Any

import msgspec

from agribot.app.workers import results, usable_cpus
from agribot.cli.counting import CountProgress
from agribot.cli.data.dataset_check import (
    add_check,
    add_folder,
    check_set,
    find_layout_of,
    print_result,
)
from agribot.cli.data.dataset_import import add_import, import_files
from agribot.cli.data.dataset_rows import add_label_by_rows, label_by_rows
from agribot.cli.output_names import check_ending
from agribot.cli.ranges import check_within, seed
from agribot.cli.stopping import stop_on_signal
from agribot.core.errors import explain_os_error
from agribot.core.whole_file import write_at_once

LARGEST_SIDE_PX = 8192


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    _add_generate(actions)
    add_check(actions)
    _add_split(actions)
    add_import(actions)
    add_label_by_rows(actions)


def _add_generate(actions: Any) -> None:
    generate = actions.add_parser(
        "generate",
        help="draw labelled images of random crop fields",
        epilog="example: agribot dataset generate --images 1000 --seed 1 --out fields; run it "
        "again to go on where it was stopped",
    )
    generate.add_argument("--images", type=int, required=True, metavar="N")
    generate.add_argument("--seed", type=seed, default=0)
    generate.add_argument("--out", type=Path, required=True, metavar="DIR")
    generate.add_argument("--width", type=int, default=640, metavar="PX")
    generate.add_argument("--height", type=int, default=480, metavar="PX")
    generate.add_argument(
        "--supersample", type=int, default=2, metavar="K", help="K x K samples a pixel (default 2)"
    )
    generate.add_argument("--views", type=int, default=8, help="images of one field (default 8)")
    generate.add_argument("--format", choices=("png", "jpg"), default="png", help="of the images")
    generate.add_argument(
        "--variety",
        choices=("standard", "wide", "seedlings"),
        default="standard",
        help="wide: all species, and soil with residue, stones and wet patches; seedlings: young "
        "carrots or parsley among weeds, close from above, in red and near infrared",
    )
    generate.add_argument("--colour", action="store_true", help="red, green and blue masks as well")
    generate.add_argument(
        "--workers", type=int, default=usable_cpus(), help="processes (default: one for each CPU)"
    )
    generate.add_argument("--json", action="store_true", help="print a summary as the last line")


def _add_split(actions: Any) -> None:
    split = actions.add_parser(
        "split",
        help="training, validation and test sets that share no field or day",
        epilog="example: agribot dataset split fields --by field --ratios 70,15,15 -o split.json",
    )
    add_folder(split)
    split.add_argument("--by", choices=("field", "day", "image"), default="field")
    split.add_argument("--ratios", default="70,15,15", metavar="TRAIN,VAL,TEST")
    split.add_argument("--seed", type=seed, default=0)
    split.add_argument("-o", "--out", type=Path, required=True, metavar="FILE")


def run(options: argparse.Namespace) -> int:
    actions = {
        "generate": _generate,
        "check": check_set,
        "split": _split,
        "import": import_files,
        "label-by-rows": label_by_rows,
    }
    return actions[options.action](options)


def _split(options: argparse.Namespace) -> int:
    from agribot.lab.dataset.split import PARTS, read_ratios, split

    ratios = read_ratios(options.ratios)
    check_within("--seed", options.seed, 0)
    check_ending("-o", options.out, "JSON", ".json")
    layout = find_layout_of(options)
    result = split(layout, options.by, ratios, options.seed)
    with explain_os_error(f"cannot write {options.out}", "choose another -o file"):
        data = msgspec.json.format(msgspec.json.encode(result), indent=2)
        write_at_once(options.out, data + b"\n")
    proof = result.proof
    text = "".join(
        f"{part}: {len(getattr(result, part))} images ({result.reached[part]:.1%}) of "
        f"{len(result.groups[part])} {options.by}(s)\n"
        for part in PARTS
    )
    if not proof.ok:
        pairs = "; ".join(f"{one} = {other}" for one, other in proof.equal_files_in_two_parts[:5])
        text += f"NOT OK: the same picture lies in two parts: {pairs}\n"
    elif proof.groups_stay_together:
        text += f"no {options.by}, image or file is in two parts; every image is in one\n"
    else:
        text += "every image is in one part, but neighbouring pictures may show the same plants\n"
    print_result(options, {"file": str(options.out), **msgspec.to_builtins(result)}, text)
    return 0 if proof.ok else 1


def _generate(options: argparse.Namespace) -> int:
    _check_ranges(options)
    from agribot.lab.dataset.drawing import draw_field, list_missing_fields
    from agribot.lab.dataset.records import Recipe, claim
    from agribot.lab.dataset.tables import write_tables

    folder = options.out
    recipe = Recipe(
        seed=options.seed,
        width_px=options.width,
        height_px=options.height,
        supersample=options.supersample,
        views_per_field=options.views,
        format=options.format,
        colour_masks=options.colour,
        variety=options.variety,
    )
    claim(folder, recipe)
    jobs = list_missing_fields(folder, recipe, options.images)
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
    print_result(
        options,
        {"folder": str(folder), "seed": options.seed, **summary},
        _format_summary(summary, folder),
    )
    if done < options.images:
        sys.stderr.write(
            f"agribot dataset: interrupted after {done} of {options.images} images; all of them "
            "are complete, the same command draws the rest\n"
        )
        return 130
    return 0


def _format_summary(summary: dict[str, Any], folder: Path) -> str:
    ratio = summary["pixel_ratio"]
    return (
        f"{summary['images']} images of {summary['fields']} fields, {summary['plants']} plants; "
        f"pixels: crop {ratio['crop']:.1%}, weed {ratio['weed']:.1%}, soil {ratio['soil']:.1%}\n"
        f"  {folder}\n"
        if summary["images"]
        else f"no image yet in {folder}\n"
    )


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
        check_within(f"--{name}", getattr(options, name), least, most)
