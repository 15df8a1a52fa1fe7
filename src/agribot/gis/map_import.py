"""Tiles of others in one file: PMTiles archives and tile servers."""

from __future__ import annotations

import hashlib
import http.client
import itertools
import sqlite3
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from agribot.core.errors import ConfigError
from agribot.core.extras import format_install
from agribot.gis.mbtiles import (
    LIVE,
    SERVER,
    TileWriter,
    describe_map,
    is_picture,
    read_note,
)
from agribot.gis.tile_grid import MAX_ZOOM, GeoBounds, MapTile, count_tiles, iterate_tiles

if TYPE_CHECKING:
    pass

MAX_TILES = 200_000
PARALLEL = 6
TIMEOUT_S = 20.0
MAX_TILE_BYTES = 2_000_000
AGENT = "agribot (offline maps of a field robot)"

NONE_THERE = (404, 410)  # answers of a server that has no tile at an address
Report = Callable[[int, int], None]  # tiles done, tiles in all


class MissingTiles(NamedTuple):
    """Tiles that did not come: `absent` the server has not, `failed` it may give another time.

    `why` is what the last failure said.
    """

    absent: int
    failed: int
    why: str


def import_pmtiles(source: Path, target: Path, report: Report) -> tuple[str, ...]:
    """Import a PMTiles archive.

    Raises: ConfigError: no PMTiles archive, or one of vector tiles.
    """
    try:
        from pmtiles.reader import MmapSource, Reader, all_tiles
    except ImportError as error:
        raise make_missing_error("pmtiles") from error
    if not source.is_file():
        raise ConfigError(f"map file {source} does not exist; check the path")
    with source.open("rb") as file:
        try:
            get_bytes = MmapSource(file)  # an empty file cannot be mapped
            header = Reader(get_bytes).header()
            tiles: Iterator[tuple[tuple[int, int, int], bytes]] = all_tiles(get_bytes)
            first = next(tiles, None)
        except Exception as error:  # the library's own errors have no common base
            raise ConfigError(
                f"{source.name} is no PMTiles archive: {error}; copy it anew"
            ) from error
        if first is None or not is_picture(first[1]):
            raise ConfigError(f"{source.name} holds no raster tiles; use one of PNG, JPEG or WebP")
        degrees = (
            header[f"{edge}_e7"] / 1e7 for edge in ("min_lon", "min_lat", "max_lon", "max_lat")
        )
        low, high = header["min_zoom"], header["max_zoom"]
        count = header.get("addressed_tiles_count") or 0
        metadata = make_metadata(target, GeoBounds(*degrees), low, high, "")
        with TileWriter(target, metadata) as writer:
            for done, (address, data) in enumerate(itertools.chain([first], tiles), start=1):
                writer.put(*address, data)
                report(done, max(count, done))
    return ()


def import_from_server(
    template: str, target: Path, bounds: GeoBounds, zooms: tuple[int, int], attribution: str,
    report: Report,
) -> MissingTiles:  # fmt: skip
    """Fetch a region once; tiles that are there already are not requested again.

    Raises: ConfigError: no template, too many tiles, a map of something else under that name, or
        the server does not give any.
    """
    check_template(template)
    count, absent, failed, why = check_count(bounds, *zooms), 0, 0, ""
    is_new = _begins_new(target, template)
    about = {"attribution": attribution, SERVER: _sum_up(template)}
    joined = (bounds, zooms) if is_new else _join_extent(target, bounds, zooms)
    metadata = {**make_metadata(target, joined[0], *joined[1], ""), **about}
    with (
        TileWriter(target, metadata if is_new else {}) as writer,
        ThreadPoolExecutor(PARALLEL) as pool,
    ):
        missing = (tile for tile in iterate_tiles(bounds, *zooms) if not writer.has(*tile))
        done = count - sum(not writer.has(*tile) for tile in iterate_tiles(bounds, *zooms))
        while batch := list(itertools.islice(missing, PARALLEL * 4)):
            for tile, answer in zip(batch, pool.map(lambda t: _try_fetch(template, t), batch),
                                    strict=True):  # fmt: skip
                done += 1
                if isinstance(answer, bytes):
                    writer.put(*tile, answer)
                elif getattr(answer, "code", None) in NONE_THERE:
                    absent += 1
                else:
                    failed += 1
                why = why if isinstance(answer, bytes) else str(answer)
                report(done, count)
        if absent + failed < count:
            writer.describe(metadata)
    if absent + failed == count:
        if is_new:
            target.unlink()
        raise ConfigError(f"no tile came from {template}: {why}; check the address and --bbox")
    return MissingTiles(absent, failed, why)


def register_server(template: str, target: Path, zooms: tuple[int, int], attribution: str) -> None:
    """Register a map whose tiles are fetched when they are first shown, and then kept.

    Raises: ConfigError: no template, or a map of something else under that name.
    """
    check_template(template)
    _begins_new(target, template)
    world = GeoBounds(-180.0, -85.0, 180.0, 85.0)
    metadata = {
        **make_metadata(target, world, *zooms, ""),
        "attribution": attribution,
        LIVE: template,
        SERVER: _sum_up(template),
    }
    with TileWriter(target, metadata):
        pass


def _begins_new(target: Path, template: str) -> bool:
    """Return whether there is no map yet.

    Raises: ConfigError: there is a map of another source.
    """
    if not target.exists():
        return True
    try:
        server, live = read_note(target, SERVER), read_note(target, LIVE)
    except sqlite3.Error:
        server = live = ""
    if template == live or _sum_up(template) == server:
        return False
    came = "another address" if server or live else "elsewhere"
    raise ConfigError(
        f"there is a map '{target.stem}' already, whose tiles came from {came}; take another "
        f"--name, or first: agribot map remove {target.stem}"
    )


def _sum_up(template: str) -> str:
    """Sum an address up: it may hold a key, which others who get the map need not know."""
    return hashlib.sha256(template.encode()).hexdigest()


def _join_extent(
    target: Path, bounds: GeoBounds, zooms: tuple[int, int]
) -> tuple[GeoBounds, tuple[int, int]]:
    """Join a region with that of the map which it comes to."""
    try:
        known = describe_map(target)
    except ConfigError:  # no tile came yet
        return bounds, zooms
    old = GeoBounds(*known["bounds"]) if known["bounds"] else bounds
    joined = (
        *map(min, bounds[:2], old[:2]),
        *map(max, bounds[2:], old[2:]),
    )
    first, last = min(zooms[0], known["minzoom"]), max(zooms[1], known["maxzoom"])
    return GeoBounds(*joined), (first, last)


def fetch_tile(template: str, tile: MapTile) -> bytes:
    """Fetch a tile from a server.

    Raises: OSError: no answer. ValueError: the answer is no picture up to MAX_TILE_BYTES.
    """
    url = template.format(z=tile.z, x=tile.x, y=tile.y)
    request = urllib.request.Request(url, headers={"User-Agent": AGENT})
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
            data: bytes = answer.read(MAX_TILE_BYTES + 1)
    except urllib.error.HTTPError as error:
        error.close()
        raise
    except http.client.HTTPException as error:  # an answer that is no HTTP, or no address
        raise OSError(f"{url}: {type(error).__name__}: {error}") from error
    if len(data) > MAX_TILE_BYTES or not is_picture(data):
        raise ValueError(f"{url} gave {len(data)} bytes that are no picture of a tile")
    return data


def check_template(template: str) -> None:
    """Check the address template of a tile server.

    Raises: ConfigError: not an address of a tile server.
    """
    try:
        filled = template.format(z=1, x=1, y=0)
    except (KeyError, IndexError, ValueError):
        filled = ""
    is_filled = all(template.count(f"{{{name}}}") == 1 for name in "zxy")
    if not filled.startswith(("http://", "https://")) or not is_filled:
        raise ConfigError(
            f"{template} is no address of a tile server; write it as in "
            "https://tiles.example/{z}/{x}/{y}.png"
        )


def _try_fetch(template: str, tile: MapTile) -> bytes | Exception:
    try:
        return fetch_tile(template, tile)
    except (OSError, ValueError) as error:
        return error


def check_count(bounds: GeoBounds, first: int, last: int) -> int:
    if not 0 <= first <= last <= MAX_ZOOM:
        raise ConfigError(f"zooms {first} to {last}: not in order; give two of 0 to {MAX_ZOOM}")
    count = count_tiles(bounds, first, last)
    if count > MAX_TILES:
        raise ConfigError(
            f"that would be {count} tiles, more than {MAX_TILES}; choose a smaller region or zoom"
        )
    return count


def make_metadata(
    target: Path, bounds: GeoBounds, first: int, last: int, picture_format: str
) -> dict[str, str]:
    metadata = {"name": target.stem, "bounds": bounds.to_text(), "minzoom": str(first),
            "maxzoom": str(last), "type": "baselayer"}  # fmt: skip
    return {**metadata, "format": picture_format} if picture_format else metadata


def make_missing_error(package: str) -> ConfigError:
    return ConfigError(f"this needs {package}; install it with {format_install('maps')}")
