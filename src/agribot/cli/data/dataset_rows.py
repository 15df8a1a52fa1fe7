"""`agribot dataset label-by-rows`: pictures of rows, labelled by where the plants stand."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from agribot.app.workers import usable_cpus
from agribot.cli.counting import CountProgress
from agribot.cli.ranges import check_within
from agribot.core.config import DEFAULT_MODEL
from agribot.core.errors import ConfigError


def add_label_by_rows(actions: Any) -> None:
    """Add `agribot dataset label-by-rows`."""
    parser = actions.add_parser(
        "label-by-rows",
        help="pictures of recorded drives, or photographs from straight above, labelled by where "
        "the plants stand: on a row crop, between the rows weed",
        epilog="example: agribot dataset label-by-rows runs/first --out photos; or, for a folder "
        "of photographs with one row in each, agribot dataset label-by-rows photographs --out "
        "photos; then agribot train --data folder --data-dir photos",
    )
    parser.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="RUN",
        help="folder of a run, or its run.mcap; or one folder of photographs",
    )
    parser.add_argument(
        "--pitch",
        type=float,
        metavar="M",
        help="of a drive: from row to row (default: that of the profile; unknown where a plan was "
        "driven)",
    )
    parser.add_argument(
        "--model",
        metavar="MODEL",
        help="of photographs: the network whose word counts on the row, a name or an .onnx file "
        "(default: agribot-plants)",
    )
    parser.add_argument(
        "--rows",
        choices=("down", "across"),
        help="of photographs: how the rows run through them (default: as the network's crops show)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new folder")
    parser.add_argument("--json", action="store_true", help="print the report as the last line")


def label_by_rows(options: argparse.Namespace) -> int:
    """Raise: AgribotError: recordings or photographs that cannot teach."""
    from agribot.app.run_recording import find_recording

    if options.pitch is not None:
        check_within("--pitch", options.pitch, 0.2, 5.0, "m")
    if any(not path.is_dir() or find_recording(path).exists() for path in options.sources):
        if options.model or options.rows:
            raise ConfigError(
                "--model and --rows are for a folder of photographs, not a drive; leave them out"
            )
        return _label_drives(options)
    if len(options.sources) > 1:
        raise ConfigError("give one folder of photographs; copy those of several fields into one")
    if options.pitch is not None:
        raise ConfigError("--pitch is for drives; of photographs, each shows one row")
    return _label_photographs(options)


def _label_drives(options: argparse.Namespace) -> int:
    from agribot.lab.dataset.recorded_rows import PASSES, RecordedPictures, label_recordings

    recordings = [RecordedPictures(path, options.pitch) for path in options.sources]
    progress = CountProgress(PASSES * sum(map(len, recordings)), "pictures")
    report = label_recordings(recordings, options.out, progress)
    progress.close()
    sys.stderr.write(
        f"{report.labelled} of {report.pictures} pictures are labelled in {report.folder}, "
        f"{report.without_row} show no row along the way, {report.at_standstill} the same as the "
        f"one before\n  rows reach {report.half_row_m:.2f} m to either side; "
        f"{_format_ratios(report.pixel_ratio)}\n"
    )
    _print_json(options, report)
    return 0


def _label_photographs(options: argparse.Namespace) -> int:
    from agribot.autonomy.perceive.segmenter import Segmenter
    from agribot.lab.dataset.photographed_rows import PASSES, PhotographedRows

    segmenter = Segmenter(options.model or DEFAULT_MODEL, threads=usable_cpus())
    photographs = PhotographedRows(options.sources[0], segmenter, options.rows)
    progress = CountProgress(PASSES * len(photographs), "pictures")
    report = photographs.label(options.out, progress)
    progress.close()
    for problem in report.problems:
        sys.stderr.write(f"left out: {problem}\n")
    sys.stderr.write(
        f"{report.labelled} of {report.pictures} photographs are labelled in {report.folder}, "
        f"{report.without_row} show no single row of crop\n"
        f"  rows run {report.rows} the pictures, {report.turn_deg:+.0f} degrees aside, and reach "
        f"{report.half_row_ratio:.1%} of a picture to either side; "
        f"{_format_ratios(report.pixel_ratio)}\n"
    )
    _print_json(options, report)
    return 1 if report.problems else 0


def _print_json(options: argparse.Namespace, report: object) -> None:
    import msgspec

    if options.json:
        sys.stdout.write(json.dumps(msgspec.to_builtins(report)) + "\n")


def _format_ratios(pixel_ratio: dict[str, float]) -> str:
    return "pixels: " + ", ".join(f"{name} {share:.2%}" for name, share in pixel_ratio.items())
