"""Offline map tiles: MBTiles files in one folder, read with nothing but SQLite."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from agribot.errors import ConfigError

_MEDIA = ((b"\x89PNG", "image/png"), (b"\xff\xd8", "image/jpeg"), (b"RIFF", "image/webp"))
MAX_ZOOM = 24


def map_files(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.glob("*.mbtiles"))}


def described_map(path: Path) -> dict[str, Any]:
    """Name, zooms, bounds (west, south, east, north) and attribution.

    Raises: ConfigError: no MBTiles file.
    """
    try:
        with closing(_opened(path)) as database:
            known = dict(database.execute("SELECT name, value FROM metadata").fetchall())
            low, high, count = database.execute(
                "SELECT min(zoom_level), max(zoom_level), count(*) FROM tiles"
            ).fetchone()
    except sqlite3.Error as error:
        raise ConfigError(f"{path} is no MBTiles file: {error}") from error
    if not count:
        raise ConfigError(f"{path} holds no tiles")
    bounds = known.get("bounds")
    return {
        "name": path.stem,
        "minzoom": low,
        "maxzoom": high,
        "tiles": count,
        "bounds": [float(edge) for edge in bounds.split(",")] if bounds else None,
        "attribution": known.get("attribution", ""),
        "format": known.get("format", ""),
    }


def tile(path: Path, z: int, x: int, y: int) -> bytes | None:
    """The tile by its XYZ address; MBTiles count rows from the south."""
    if not 0 <= z <= MAX_ZOOM or not 0 <= x < 2**z or not 0 <= y < 2**z:
        return None
    with closing(_opened(path)) as database:
        found = database.execute(
            "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?",
            (z, x, 2**z - 1 - y),
        ).fetchone()
    return None if found is None else bytes(found[0])


def media_type(data: bytes) -> str:
    return next((name for head, name in _MEDIA if data.startswith(head)), "application/x-protobuf")


def import_mbtiles(source: Path, folder: Path, name: str) -> dict[str, Any]:
    """Copy a file into the folder once it is known to be good.

    Raises: ConfigError: not readable, no MBTiles file, or without tiles.
    """
    if not source.is_file():
        raise ConfigError(f"map file {source} does not exist; check the path")
    described_map(source)
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{name}.mbtiles"
    half = target.with_suffix(".writing")
    shutil.copyfile(source, half)
    half.replace(target)
    return described_map(target)


def _opened(path: Path) -> sqlite3.Connection:
    """Read-only, one connection for each request: SQLite's are not shared between threads."""
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
