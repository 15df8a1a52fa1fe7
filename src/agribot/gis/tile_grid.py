"""The grid of web map tiles: Web Mercator, 256 pixels, row 0 in the north.

Source: OGC 17-083r2, Two Dimensional Tile Matrix Set, WebMercatorQuad.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from agribot.core.arithmetic import clamp
from agribot.core.errors import ConfigError

TILE_PX = 256
MAX_ZOOM = 24
HALF_M = math.pi * 6378137.0  # half the side of the square of the whole world
MAX_LAT_DEG = 85.05112878


class GeoBounds(NamedTuple):
    west_deg: float
    south_deg: float
    east_deg: float
    north_deg: float

    def to_text(self) -> str:
        return ",".join(f"{edge:.7f}" for edge in self)


class MapTile(NamedTuple):
    z: int
    x: int
    y: int

    def compute_edges_m(self) -> tuple[float, float, float, float]:
        """Return left, bottom, right and top in Web Mercator."""
        side_m = 2.0 * HALF_M / 2**self.z
        left_m, top_m = self.x * side_m - HALF_M, HALF_M - self.y * side_m
        return left_m, top_m - side_m, left_m + side_m, top_m


def find_tile(lat_deg: float, lon_deg: float, z: int) -> MapTile:
    lat_rad = math.radians(clamp(lat_deg, -MAX_LAT_DEG, MAX_LAT_DEG))
    count = 2**z
    x = (lon_deg + 180.0) / 360.0 * count
    y = (1.0 - math.asinh(math.tan(lat_rad)) / math.pi) / 2.0 * count
    return MapTile(z, clamp(int(x), 0, count - 1), clamp(int(y), 0, count - 1))


def iterate_tiles(bounds: GeoBounds, first_zoom: int, last_zoom: int) -> Iterator[MapTile]:
    for z in range(first_zoom, last_zoom + 1):
        top_left = find_tile(bounds.north_deg, bounds.west_deg, z)
        bottom_right = find_tile(bounds.south_deg, bounds.east_deg, z)
        for x in range(top_left.x, bottom_right.x + 1):
            for y in range(top_left.y, bottom_right.y + 1):
                yield MapTile(z, x, y)


def count_tiles(bounds: GeoBounds, first_zoom: int, last_zoom: int) -> int:
    count = 0
    for z in range(first_zoom, last_zoom + 1):
        top_left = find_tile(bounds.north_deg, bounds.west_deg, z)
        bottom_right = find_tile(bounds.south_deg, bounds.east_deg, z)
        count += (bottom_right.x - top_left.x + 1) * (bottom_right.y - top_left.y + 1)
    return count


def parse_bounds(text: str) -> GeoBounds:
    """Parse west, south, east, north in degrees, separated by commas.

    Raises: ConfigError: not four numbers west, south, east, north in degrees.
    """
    try:
        bounds = GeoBounds(*(float(word) for word in text.split(",")))
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"--bbox {text}: not four numbers; write west,south,east,north in degrees"
        ) from error
    west, south, east, north = bounds
    if not (-180.0 <= west < east <= 180.0 and -90.0 <= south < north <= 90.0):
        raise ConfigError(
            f"--bbox {text}: not in order; give west below east, south below north, in degrees"
        )
    return bounds
