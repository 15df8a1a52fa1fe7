"""`agribot dataset import`: labels of other tools as a set that a network learns from."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from agribot.cli.counting import CountProgress
from agribot.cli.misplaced_option import add_misplaced_option
from agribot.core.errors import ConfigError

MOST_LINES = 20  # problems on the terminal
FORMATS = ("auto", "labelme", "coco", "cvat", "yolo", "label-studio")


def add_import(actions: Any) -> None:
    """Add `agribot dataset import`."""
    parser = actions.add_parser(
        "import",
        help="labels of LabelMe, COCO, CVAT, YOLO or Label Studio as images and masks",
        epilog="example: agribot dataset import labels.json --classes crop=beet,maize 'weed=*' "
        "--out photos; status 1 where a picture had to be left out",
    )
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="files of labels, or folders of them"
    )
    parser.add_argument(
        "--format", choices=FORMATS, default="auto", help="of the labels (default: what they are)"
    )
    parser.add_argument(
        "--classes",
        nargs="+",
        default=[],
        metavar="CLASS=NAME,NAME",
        help="what the tool's names are: crop, weed, soil or ignore; * is every other name "
        "(default: the names are those)",
    )
    parser.add_argument(
        "--images", type=Path, metavar="DIR", help="where the pictures are (default: beside FILE)"
    )
    parser.add_argument(
        "--keep-empty",
        action="store_true",
        help="pictures without a label show bare soil (default: they are not labelled yet)",
    )
    add_misplaced_option(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new folder")
    parser.add_argument("--json", action="store_true", help="print the report as the last line")


def import_files(options: argparse.Namespace) -> int:
    """Return 1 where a picture had to be left out.

    Raises: ConfigError: nothing can be used, or the labels do not mean what they should.
    """
    import msgspec

    from agribot.lab.dataset.importing import (
        import_labels,
        list_label_files,
        read_class_names,
        read_label_files,
    )

    meaning = read_class_names(options.classes)
    if options.images is not None and not options.images.is_dir():
        raise ConfigError(f"--images {options.images} is no folder; check the path")
    problems: list[str] = []
    files = list_label_files(options.files, options.format)
    sources = list(read_label_files(files, options.format, problems))
    progress = CountProgress(sum(len(source.pictures) for source in sources), "pictures")
    report = import_labels(
        sources,
        meaning,
        options.out,
        images=options.images,
        keeps_empty=options.keep_empty,
        keeps_misplaced=options.keep_misplaced,
        problems=problems,
        progress=progress,
    )
    progress.close()
    _print(report)
    if options.json:
        sys.stdout.write(json.dumps(msgspec.to_builtins(report)) + "\n")
    return 1 if report.problems else 0


def _print(report: Any) -> None:
    shapes = ", ".join(f"{name} {count}" for name, count in report.shapes.items())
    text = f"{report.pictures} pictures with labels ({shapes or 'none'}) in {report.folder}\n"
    if report.unlabelled:
        text += (
            f"{len(report.unlabelled)} pictures without any label were left out; --keep-empty "
            "takes them as bare soil\n"
        )
    if report.without_area:
        some = "; ".join(report.without_area[:3])
        text += f"{len(report.without_area)} shapes without an area were left out ({some})\n"
    for problem in report.problems[:MOST_LINES]:
        text += f"  left out: {problem}\n"
    if len(report.problems) > MOST_LINES:
        text += f"  and {len(report.problems) - MOST_LINES} more (all with --json)\n"
    sys.stderr.write(text)
