"""The treatment zones of an ISOXML task (ISO 11783-10): grids of both types, and polygons."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.gis.formats.isoxml import list_absent
from agribot.gis.formats.untrusted import parse_xml, unpack
from agribot.gis.weeds.isoxml_tasks import MM3PM2_PER_LPHA, SETPOINT_RATE

MAX_CELLS = 25_000_000
_PLANNED = "1"
_INNER = "2"
Rings = list[list[tuple[float, float]]]


class RateGrid(NamedTuple):
    """Rates (rows, columns) on cells of degrees, northwards and eastwards from a corner."""

    south_deg: float
    west_deg: float
    cell_north_deg: float
    cell_east_deg: float
    rate_lpha: npt.NDArray[np.float64]


def read_task_zones(data: bytes) -> list[RateGrid | tuple[Rings, float]]:
    """Read grids and polygons of the one task that has some, of several of the one not begun.

    Raises: ValueError: no such task, or it is broken.
    """
    files = {PurePosixPath(k).name.upper(): v for k, v in unpack(data, ".xml", ".bin").items()}
    trees = {n.removesuffix(".XML"): parse_xml(t) for n, t in files.items() if n.endswith(".XML")}
    tasks = [e for tree in trees.values() for e in tree.iter("TSK") if _has_zones(e)]
    planned = [task for task in tasks if task.get("G") == _PLANNED]
    chosen = tasks if len(tasks) == 1 else planned
    if len(chosen) != 1:
        names = ", ".join(task.get("B", "") for task in tasks)[:100] or "none"
        absent = "".join(f"; {name} is not inside" for name in list_absent(trees, "TSK"))
        raise ValueError(f"one task with treatment zones is wanted; it has: {names}{absent}")
    return _read_task(chosen[0], files)


def _has_zones(task: ET.Element) -> bool:
    return any(e.tag == "GRD" for e in task) or any(
        e.tag == "PLN" for zone in _list_zones(task) for e in zone
    )


def _list_zones(task: ET.Element) -> list[ET.Element]:
    return [e for e in task if e.tag == "TZN"]


def _read_task(task: ET.Element, files: dict[str, bytes]) -> list[RateGrid | tuple[Rings, float]]:
    found: list[RateGrid | tuple[Rings, float]] = []
    zones: dict[int, ET.Element] = {}
    for zone in _list_zones(task):
        code = int(zone.attrib["A"])
        if code in zones:
            raise ValueError(f"two treatment zones have the code {code}")
        zones[code] = zone
        areas = [area for e in zone if e.tag == "PLN" for area in _read_areas(e)]
        found += [(area, _read_rate(zone)) for area in areas]
    found += [_read_grid(e, zones, files) for e in task if e.tag == "GRD"]
    return found


def _read_rate(zone: ET.Element) -> float:
    return _find_value(zone)[1] / MM3PM2_PER_LPHA


def _find_value(zone: ET.Element) -> tuple[int, float]:
    """Find which of a zone's values is the volume per area, and that value."""
    values = [e for e in zone if e.tag == "PDV"]
    kinds = [e.attrib["A"].upper().zfill(4) for e in values]
    if SETPOINT_RATE not in kinds:
        raise ValueError(
            f"treatment zone {zone.get('A')} sets {', '.join(kinds) or 'nothing'}, where a sprayer "
            f"wants {SETPOINT_RATE}, volume per area"
        )
    at = kinds.index(SETPOINT_RATE)
    return at, float(values[at].attrib["B"])


def _read_areas(polygon: ET.Element) -> list[Rings]:
    """Read the outer rings of a polygon, each with all inner ones: those of others cut nothing."""
    lines = [e for e in polygon if e.tag == "LSG"]
    rings = [[(float(p.attrib["D"]), float(p.attrib["C"])) for p in line] for line in lines]
    is_inner = [line.get("A") == _INNER for line in lines]
    inner = [ring for ring, inside in zip(rings, is_inner, strict=True) if inside]
    return [[ring, *inner] for ring, inside in zip(rings, is_inner, strict=True) if not inside]


def _read_grid(grid: ET.Element, zones: dict[int, ET.Element], files: dict[str, bytes]) -> RateGrid:
    south, west, north_size, east_size = (float(grid.attrib[key]) for key in "ABCD")
    columns, rows = int(grid.attrib["E"]), int(grid.attrib["F"])
    if not all(map(math.isfinite, (south, west, north_size, east_size))):
        raise ValueError("its grid has a corner or cells that are no numbers")
    if north_size <= 0.0 or east_size <= 0.0:
        raise ValueError(
            "its grid is mirrored: cells have to grow to the North and to the East, sizes are "
            f"{north_size:g} and {east_size:g} degrees"
        )
    if not (rows > 0 and columns > 0 and rows * columns <= MAX_CELLS):
        raise ValueError(f"its grid has {rows} by {columns} cells, where {MAX_CELLS} are the most")
    name = f"{PurePosixPath(grid.attrib['G']).stem.upper()}.BIN"
    if name not in files:
        raise ValueError(f"{name}, which has the cells of its grid, is not in the archive")
    read = _read_codes if grid.get("I") == "1" else _read_values
    rates = read(grid, zones, files[name], (rows, columns))
    return RateGrid(south, west, north_size, east_size, rates)


def _read_codes(
    _grid: ET.Element, zones: dict[int, ET.Element], data: bytes, shape: tuple[int, int]
) -> npt.NDArray[np.float64]:
    """Read a grid of type 1: the code of a treatment zone in each cell."""
    _check_length(data, shape[0] * shape[1])
    codes = np.frombuffer(data, np.uint8).reshape(shape)
    unknown = sorted(set(np.unique(codes).tolist()) - zones.keys())
    if unknown:
        raise ValueError(
            f"its grid names the treatment zones {', '.join(map(str, unknown[:8]))}, which it does "
            "not have: ids are swapped, or zones are missing"
        )
    rate_of = np.zeros(256)
    for code, zone in zones.items():
        rate_of[code] = _read_rate(zone)
    return rate_of[codes]


def _read_values(
    grid: ET.Element, zones: dict[int, ET.Element], data: bytes, shape: tuple[int, int]
) -> npt.NDArray[np.float64]:
    """Read a grid of type 2: in each cell a number for each value of one treatment zone."""
    zone = zones.get(int(grid.get("J", "-1")))
    if grid.get("I") != "2" or zone is None:
        raise ValueError(f"its grid is of type {grid.get('I')} with zone {grid.get('J')}")
    at, _ = _find_value(zone)
    count = sum(e.tag == "PDV" for e in zone)
    _check_length(data, 4 * count * shape[0] * shape[1])
    values = np.frombuffer(data, "<i4").reshape(*shape, count)[:, :, at]
    return values / MM3PM2_PER_LPHA


def _check_length(data: bytes, wanted: int) -> None:
    if len(data) != wanted:
        raise ValueError(f"its grid has {len(data)} bytes where {wanted} are wanted: cut off")
