"""`agribot dataset label-by-rows`: the pictures of drives along rows, labelled by the rows."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from agribot.cli.counting import CountProgress
from agribot.core.errors import ConfigError


def add_label_by_rows(actions: Any) -> None:
    """Add `agribot dataset label-by-rows`."""
    parser = actions.add_parser(
        "label-by-rows",
        help="the pictures of recorded drives, labelled by where the plants stand: on a row crop, "
        "between the rows weed",
        epilog="example: agribot dataset label-by-rows runs/first --out photos; then agribot train "
        "--data folder --data-dir photos",
    )
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="folder of a run, or its run.mcap"
    )
    parser.add_argument(
        "--pitch",
        type=float,
        metavar="M",
        help="from row to row (default: that of the profile; unknown where a plan was driven)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new folder")
    parser.add_argument("--json", action="store_true", help="print the report as the last line")


def label_by_rows(options: argparse.Namespace) -> int:
    """Raise: AgribotError: recordings that cannot teach."""
    import msgspec

    from agribot.lab.dataset.recorded_rows import PASSES, RecordedPictures, label_recordings

    if options.pitch is not None and not 0.2 <= options.pitch <= 5.0:
        raise ConfigError(f"--pitch {options.pitch:g}: must be from 0.2 to 5 m")
    recordings = [RecordedPictures(path, options.pitch) for path in options.runs]
    progress = CountProgress(PASSES * sum(map(len, recordings)), "pictures")
    report = label_recordings(recordings, options.out, progress)
    progress.close()
    ratios = ", ".join(f"{name} {share:.2%}" for name, share in report.pixel_ratio.items())
    sys.stderr.write(
        f"{report.labelled} of {report.pictures} pictures are labelled in {report.folder}, "
        f"{report.without_row} show no row along the way, {report.at_standstill} the same as the "
        f"one before\n  rows reach {report.half_row_m:.2f} m to either side; pixels: {ratios}\n"
    )
    if options.json:
        sys.stdout.write(json.dumps(msgspec.to_builtins(report)) + "\n")
    return 0
