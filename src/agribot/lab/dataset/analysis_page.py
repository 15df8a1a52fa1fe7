"""The analysis of a set as files: a page with its figures, a table, the images without a mask."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import msgspec

from agribot.lab.dataset.analysis import GroupCounts, PictureCounts, SetAnalysis
from agribot.lab.dataset.analysis_figures import WHOLE, draw_figures
from agribot.lab.dataset.layouts import Layout
from agribot.record.drawing import encode_png
from agribot.record.report import write_file
from agribot.record.templates import fill_template

TITLES = {
    "annotated": "Images and annotated images",
    "classes": "Pixels by class",
    "shares": "How much of a picture is weed or crop",
    "greenness": "Greenness and plants",
    "weed-places": "Where weeds are in the pictures",
    "crop-places": "Where crops are in the pictures",
}


def write_analysis(folder: Path, layout: Layout, analysis: SetAnalysis) -> list[GroupCounts]:
    """Write analysis.html, a PNG of each figure, pictures.csv, sets.csv and without-mask.txt.

    Raises: RecordingError: a file cannot be written.
    """
    groups = analysis.count_groups(layout.items)
    figures = draw_figures(analysis, groups)
    for name, figure in figures.items():
        write_file(folder / f"{name}.png", encode_png(figure))
    write_file(folder / "pictures.csv", _write_pictures(analysis.pictures))
    write_file(folder / "sets.csv", _write_sets(groups))
    missing = [(one.group or WHOLE, name) for one in groups for name in one.without_mask]
    write_file(folder / "without-mask.txt", "".join(f"{name}\n" for _, name in missing).encode())
    page = fill_template(
        "lab/dataset/analysis_page.html.j2", name=layout.root.resolve().name, groups=groups,
        format_group=_format_group, figures=figures, titles=TITLES, missing=missing,
    )  # fmt: skip
    write_file(folder / "analysis.html", page.encode())
    return groups


def _format_group(one: GroupCounts) -> list[str]:
    known = one.weed_px + one.crop_px + one.soil_px
    shares = [
        f"{pixels / known:.2%}" if known else "–"
        for pixels in (one.weed_px, one.crop_px, one.soil_px)
    ]
    counts = (one.images, one.annotated, len(one.without_mask))
    return [one.group or WHOLE, *map(str, counts), *shares]


def _write_pictures(pictures: Sequence[PictureCounts]) -> bytes:
    return _write_csv(
        PictureCounts.__struct_fields__, [msgspec.structs.astuple(one) for one in pictures]
    )


def _write_sets(groups: Sequence[GroupCounts]) -> bytes:
    rows = [
        tuple(len(value) if isinstance(value, tuple) else value for value in row)
        for row in map(msgspec.structs.astuple, groups)
    ]
    return _write_csv(GroupCounts.__struct_fields__, rows)


def _write_csv(heads: Sequence[str], rows: Sequence[tuple[object, ...]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    return text.getvalue().encode("utf-8", "surrogateescape")
