"""Prescription maps: zones with rates as polygons of any field format, or as ISOXML."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.autonomy.implements.zones import ZoneMap
from agribot.core.errors import MissionError, has_advice
from agribot.core.facts import (
    Elsewhere,
    FileBroken,
    FileEmpty,
    NotInDegrees,
    RateOutside,
    ZoneCrosses,
    ZonesElsewhere,
    ZonesFar,
    ZoneShort,
)
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import FloatArray
from agribot.gis.formats.isoxml import holds_task_data
from agribot.gis.formats.table import read_areas_file
from agribot.gis.formats.untrusted import list_members
from agribot.gis.isoxml_zones import RateGrid, read_task_zones

if TYPE_CHECKING:
    import shapely

COLUMNS = ("rate", "rate_lpha", "dose", "target", "targetrate", "target_rate", "rx", "value")
MAX_RATE_LPHA = 5000.0
MAX_EXTENT_M = 20_000.0
MAX_CELLS = 4_000_000
LEAST_CELL_M = 0.1
_LEAST_CORNERS = 3
_PLACES = 400  # places that a field is asked for


class Zone(NamedTuple):
    """A polygon of longitudes and latitudes, its outer ring first, and its rate."""

    rings_deg: Sequence[Sequence[Sequence[float]]]
    rate_lpha: float


def read_prescription(name: str, data: bytes, datum: Datum, column: str = "") -> ZoneMap:
    """Read a prescription into the map of a datum; `column` has the rates, where names are odd.

    Raises: MissionError: no prescription, a broken one, other coordinates, or invalid rates.
    """
    shown = f"'{name[:80]}'"
    if not data:
        raise MissionError(FileEmpty(shown))
    parts: Sequence[Zone | RateGrid]
    try:
        if PurePath(name).suffix.lower() == ".zip" and holds_task_data(list_members(data)):
            parts = [_as_zone(part) for part in read_task_zones(data)]
        else:
            parts = [*_read_polygons(name, data, column)]
    except MissionError:
        raise
    except Exception as error:  # the archive's, the XML's and the numbers' own errors
        reason = " ".join(str(error).split()) or "it is cut off"
        raise MissionError(FileBroken(shown, reason, has_advice(reason))) from error
    _check_rates(parts, shown)
    return _draw(parts, MapFrame(datum), shown)


def _as_zone(part: RateGrid | tuple[Any, float]) -> Zone | RateGrid:
    return part if isinstance(part, RateGrid) else Zone(*part)


def _read_polygons(name: str, data: bytes, column: str) -> Iterator[Zone]:
    features = read_areas_file(name, data)
    areas = [f for f in features if f["geometry"]["type"] == "Polygon"]
    if not areas:
        raise ValueError("no zone in it; draw polygons with a rate")
    for number, area in enumerate(areas, 1):
        columns = {key.lower(): value for key, value in area["properties"].items()}
        wanted = [column.lower()] if column else [name for name in COLUMNS if name in columns]
        value = columns.get(wanted[0]) if wanted else None
        if value is None:
            known = ", ".join(sorted(columns.keys() - {"kind", "name"}))[:200] or "none"
            raise ValueError(
                f"zone {number} has no rate; its columns: {known}; name the one with litres per "
                "hectare, treatment.prescription_column"
            )
        yield Zone(area["geometry"]["coordinates"], float(value))


def _check_rates(parts: Sequence[Zone | RateGrid], shown: str) -> None:
    rates = np.concatenate([np.ravel(part.rate_lpha).astype(float) for part in parts])
    wrong = ~((rates >= 0.0) & (rates <= MAX_RATE_LPHA)) & ~np.isnan(rates)
    if wrong.any() or np.isnan(rates).all():
        value = rates[wrong][0] if wrong.any() else math.nan
        raise MissionError(RateOutside(shown, float(value), MAX_RATE_LPHA))


def _draw(parts: Sequence[Zone | RateGrid], frame: MapFrame, shown: str) -> ZoneMap:
    """Draw the zones on cells; where several overlap, the lowest rate counts."""
    corners = np.concatenate([_list_corners(part) for part in parts])
    if not (np.abs(corners) <= (180.0, 90.0)).all():
        raise MissionError(NotInDegrees(shown))
    xy_m = frame.map_from_lonlat(corners)
    away_m = float(np.hypot(xy_m[:, 0], xy_m[:, 1]).max())
    if away_m > MAX_EXTENT_M:
        is_other = _is_near(frame, corners[:, ::-1])
        raise MissionError(ZonesFar(shown, away_m, "exchanged" if is_other else "other"))
    low_m, high_m = xy_m.min(axis=0), xy_m.max(axis=0)
    side_m = np.maximum(high_m - low_m, LEAST_CELL_M)
    cell_m = max(LEAST_CELL_M, math.sqrt(float(side_m.prod()) / MAX_CELLS))
    columns, rows = (math.ceil(side / cell_m) for side in side_m.tolist())
    x, y = np.meshgrid(
        low_m[0] + (np.arange(columns) + 0.5) * cell_m, low_m[1] + (np.arange(rows) + 0.5) * cell_m
    )
    places_deg = frame.lonlat_from_map(np.column_stack([x.ravel(), y.ravel()]))
    rates = np.full(len(places_deg), np.nan)
    for part in parts:
        rates = np.fmin(rates, _rate_places(part, places_deg))
    grid: npt.NDArray[np.float32] = rates.reshape(rows, columns).astype(np.float32)
    return ZoneMap(float(low_m[0]), float(low_m[1]), cell_m, grid)


def _is_near(frame: MapFrame, lonlat_deg: FloatArray) -> bool:
    if not (np.abs(lonlat_deg) <= (180.0, 90.0)).all():
        return False
    xy_m = frame.map_from_lonlat(lonlat_deg)
    return bool(np.hypot(xy_m[:, 0], xy_m[:, 1]).max() <= MAX_EXTENT_M)


def _list_corners(part: Zone | RateGrid) -> FloatArray:
    if isinstance(part, RateGrid):
        rows, columns = part.rate_lpha.shape
        east = part.west_deg + columns * part.cell_east_deg
        north = part.south_deg + rows * part.cell_north_deg
        if part.west_deg <= 180.0 < east:  # over the antimeridian
            east -= 360.0
        return np.array([[part.west_deg, part.south_deg], [east, north]])
    return np.array([point[:2] for point in part.rings_deg[0]], dtype=float)


def _rate_places(part: Zone | RateGrid, places_deg: FloatArray) -> FloatArray:
    """Rates at places (N, 2) of longitude and latitude; NaN outside."""
    if isinstance(part, RateGrid):
        rows, columns = part.rate_lpha.shape
        east_deg = _unwrap_deg(places_deg[:, 0] - part.west_deg)
        column = np.floor(east_deg / part.cell_east_deg).astype(np.int64)
        row = np.floor((places_deg[:, 1] - part.south_deg) / part.cell_north_deg).astype(np.int64)
        is_inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        found = part.rate_lpha[np.where(is_inside, row, 0), np.where(is_inside, column, 0)]
        return np.where(is_inside, found, np.nan)
    import shapely

    rings = [np.array([point[:2] for point in ring], dtype=float) for ring in part.rings_deg]
    fewest = min(map(len, rings))
    if fewest < _LEAST_CORNERS:
        raise MissionError(ZoneShort(fewest))
    first_deg = rings[0][0, 0]
    for ring in rings:
        ring[:, 0] = _unwrap_deg(ring[:, 0] - first_deg)
    areas = [shapely.Polygon(ring) for ring in rings]
    for area in areas:
        if not area.is_valid:
            place = _locate_fault(area, first_deg)
            raise MissionError(ZoneCrosses(place))
    # Also holes that touch the edge, as a difference in QGIS leaves them.
    polygon = areas[0].difference(shapely.union_all(areas[1:]))
    east_deg = _unwrap_deg(places_deg[:, 0] - first_deg)
    is_inside = shapely.contains_xy(polygon, east_deg, places_deg[:, 1])
    return np.where(is_inside, part.rate_lpha, np.nan)


def _locate_fault(area: shapely.Polygon, first_deg: float) -> str:
    """Locate where an area that begins at a longitude crosses itself."""
    import shapely

    east, north = re.findall(r"-?[\d.]+(?:e-?\d+)?", shapely.is_valid_reason(area))[:2]
    return f"latitude {float(north):.7f}, longitude {first_deg + float(east):.7f}"


def _unwrap_deg(degrees: FloatArray) -> FloatArray:
    """Take differences of longitude the short way round; near zero they stay as they are."""
    near: FloatArray = degrees - 360.0 * np.round(degrees / 360.0)
    return near


def check_covers(
    zones: ZoneMap, rows_map_m: Sequence[FloatArray], datum: Datum, shown: str
) -> float:
    """Return which share of a field's lines, (N, 2) each, lies in zones.

    Raises: MissionError: nothing of it does; a likely reason is named.
    """
    places_m = np.concatenate([_fill_line(line) for line in rows_map_m])
    share = _compute_share(zones, places_m)
    if share > 0.0:
        return share
    frame = MapFrame(datum)
    exchanged = frame.lonlat_from_map(places_m)[:, ::-1]
    mirrors: dict[Elsewhere, FloatArray] = {
        "east_west": places_m * (-1.0, 1.0),
        "north_south": places_m * (1.0, -1.0),
        "exchanged": frame.map_from_lonlat(exchanged) if _is_near(frame, exchanged) else places_m,
    }
    found = (why for why, at in mirrors.items() if _compute_share(zones, at) > 0.5)
    raise MissionError(ZonesElsewhere(shown, next(found, "other")))


def _compute_share(zones: ZoneMap, places_m: FloatArray) -> float:
    return float(np.isfinite(zones.find_rates(places_m[:, 0], places_m[:, 1])).mean())


def _fill_line(line_m: FloatArray) -> FloatArray:
    along = np.linspace(0.0, len(line_m) - 1.0, _PLACES)
    index = np.arange(len(line_m))
    return np.column_stack([np.interp(along, index, line_m[:, axis]) for axis in (0, 1)])
