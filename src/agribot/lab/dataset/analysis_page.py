"""The analysis of a set as files: a page with its figures, a table, the images without a mask."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path

import msgspec

from agribot.lab.dataset.analysis import GroupCounts, PictureCounts, SetAnalysis
from agribot.lab.dataset.analysis_figures import WHOLE, draw_figures
from agribot.lab.dataset.layouts import Layout
from agribot.record.drawing import encode_png, encode_svg
from agribot.record.html_tables import fold_table, render_table
from agribot.record.report import write_file

HEADS = ("Set", "Images", "Annotated", "Without a mask", "Weed", "Crop", "Soil")
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
    missing = "".join(f"{name}\n" for one in groups for name in one.without_mask)
    write_file(folder / "without-mask.txt", missing.encode())
    cards = "".join(
        f'<h2>{TITLES[name]}</h2>\n<div class="card">{encode_svg(figure, TITLES[name])}</div>\n'
        for name, figure in figures.items()
    )
    write_file(folder / "analysis.html", _render_page(layout, groups, cards).encode())
    return groups


def _render_page(layout: Layout, groups: Sequence[GroupCounts], cards: str) -> str:
    css = resources.files("agribot.record").joinpath("report.css").read_text("utf-8")
    name = escape(layout.root.resolve().name)
    annotated, images = (sum(values) for values in zip(*_count(groups), strict=True))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name}</title>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n"
        f'<header><p class="eyebrow">Images and masks</p>\n<h1>{name}</h1>\n'
        f"<p>{annotated} of {images} images are annotated, in {len(groups)} set(s)</p></header>\n"
        f"<h2>Sets</h2>\n{render_table(HEADS, [_format_group(one) for one in groups])}\n"
        f"{cards}{_render_missing(groups)}</main>\n</body>\n</html>\n"
    )


def _count(groups: Sequence[GroupCounts]) -> list[tuple[int, int]]:
    return [(one.annotated, one.images) for one in groups]


def _format_group(one: GroupCounts) -> list[str]:
    known = one.weed_px + one.crop_px + one.soil_px
    shares = [
        f"{pixels / known:.2%}" if known else "–"
        for pixels in (one.weed_px, one.crop_px, one.soil_px)
    ]
    counts = (one.images, one.annotated, len(one.without_mask))
    return [one.group or WHOLE, *map(str, counts), *shares]


def _render_missing(groups: Sequence[GroupCounts]) -> str:
    body = [[one.group or WHOLE, name] for one in groups for name in one.without_mask]
    if not body:
        return '<h2>Images without a mask</h2>\n<p class="none">None.</p>\n'
    table = render_table(("Set", "Image"), body)
    return f"<h2>Images without a mask</h2>\n{fold_table(f'{len(body)} images', table, body)}\n"


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
