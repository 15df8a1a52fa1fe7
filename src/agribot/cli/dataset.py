"""`agribot dataset`: draw, import, check, split sets of images and masks, label them by rows."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.app.workers import results, usable_cpus
from agribot.cli.counting import CountProgress
from agribot.cli.dataset_import import add_import, import_files
from agribot.cli.dataset_rows import add_label_by_rows, label_by_rows
from agribot.cli.folder_options import NAME_FOLDERS, list_given
from agribot.cli.ids_option import add_ids_option
from agribot.cli.misplaced_option import add_misplaced_option
from agribot.cli.output_names import check_ending
from agribot.cli.ranges import seed
from agribot.cli.stopping import stop_on_signal
from agribot.core.errors import ConfigError, RecordingError
from agribot.core.whole_file import write_at_once

if TYPE_CHECKING:
    from agribot.lab.dataset.layouts import Layout

LARGEST_SIDE_PX = 8192
MOST_LINES = 20  # of problems, on the terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    _add_generate(actions)
    _add_check(actions)
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


def _add_check(actions: Any) -> None:
    check = actions.add_parser(
        "check",
        help="pair images with masks and say what is missing or wrong",
        epilog="example: agribot dataset check fields; status 1 where something is wrong",
    )
    _add_folder(check)
    add_ids_option(check)
    add_misplaced_option(check)


def _add_split(actions: Any) -> None:
    split = actions.add_parser(
        "split",
        help="training, validation and test sets that share no field or day",
        epilog="example: agribot dataset split fields --by field --ratios 70,15,15 -o split.json",
    )
    _add_folder(split)
    split.add_argument("--by", choices=("field", "day", "image"), default="field")
    split.add_argument("--ratios", default="70,15,15", metavar="TRAIN,VAL,TEST")
    split.add_argument("--seed", type=seed, default=0)
    split.add_argument("-o", "--out", type=Path, required=True, metavar="FILE")


def _add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="a set, or a folder of sets")
    parser.add_argument("--images", metavar="NAME", help="folder of the images inside DIR")
    parser.add_argument("--masks", metavar="NAME", help="folder of the masks inside DIR")
    parser.add_argument("--json", action="store_true", help="print the report as the last line")


def run(options: argparse.Namespace) -> int:
    actions = {
        "generate": _generate,
        "check": _check,
        "split": _split,
        "import": import_files,
        "label-by-rows": label_by_rows,
    }
    return actions[options.action](options)


def _find_layout(options: argparse.Namespace) -> Layout:
    from agribot.lab.dataset.layouts import IMAGE_FOLDERS, MASK_FOLDERS, find_layout

    images = list_given(options.images) or IMAGE_FOLDERS
    masks = list_given(options.masks) or MASK_FOLDERS
    return find_layout(options.folder, images, masks, NAME_FOLDERS)


def _check(options: argparse.Namespace) -> int:
    from agribot.lab.dataset.check import check
    from agribot.lab.dataset.classes import read_ids
    from agribot.lab.dataset.colour_tables import find_table_ids

    layout = _find_layout(options)
    told = read_ids(options.ids)
    ids = find_table_ids(options.folder) if told is None else told
    progress = CountProgress(len(layout.items), "pairs")
    report = check(layout, progress, ids, keeps_misplaced=options.keep_misplaced)
    progress.close()
    ratios = ", ".join(
        f"{name} {ratio:.2%}" for name, ratio in report.pixel_ratio.items() if ratio is not None
    )
    text = (
        f"{'OK' if report.ok else 'NOT OK'}: {report.images} images, {report.masks} masks, "
        f"{report.pairs} good pairs in {len(report.groups)} set(s); pixels: {ratios or '-'}; "
        f"{report.without_plants} without plants; sizes "
        f"{', '.join(f'{size} ({count})' for size, count in report.sizes.items()) or '-'}\n"
    )
    sets = report.annotated if len(report.groups) > 1 else {}
    for name, pairs in list(sets.items())[:MOST_LINES]:
        text += f"  {name or report.folder}: {pairs} of {report.groups[name]} annotated\n"
    for problem in report.problems[:MOST_LINES]:
        text += f"  {problem.kind}: {problem.file} {problem.detail}".rstrip() + "\n"
    if len(report.problems) > MOST_LINES:
        text += f"  and {len(report.problems) - MOST_LINES} more (all with --json)\n"
    _show(options, msgspec.to_builtins(report), text)
    return 0 if report.ok else 1


def _split(options: argparse.Namespace) -> int:
    from agribot.lab.dataset.split import PARTS, read_ratios, split

    ratios = read_ratios(options.ratios)
    if options.seed < 0:
        raise ConfigError(f"--seed {options.seed}: must be at least 0")
    check_ending("-o", options.out, "JSON", ".json")
    layout = _find_layout(options)
    result = split(layout, options.by, ratios, options.seed)
    try:
        data = msgspec.json.format(msgspec.json.encode(result), indent=2)
        write_at_once(options.out, data + b"\n")
    except OSError as error:
        raise RecordingError(
            f"cannot write {options.out}: {error.strerror or error}; choose another -o file"
        ) from error
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
    _show(options, {"file": str(options.out), **msgspec.to_builtins(result)}, text)
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
    _show(
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
