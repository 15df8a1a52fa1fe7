"""A weed map as ISOXML tasks (ISO 11783-10): what is left to spray, and what was treated.

The first task is a prescription: a grid of type 1, whose cells name a treatment zone, spray or not,
with its rate. Each map's treated weeds are a completed task with a time log: the work state goes
on and off at the place of every one.
"""

from __future__ import annotations

import math
import struct
import xml.etree.ElementTree as ET
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.autonomy.weeds.merge import fuse
from agribot.autonomy.weeds.plant_table import (
    DECISIONS,
    OUTCOMES,
    PlantTable,
    Rows,
    compute_std_m,
    is_crop,
)
from agribot.core.errors import ConfigError
from agribot.core.messages import FloatArray
from agribot.core.whole_file import write_at_once
from agribot.gis.formats.isoxml import MAIN_FILE
from agribot.gis.formats.untrusted import encode_xml, pack

MAX_CELLS = 4_000_000
NO_SPRAY, SPRAY = 0, 1  # codes of the treatment zones
# Data dictionary of ISO 11783-11: rates are in mm3/m2; 100 mm3/m2 are 1 L/ha.
SETPOINT_RATE, ACTUAL_RATE, WORK_STATE = "0001", "0002", "008D"
MM3PM2_PER_LPHA = 100
_EPOCH = datetime(1980, 1, 1, tzinfo=UTC)
_LAST = _EPOCH + timedelta(days=65535)  # last day that 16 bits can count
_DAY_MS = 86_400_000
_POSITION_UNITS_PER_DEG = 1e7
_SPOT_S = 0.1  # time from on to off
_UNNAMED_DEVICE = "A00E84000DE0DB6A"  # a NAME of the agricultural industry group, self-configured
_PLANNED, _COMPLETED = "1", "4"


class TaskOptions(NamedTuple):
    """`margin_m` is sprayed around a weed; `began` is when the clock of the runs was zero, UTC."""

    began: datetime
    rate_lpha: float = 200.0
    cell_m: float = 0.5
    margin_m: float = 0.1
    version: Literal["3", "4"] = "4"


class CellGrid(NamedTuple):
    """Cells of degrees from the South-West on; `codes` (rows, columns) go North and East."""

    south_deg: float
    west_deg: float
    cell_north_deg: float
    cell_east_deg: float
    codes: npt.NDArray[np.uint8]


def write_tasks(path: Path, table: PlantTable, options: TaskOptions) -> None:
    """Write an archive with the folder TASKDATA.

    Raises: ConfigError: the grid would have too many cells, a weed was treated at no time of a
        time log, or there is nothing to write.
    """
    version = options.version
    root = ET.Element(
        "ISO11783_TaskData", VersionMajor=version, VersionMinor="2" if version == "4" else "3",
        ManagementSoftwareManufacturer="AGRIBOT", ManagementSoftwareVersion="1",
        TaskControllerManufacturer="", TaskControllerVersion="", DataTransferOrigin="1",
    )  # fmt: skip
    rows = fuse(table).rows
    if not len(rows):
        raise ConfigError("the weed map is empty; export one with plants")
    device = ET.SubElement(
        root, "DVC", A="DVC1", B="AGRIBOT", D=_UNNAMED_DEVICE, F="01", G="FF000000406E65"
    )
    ET.SubElement(device, "DET", A="DET1", B="1", C="1", D="robot", E="0", F="0")
    ET.SubElement(root, "PFD", A="PFD1", C="Weed map", D="0")
    files = _add_prescription(root, table, rows, options)
    for number, name in enumerate(table.maps, 1):
        mine = table.rows[(table.rows["map"] == number - 1) & np.isfinite(table.rows["treated_s"])]
        if len(mine):
            files |= _add_log(root, name, number, table, mine, options)
    main = {f"TASKDATA/{MAIN_FILE}": encode_xml(root)}
    write_at_once(path, pack(main | {f"TASKDATA/{name}": data for name, data in files.items()}))


def _add_prescription(
    root: ET.Element, table: PlantTable, rows: Rows, options: TaskOptions
) -> dict[str, bytes]:
    grid = make_grid(table, rows, options)
    task = ET.SubElement(
        root, "TSK", A="TSK1", B="Weeds left", E="PFD1", G=_PLANNED, H=str(NO_SPRAY),
        I=str(NO_SPRAY), J=str(NO_SPRAY),
    )  # fmt: skip
    for code, name, rate_lpha in (
        (NO_SPRAY, "nothing", 0.0),
        (SPRAY, "spray", options.rate_lpha),
    ):
        zone = ET.SubElement(task, "TZN", A=str(code), B=name)
        value = str(round(rate_lpha * MM3PM2_PER_LPHA))
        ET.SubElement(zone, "PDV", A=SETPOINT_RATE, B=value)
    rows_count, columns = grid.codes.shape
    ET.SubElement(
        task, "GRD", A=f"{grid.south_deg:.9f}", B=f"{grid.west_deg:.9f}",
        C=f"{grid.cell_north_deg:.12f}", D=f"{grid.cell_east_deg:.12f}", E=str(columns),
        F=str(rows_count), G="GRD00001", H=str(grid.codes.size), I="1",
    )  # fmt: skip
    return {"GRD00001.BIN": grid.codes.tobytes()}


def make_grid(table: PlantTable, rows: Rows, options: TaskOptions) -> CellGrid:
    """Mark the cells that lie within the margin of a weed which is not treated yet.

    The margin grows by 1 sigma of the weed's place.
    Raises: ConfigError: the grid would have too many cells.
    """
    xy_m = np.column_stack([rows["x_map_m"], rows["y_map_m"]])
    low_m, high_m = xy_m.min(axis=0) - 2.0, xy_m.max(axis=0) + 2.0
    (west, south), (east, north) = table.frame.lonlat_from_map(np.array([low_m, high_m])).tolist()
    size_m = high_m - low_m
    columns, lines = (math.ceil(side / options.cell_m) for side in size_m.tolist())
    if columns * lines > MAX_CELLS:
        raise ConfigError(
            f"a grid of {columns} by {lines} cells has more than {MAX_CELLS}; give a larger --cell "
            f"than {options.cell_m:g} m"
        )
    cell = ((north - south) / lines, (east - west) % 360.0 / columns)  # also over 180 degrees
    is_open = _find_open(rows)
    reach_m = options.margin_m + compute_std_m(rows[is_open])
    place = (xy_m[is_open] - low_m) / (size_m / (columns, lines))  # in cells
    codes = np.zeros((lines, columns), np.uint8)
    _mark_discs(codes, place, reach_m / options.cell_m)
    return CellGrid(south, west, *cell, codes)


def _find_open(rows: Rows) -> npt.NDArray[np.bool_]:
    """Find the weeds that are to be treated and were not, or came back."""
    done = rows["outcome"] == OUTCOMES.index("treated")
    spared = rows["decision"] == DECISIONS.index("spare")
    is_open: npt.NDArray[np.bool_] = ~is_crop(rows) & ~done & ~spared
    return is_open


def _mark_discs(codes: npt.NDArray[np.uint8], place: FloatArray, reach: FloatArray) -> None:
    """Mark every cell that a disc touches; places (N, 2) are column and row, in cells."""
    if not len(place):
        return
    lines, columns = codes.shape
    most = math.ceil(float(reach.max()))
    home = np.floor(place).astype(np.int64)
    for across in range(-most, most + 1):
        for along in range(-most, most + 1):
            cell = home + np.array([across, along])
            nearest = np.clip(place, cell, cell + 1)
            is_hit = ((place - nearest) ** 2).sum(axis=1) <= reach**2
            is_hit &= ((cell >= 0) & (cell < (columns, lines))).all(axis=1)
            codes[cell[is_hit, 1], cell[is_hit, 0]] = SPRAY


def _add_log(
    root: ET.Element, name: str, number: int, table: PlantTable, rows: Rows, options: TaskOptions
) -> dict[str, bytes]:
    rows = rows[np.argsort(rows["treated_s"], kind="stable")]
    first, last = (_format_time(options.began, rows["treated_s"][at]) for at in (0, -1))
    task = ET.SubElement(
        root, "TSK", A=f"TSK{number + 1}", B=f"Treated: {name}"[:32], E="PFD1", G=_COMPLETED
    )
    ET.SubElement(task, "TIM", A=first, B=last, D="4")
    ET.SubElement(task, "DAN", A=_UNNAMED_DEVICE, C="DVC1")
    log = f"TLG{number:05d}"
    head = ET.Element("TIM", A="", D="4")
    ET.SubElement(head, "PTN", A="", B="", D="")
    for data in (WORK_STATE, ACTUAL_RATE):
        ET.SubElement(head, "DLV", A=data, B="", C="DET1")
    body = _encode_log(table, rows, options)
    ET.SubElement(task, "TLG", A=log, B=str(len(body)), C="1")
    return {f"{log}.XML": encode_xml(head), f"{log}.BIN": body}


def _encode_log(table: PlantTable, rows: Rows, options: TaskOptions) -> bytes:
    """Encode time of day, day, North, East, status of the position, and two values each."""
    lonlat_deg = table.frame.lonlat_from_map(np.column_stack([rows["x_map_m"], rows["y_map_m"]]))
    places = np.round(lonlat_deg * _POSITION_UNITS_PER_DEG).astype(np.int64).tolist()
    rate = round(options.rate_lpha * MM3PM2_PER_LPHA)
    parts = []
    for (east, north), treated_s in zip(places, rows["treated_s"].tolist(), strict=True):
        for state, delay_s in ((1, 0.0), (0, _SPOT_S)):
            since = _find_time(options.began, treated_s + delay_s) - _EPOCH
            days, milliseconds = divmod(round(since / timedelta(milliseconds=1)), _DAY_MS)
            parts.append(
                struct.pack(
                    "<IHiiBBBiBi",
                    milliseconds,
                    days,
                    north,
                    east,
                    4,
                    2,
                    0,
                    state,
                    1,
                    rate * state,
                )
            )
    return b"".join(parts)


def _find_time(began: datetime, t_s: float) -> datetime:
    """Find the time of the calendar for one of a run's clock.

    Raises: ConfigError: a time log has no such day.
    """
    try:
        when = began + timedelta(seconds=float(t_s))
        if _EPOCH <= when < _LAST:
            return when
    except OverflowError:
        pass
    raise ConfigError(
        f"a weed was treated {t_s:g} s after {began:%Y-%m-%dT%H:%M} UTC; a time log has days from "
        f"{_EPOCH.year} to {_LAST.year} only: say with --began when the clock of the run was zero"
    )


def _format_time(began: datetime, t_s: float) -> str:
    when = _find_time(began, t_s)
    return when.strftime("%Y-%m-%dT%H:%M:%S.") + f"{when.microsecond // 1000:03d}Z"
