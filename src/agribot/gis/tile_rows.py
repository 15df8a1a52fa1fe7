"""Find the side from which an MBTiles file counts its rows.

The specification counts from the south (TMS). Many programs write rows from the north (XYZ); some
state it in `scheme`, for others only `bounds` or `center` show it.
"""

from __future__ import annotations

import math
import sqlite3
from typing import Literal, NamedTuple

from agribot.core.errors import ConfigError, describe_range
from agribot.gis.tile_grid import MAX_ZOOM, GeoBounds, find_tile

Scheme = Literal["tms", "xyz"]
_LONGITUDE_LIMIT_DEG, _LATITUDE_LIMIT_DEG = 180.0, 90.0
_FROM_NORTH = ("xyz", "google")


class TileRange(NamedTuple):
    """The columns and rows at the finest zoom, rows as the file counts them."""

    zoom: int
    columns: tuple[int, int]
    rows: tuple[int, int]

    def find_bounds(self, scheme: Scheme) -> GeoBounds:
        """Find the place of the tiles on Earth, degrees."""
        last = 2**self.zoom - 1
        top, bottom = self.rows if scheme == "xyz" else (last - self.rows[1], last - self.rows[0])
        west, east = (
            360.0 * column / 2**self.zoom - 180.0
            for column in (self.columns[0], self.columns[1] + 1)
        )
        return GeoBounds(west, self._find_lat(bottom + 1), east, self._find_lat(top))

    def _find_lat(self, edge: int) -> float:
        return math.degrees(math.atan(math.sinh(math.pi * (1.0 - 2.0 * edge / 2**self.zoom))))


def flip_row(z: int, y: int, scheme: Scheme) -> int:
    """Convert a row that counts from the north to one of the file, and back."""
    return y if scheme == "xyz" else 2**z - 1 - y


def read_scheme(database: sqlite3.Connection) -> Scheme:
    return "xyz" if _read_text(database, "scheme").lower() in _FROM_NORTH else "tms"


def _read_text(database: sqlite3.Connection, name: str) -> str:
    found = database.execute("SELECT value FROM metadata WHERE name = ?", (name,)).fetchone()
    return str(found[0]).strip() if found else ""


def _read_center(database: sqlite3.Connection) -> GeoBounds | None:
    """Read the place in the middle as bounds without a size; None without one."""
    try:
        lon_deg, lat_deg = (float(word) for word in _read_text(database, "center").split(",")[:2])
    except ValueError:
        return None
    center = GeoBounds(lon_deg, lat_deg, lon_deg, lat_deg)
    return (
        center
        if abs(lon_deg) <= _LONGITUDE_LIMIT_DEG and abs(lat_deg) <= _LATITUDE_LIMIT_DEG
        else None
    )


def find_scheme(database: sqlite3.Connection, bounds: list[float], name: str) -> Scheme:
    """Find the order of the rows: what the file says, or what alone fits its `bounds` or `center`.

    Raises: ConfigError: `bounds` are no place on Earth, or fit the tiles in neither order.
    """
    stated = read_scheme(database)
    tiles = _read_range(database, name)
    other: Scheme = "tms" if stated == "xyz" else "xyz"
    orders: tuple[Scheme, ...] = (stated, other)
    if bounds:
        if not _is_place(bounds):
            what = "are no place on Earth"
            raise ConfigError(_refuse(name, bounds, tiles.find_bounds(stated), what))
        orders = tuple(one for one in orders if _overlap(tiles, one, GeoBounds(*bounds)))
    if not orders:
        why = "fit its tiles whether rows count from north or from south"
        raise ConfigError(_refuse(name, bounds, tiles.find_bounds(stated), f"do not {why}"))
    center = _read_center(database)
    fitting = [one for one in orders if center is not None and _overlap(tiles, one, center)]
    return (*fitting, *orders)[0]


def _read_range(database: sqlite3.Connection, name: str) -> TileRange:
    zoom, *edges = database.execute(
        "SELECT zoom_level, min(tile_column), max(tile_column), min(tile_row), max(tile_row)"
        " FROM tiles WHERE zoom_level = (SELECT max(zoom_level) FROM tiles)"
    ).fetchone()
    if not all(isinstance(value, int) for value in (zoom, *edges)) or not 0 <= zoom <= MAX_ZOOM:
        raise ConfigError(f"{name}: zoom {zoom} of its tiles: {describe_range(0, MAX_ZOOM)}")
    return TileRange(zoom, (edges[0], edges[1]), (edges[2], edges[3]))


def _is_place(bounds: list[float]) -> bool:
    if len(bounds) != 4:
        return False
    west, south, east, north = bounds
    return (
        -_LONGITUDE_LIMIT_DEG <= west < east <= _LONGITUDE_LIMIT_DEG
        and -_LATITUDE_LIMIT_DEG <= south < north <= _LATITUDE_LIMIT_DEG
    )


def _overlap(tiles: TileRange, scheme: Scheme, place: GeoBounds) -> bool:
    """Return whether tiles overlap a place."""
    first = find_tile(place.north_deg, place.west_deg, tiles.zoom)
    last = find_tile(place.south_deg, place.east_deg, tiles.zoom)
    rows = sorted(flip_row(tiles.zoom, row, scheme) for row in tiles.rows)
    return (
        tiles.columns[0] <= last.x
        and tiles.columns[1] >= first.x
        and rows[0] <= last.y
        and rows[1] >= first.y
    )


def _refuse(name: str, bounds: list[float], tiles: GeoBounds, what: str) -> str:
    stated = ",".join(f"{edge:g}" for edge in bounds)
    return (
        f"{name}: its bounds {stated} {what}; they are west,south,east,north in degrees, and its "
        f"tiles cover {tiles.to_text()}; correct the row 'bounds' of its table 'metadata'"
    )
