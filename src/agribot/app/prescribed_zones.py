"""The prescription of a run: its file, and its zones on the field of the run."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agribot.autonomy.implements.zones import ZoneMap
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import FileLarge, FileUnreadable
from agribot.core.row_shape import row_points_map_m
from agribot.core.sqlite_file import read_with_log
from agribot.gis.formats.untrusted import MAX_FILE_BYTES
from agribot.gis.prescription import check_covers, read_prescription


def read_prescription_file(config: RunConfig) -> bytes:
    """Read the file of the settings; empty where a run has none.

    Raises: MissionError: it cannot be read, or is too large.
    """
    if not config.treatment.prescription:
        return b""
    path = Path(config.treatment.prescription)
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MissionError(FileLarge(path.name, path.stat().st_size, MAX_FILE_BYTES))
        return read_with_log(path)
    except OSError as error:
        raise MissionError(FileUnreadable(str(path), str(error))) from error


def read_zones(data: bytes, config: RunConfig, work: FieldWork | None) -> ZoneMap | None:
    """Read the zones in the map of the run; None without a prescription.

    Raises: MissionError: a broken one, or one that is not of this field.
    """
    if not config.treatment.prescription:
        return None
    name, datum = Path(config.treatment.prescription).name, config.field.datum
    zones = read_prescription(name, data, datum, config.treatment.prescription_column)
    lines = (
        [np.array(work.area.boundary)]
        if work is not None
        else [row_points_map_m(row) for row in lay_rows(config.field)]
    )
    if lines and not config.waypoints:
        check_covers(zones, lines, datum, f"'{name[:80]}'")
    return zones
