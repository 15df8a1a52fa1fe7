"""`agribot dataset check`: every image has a mask that fits, and what the set holds."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.cli.counting import CountProgress
from agribot.cli.folder_options import NAME_FOLDERS, list_given
from agribot.cli.ids_option import add_ids_option
from agribot.cli.misplaced_option import add_misplaced_option
from agribot.cli.standard_error import print_line
from agribot.core import extras

if TYPE_CHECKING:
    from agribot.lab.dataset.analysis import SetAnalysis
    from agribot.lab.dataset.classes import MaskIds
    from agribot.lab.dataset.layouts import Layout

MOST_LINES = 20  # problems on the terminal


def add_check(actions: Any) -> None:
    check = actions.add_parser(
        "check",
        help="pair images with masks and say what is missing or wrong",
        epilog="example: agribot dataset check fields; status 1 where something is wrong",
    )
    add_folder(check)
    check.add_argument(
        "--report", type=Path, metavar="DIR", help="write an analysis there: page, figures, tables"
    )
    add_ids_option(check)
    add_misplaced_option(check)


def add_folder(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which set of images and masks is meant."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="a set, or a folder of sets")
    parser.add_argument(
        "--data",
        choices=("cwfid", "bonn", "phenobench", "folder"),
        default="folder",
        help="whose folders and mask values these are (default: those of any of them)",
    )
    parser.add_argument("--images", metavar="NAME", help="folder of the images inside DIR")
    parser.add_argument("--masks", metavar="NAME", help="folder of the masks inside DIR")
    parser.add_argument("--json", action="store_true", help="print the report as the last line")


def find_layout_of(options: argparse.Namespace) -> Layout:
    """Find the set that the options name.

    Raises: ConfigError: no such folders, or no pair in them.
    """
    from agribot.lab.dataset.layouts import find_layout
    from agribot.lab.train.photographs import KINDS

    known = KINDS[options.data]
    images = list_given(options.images) or known.images
    masks = list_given(options.masks) or known.masks
    return find_layout(options.folder, images, masks, NAME_FOLDERS)


def check_set(options: argparse.Namespace) -> int:
    """Check a set, and write its analysis where --report asks for one.

    Raises: AgribotError: no such set, or the analysis cannot be written.
    """
    from agribot.lab.dataset.analysis import SetAnalysis
    from agribot.lab.dataset.check import check

    if options.report is not None:
        extras.require("report", "--report")
    layout = find_layout_of(options)
    analysis = None if options.report is None else SetAnalysis()
    progress = CountProgress(len(layout.items), "pairs")
    report = check(
        layout,
        progress,
        _read_ids(options),
        keeps_misplaced=options.keep_misplaced,
        analysis=analysis,
    )
    progress.close()
    if analysis is not None:
        _write_analysis(options.report, layout, analysis)
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
    print_result(options, msgspec.to_builtins(report), text)
    return 0 if report.ok else 1


def _read_ids(options: argparse.Namespace) -> MaskIds | None:
    """Read what the values of the masks mean: as --ids, --data or the table beside them says.

    Raises: ConfigError: ids that mean nothing.
    """
    from agribot.lab.dataset.classes import read_ids
    from agribot.lab.dataset.colour_tables import find_table_ids
    from agribot.lab.train.photographs import KINDS

    named = read_ids(options.ids)
    if named is not None:
        return named
    return KINDS[options.data].ids or find_table_ids(options.folder)


def _write_analysis(folder: Path, layout: Layout, analysis: SetAnalysis) -> None:
    """Write the analysis of a checked set.

    Raises: RecordingError: a file cannot be written.
    """
    from agribot.lab.dataset.analysis_page import write_analysis

    write_analysis(folder, layout, analysis)
    print_line(f"analysis: {folder / 'analysis.html'}")


def print_result(options: argparse.Namespace, result: dict[str, Any], text: str) -> None:
    """Print the words, and with --json the result as the last line."""
    sys.stderr.write(text)
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
