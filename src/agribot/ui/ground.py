"""The ground that a map shows: of a run, or of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from agribot.app.field_work import read_field_work
from agribot.app.run_recording import GOALS_ATTACHMENT, PLAN_ATTACHMENT
from agribot.app.tasks import choose_task
from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.core.config import RunConfig
from agribot.core.errors import AgribotError
from agribot.core.messages import MapPoint, Row
from agribot.core.row_shape import row_points_map_m
from agribot.description.loader import parse_robot
from agribot.record.mcap_file import read_attachment
from agribot.record.replay import read_config, read_urdf
from agribot.ui import wire

_CORNERS = 24  # corners of a circle on the map

Point = tuple[float, float]


def field_of(
    config: RunConfig,
    rows: Sequence[Row],
    goals_map_m: Sequence[Point] = (),
    area: FieldArea | None = None,
) -> wire.Field:
    """Describe what the map shows of the ground: the task of a run, in the map of its datum.

    `area` is that of a field plan; what stands in the field is drawn with its holes.
    """
    datum = config.field.datum
    obstacles = [*(area.holes if area else ()), *map(_round, config.field.obstacles_map_m)]
    obstacles += config.field.keep_out_map_m
    lines = [row_points_map_m(row).tolist() for row in rows]
    return wire.Field(
        name=config.world,
        datum=wire.DatumPlace(lat_deg=datum.lat_deg, lon_deg=datum.lon_deg),
        datum_source=config.field.datum_source,
        declination_deg=config.field.declination_deg or 0.0,
        rows=[_row_of(row) for row in rows],
        crop_map_m=[_corners(line) for line in (area.standing if area else lines)],
        boundary_map_m=_corners(area.boundary) if area and len(area.boundary) else None,
        obstacles_map_m=[_corners(ring) for ring in obstacles],
        waypoints_map_m=_corners(goals_map_m),
        start_map_m=config.field.start_map_m,
    )


def _corners(points: Iterable[Sequence[float]]) -> list[wire.Vec2]:
    return [(float(x_m), float(y_m)) for x_m, y_m in points]


def _round(circle: tuple[float, float, float]) -> Sequence[Point]:
    x_m, y_m, radius_m = circle
    angles = [math.tau * k / _CORNERS for k in range(_CORNERS)]
    return [(x_m + radius_m * math.cos(a), y_m + radius_m * math.sin(a)) for a in angles]


def _row_of(row: Row) -> wire.FieldRow:
    return wire.FieldRow(
        index=row.index,
        start_map_m=row.start_map_m,
        end_map_m=row.end_map_m,
        curvature_radpm=row.curvature_radpm,
        points_map_m=_corners(row_points_map_m(row).tolist()),
    )


def read_field(path: Path) -> wire.Field:
    """Describe the ground of a recorded run as `field_of` does.

    Raises: RecordingError: not a recording, or one that does not say what the robot was to do.
    """
    config = read_config(path)
    robot = parse_robot(read_urdf(path), path.name)
    attached = read_attachment(path, GOALS_ATTACHMENT)
    goals = msgspec.json.decode(attached, type=tuple[MapPoint, ...])
    plan = read_attachment(path, PLAN_ATTACHMENT).decode() if config.plan else ""
    work = read_field_work(plan, config, robot)
    task = choose_task(config, robot, goals, work)
    return field_of(config, task.rows, goals, work.area if work else None)


def read_field_or_datum(path: Path) -> wire.Field:
    """Describe the field as `read_field`, or empty ground around the datum if that is unknown."""
    try:
        return read_field(path)
    except AgribotError:
        return field_of(read_config(path), ())
