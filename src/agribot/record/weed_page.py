"""The weed map in a report: figures, and the stand of the crop; as a page of its own, too."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path

import numpy as np

from agribot.autonomy.weeds.merge import fuse
from agribot.autonomy.weeds.plant_table import OUTCOMES, PlantTable, is_crop
from agribot.core.messages import FloatArray, Row
from agribot.record import weed_figures
from agribot.record.crop_stand import RowStand, count_per_metre, find_stand, sum_gaps_m
from agribot.record.drawing import encode_svg
from agribot.record.html_tables import format_number, render_table
from agribot.record.report import write_file
from agribot.record.row_table import summarise_rows
from agribot.record.series import RunData
from agribot.record.weeds import tabulate_run


def render_run_weeds(data: RunData) -> str:
    """Render weed map and stand of a run; empty where nothing was mapped."""
    if not data.plants:
        return ""
    table = tabulate_run(data.plants, data.config, "run", data.zones)
    way_m = np.column_stack([data.series.x_map_m, data.series.y_map_m])
    way_m = way_m[np.isfinite(way_m).all(axis=1)]
    seen_m = {summary.index: summary.seen_m for summary in summarise_rows(data)}
    spacing_m = data.config.field.plant_spacing_m
    stands = [find_stand(table, row, spacing_m, seen_m[row.index]) for row in data.rows]
    return _render_maps(table, data.rows, way_m) + _render_stand(stands)


def write_weed_report(path: Path, table: PlantTable, rows: Sequence[Row] = ()) -> None:
    """Write a page about a weed map of one or more runs; `rows` are those of its field.

    Raises: RecordingError: the file cannot be written.
    """
    plants = fuse(table)
    css = resources.files("agribot.record").joinpath("report.css").read_text("utf-8")
    title = f"Weed map: {', '.join(table.maps)}"
    tiles = "".join(
        f'<div class="tile"><dt>{name}</dt><dd>{value}</dd></div>'
        for name, value in _count_plants(plants).items()
    )
    stands = [find_stand(plants, row) for row in rows]
    body = (
        f'<header><p class="eyebrow">AGRIBOT weed map of {len(table.maps)} '
        f"run{'s' * (len(table.maps) != 1)}</p>\n<h1>{escape(', '.join(table.maps))}</h1></header>"
        f'<dl class="tiles">{tiles}</dl>{_render_maps(plants, rows)}{_render_stand(stands)}'
    )
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{css}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )
    write_file(path, page.encode())


def _count_plants(plants: PlantTable) -> dict[str, int]:
    outcomes = [OUTCOMES[code] for code in plants.rows["outcome"].tolist()]
    crops = int(is_crop(plants.rows).sum())
    return {
        "Weeds": len(plants.rows) - crops,
        "Treated": outcomes.count("treated") + outcomes.count("seen again"),
        "Missed": outcomes.count("missed"),
        "Seen again": outcomes.count("seen again"),
        "Crop plants": crops,
    }


def _render_maps(table: PlantTable, rows: Sequence[Row], way_m: FloatArray | None = None) -> str:
    figures = {
        "Weeds per square metre": weed_figures.draw_density(table, rows, way_m),
        "Treated and left": weed_figures.draw_treatment(table, rows, way_m),
    }
    cards = "".join(
        f'<div class="card">{encode_svg(figure, name)}</div>' for name, figure in figures.items()
    )
    return f'<h2>Weed map</h2>\n<div class="plots">{cards}</div>'


def _render_stand(stands: Sequence[RowStand]) -> str:
    if not stands:
        return ""
    heads = (
        "Row", "Crop plants", "Per metre", "Spacing (cm)", "Gaps", "Plants missing",
        "Without crop (m)",
    )  # fmt: skip
    figure = encode_svg(weed_figures.draw_stand(stands), "Crop plants and gaps of each row")
    body = [_format_stand(stand) for stand in stands]
    note = (
        ""
        if all(stand.is_countable for stand in stands)
        else '<p class="none">Where leaves of neighbours touch, plants on the map merge: '
        "no stand is counted there.</p>"
    )
    return (
        f'\n<h2>Stand of the crop</h2>\n<div class="card">{figure}</div>\n{note or "<br>"}'
        + render_table(heads, body)
    )


def _format_stand(stand: RowStand) -> list[str]:
    if not stand.is_countable:
        return [str(stand.row + 1), *["–"] * 6]
    return [
        str(stand.row + 1),
        str(len(stand.along_m)),
        f"{count_per_metre(stand):.2f}",
        format_number(stand.spacing_m, 0, 100.0),
        str(len(stand.gaps_m)),
        str(stand.missing),
        f"{sum_gaps_m(stand):.1f}",
    ]
