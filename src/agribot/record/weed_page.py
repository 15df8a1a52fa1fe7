"""The weed map in a report: figures, and the stand of the crop; as a page of its own, too."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from agribot.autonomy.weeds.merge import fuse
from agribot.autonomy.weeds.plant_table import OUTCOMES, PlantTable, is_crop
from agribot.core.messages import FloatArray, Row
from agribot.record import weed_figures
from agribot.record.crop_stand import RowStand, find_stand
from agribot.record.report import write_file
from agribot.record.row_table import summarise_rows
from agribot.record.series import RunData
from agribot.record.templates import fill_template
from agribot.record.weeds import tabulate_run


class DrawnWeeds(NamedTuple):
    """Content of weed_map.html.j2."""

    figures: dict[str, Figure]
    stands: Sequence[RowStand]
    stand_figure: Figure | None


def draw_run_weeds(data: RunData) -> DrawnWeeds | None:
    """Draw weed map and stand of a run; None where nothing was mapped."""
    if not data.plants:
        return None
    table = tabulate_run(data.plants, data.config, "run", data.zones)
    way_m = np.column_stack([data.series.x_map_m, data.series.y_map_m])
    way_m = way_m[np.isfinite(way_m).all(axis=1)]
    seen_m = {summary.index: summary.seen_m for summary in summarise_rows(data)}
    spacing_m = data.config.field.plant_spacing_m
    stands = [find_stand(table, row, spacing_m, seen_m[row.index]) for row in data.rows]
    return _draw_map(table, data.rows, stands, way_m)


def write_weed_report(path: Path, table: PlantTable, rows: Sequence[Row] = ()) -> None:
    """Write a page about a weed map of one or more runs; `rows` are those of its field.

    Raises: RecordingError: the file cannot be written.
    """
    plants = fuse(table)
    stands = [find_stand(plants, row) for row in rows]
    page = fill_template(
        "record/weed_page.html.j2", maps=table.maps, tiles=_count_plants(plants),
        weed_map=_draw_map(plants, rows, stands),
    )  # fmt: skip
    write_file(path, page.encode())


def _count_plants(plants: PlantTable) -> list[tuple[str, int, str]]:
    outcomes = [OUTCOMES[code] for code in plants.rows["outcome"].tolist()]
    crops = int(is_crop(plants.rows).sum())
    return [
        ("Weeds", len(plants.rows) - crops, ""),
        ("Treated", outcomes.count("treated") + outcomes.count("seen again"), ""),
        ("Missed", outcomes.count("missed"), ""),
        ("Seen again", outcomes.count("seen again"), ""),
        ("Crop plants", crops, ""),
    ]


def _draw_map(
    table: PlantTable,
    rows: Sequence[Row],
    stands: Sequence[RowStand],
    way_m: FloatArray | None = None,
) -> DrawnWeeds:
    figures = {
        "Weeds per square metre": weed_figures.draw_density(table, rows, way_m),
        "Treated and left": weed_figures.draw_treatment(table, rows, way_m),
    }
    return DrawnWeeds(figures, stands, weed_figures.draw_stand(stands) if stands else None)
