"""What happened in each crop row, as a table."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.core.messages import MappedPlant, PlantClass, Row
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.record.plots import true_cross_track_m
from agribot.record.series import RunData


class RowSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Cross-track is the true one where a simulator knows it, else what the robot believes."""

    index: int
    distance_m: float
    duration_s: float
    speed_mps: float | None
    cross_track_rms_m: float | None
    cross_track_max_m: float | None
    weeds_mapped: int
    weeds_treated: int
    seen_m: float | None  # with crop in view where the row should be; None without a camera


def summarise_rows(data: RunData) -> tuple[RowSummary, ...]:
    """Summarise each row of the field; a weed belongs to the row that it is nearest to."""
    if not data.rows:  # a visit of places
        return ()
    series = data.series
    across_m = true_cross_track_m(series, data.rows)
    if not np.isfinite(across_m).any():
        across_m = series.cross_track_m
    step_s = np.diff(series.t_s, prepend=series.t_s[:1])
    step_m = np.diff(series.distance_m, prepend=series.distance_m[:1])
    nearest = {p.id: nearest_row(p, data.rows) for p in data.plants if p.plant == PlantClass.WEED}
    summaries = []
    for row in data.rows:
        here = series.row == row.index
        errors_m = across_m[here & np.isfinite(across_m)]
        duration_s, distance_m = float(step_s[here].sum()), float(step_m[here].sum())
        looked = here & np.isfinite(series.row_seen)
        weeds = [p for p in data.plants if nearest.get(p.id) == row.index]
        summaries.append(
            RowSummary(
                index=row.index,
                distance_m=distance_m,
                duration_s=duration_s,
                speed_mps=distance_m / duration_s if duration_s > 0 else None,
                cross_track_rms_m=math.sqrt(float(np.mean(errors_m**2))) if len(errors_m) else None,
                cross_track_max_m=float(np.abs(errors_m).max()) if len(errors_m) else None,
                weeds_mapped=len(weeds),
                weeds_treated=sum(p.treated_s is not None for p in weeds),
                seen_m=float(step_m[looked & (series.row_seen > 0)].sum())
                if looked.any()
                else None,
            )
        )
    return tuple(summaries)


def nearest_row(plant: MappedPlant, rows: tuple[Row, ...]) -> int:
    """Find the index of the row whose segment is nearest; `rows` must not be empty."""
    return min(rows, key=lambda row: _distance_m(plant.x_map_m, plant.y_map_m, row)).index


def _distance_m(x_m: float, y_m: float, row: Row) -> float:
    along_m, left_m, _ = project_on_row(row, x_m, y_m)
    beyond_m = max(-along_m, along_m - row_length_m(row), 0.0)
    return math.hypot(beyond_m, left_m)
