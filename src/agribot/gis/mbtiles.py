"""Offline map tiles: MBTiles files in one folder, read and written with SQLite only."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, Self

from agribot.core.errors import ConfigError
from agribot.core.sqlite_file import PATIENCE_S, limit_work, open_sqlite
from agribot.core.whole_file import make_at_once
from agribot.gis.tile_grid import MAX_ZOOM
from agribot.gis.tile_rows import find_scheme, flip_row, read_scheme

_MEDIA = ((b"\x89PNG", "image/png"), (b"\xff\xd8", "image/jpeg"), (b"RIFF", "image/webp"))
LIVE = "agribot_live"  # metadata: address template of the server for missing tiles
SERVER = "agribot_server"  # metadata: a checksum of that template, of a map that came from one
MAX_STEPS = 200_000_000  # enough to count ten million tiles; a view may be an endless program
MAX_VALUE_BYTES = 50_000_000


def _is_stopped(error: sqlite3.Error) -> bool:
    return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_INTERRUPT


def find_maps(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.glob("*.mbtiles"))}


def describe_map(path: Path, shown: str = "") -> dict[str, Any]:
    """Return name, zooms, bounds (west, south, east, north), degrees, and attribution.

    Refusals call the file `shown`, its path by default.

    Raises: ConfigError: no MBTiles file, or an empty one that no server fills.
    """
    try:
        with closing(_open_read_only(path)) as database:
            known = dict(database.execute("SELECT name, value FROM metadata").fetchall())
            low, high, count = database.execute(
                "SELECT min(zoom_level), max(zoom_level), count(*) FROM tiles"
            ).fetchone()
    except sqlite3.Error as error:
        reason = "it takes too long to count its tiles" if _is_stopped(error) else error
        raise ConfigError(
            f"{shown or path} is no MBTiles file: {reason}; export it anew"
        ) from error
    is_live = LIVE in known
    if not count and not is_live:
        raise ConfigError(f"{shown or path} holds no tiles; export it anew")
    try:
        bounds = [float(edge) for edge in known.get("bounds", "").split(",") if edge]
        if is_live:
            low, high = int(known["minzoom"]), int(known["maxzoom"])
    except (KeyError, ValueError, AttributeError, TypeError) as error:
        raise ConfigError(
            f"{shown or path} has broken metadata: {error}; export it anew"
        ) from error
    return {
        "name": path.stem,
        "minzoom": low,
        "maxzoom": high,
        "tiles": count,
        "bounds": bounds or None,
        "attribution": known.get("attribution", ""),
        "format": known.get("format", ""),
        "live": is_live,
    }


def read_tile(path: Path, z: int, x: int, y: int) -> bytes | None:
    """Read a tile by its XYZ address."""
    if not is_address(z, x, y):
        return None
    with closing(_open_read_only(path)) as database:
        found = database.execute(
            "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?",
            (z, x, flip_row(z, y, read_scheme(database))),
        ).fetchone()
    return None if found is None else bytes(found[0])


def is_address(z: int, x: int, y: int) -> bool:
    return 0 <= z <= MAX_ZOOM and 0 <= x < 2**z and 0 <= y < 2**z


def read_live_template(path: Path) -> str:
    """Return the address template for missing tiles; empty for a complete map."""
    return read_note(path, LIVE)


def read_note(path: Path, name: str) -> str:
    """Read a value of a map's metadata, or an empty string."""
    with closing(_open_read_only(path)) as database:
        found = database.execute("SELECT value FROM metadata WHERE name = ?", (name,)).fetchone()
    return str(found[0]) if found else ""


def find_media_type(data: bytes) -> str:
    return next((name for head, name in _MEDIA if data.startswith(head)), "application/x-protobuf")


def is_picture(data: bytes) -> bool:
    return any(data.startswith(head) for head, _ in _MEDIA)


def import_mbtiles(source: Path, folder: Path, name: str) -> dict[str, Any]:
    """Copy a file into the folder, with what its log holds and the order of its rows.

    Raises: ConfigError: not readable, no MBTiles file, without tiles, or with bounds elsewhere.
    """
    if not source.is_file():
        raise ConfigError(f"map file {source} does not exist; check the path")
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{name}.mbtiles"
    make_at_once(target, lambda beside: _take_in(source, beside))
    return describe_map(target)


def _take_in(source: Path, target: Path) -> None:
    try:
        with open_sqlite(source) as found, closing(sqlite3.connect(target)) as copy:
            found.backup(copy)
            copy.execute("PRAGMA journal_mode = DELETE")
        known = describe_map(target, source.name)
        if not known["live"]:
            _note_scheme(target, known["bounds"] or [], source.name)
    except sqlite3.Error as error:
        raise ConfigError(f"{source} is no MBTiles file: {error}; export it anew") from error


def _note_scheme(target: Path, bounds: list[float], name: str) -> None:
    with closing(sqlite3.connect(target)) as copy:
        limit_work(copy, MAX_STEPS)
        scheme = find_scheme(copy, bounds, name)
        if scheme != read_scheme(copy):
            copy.execute("DELETE FROM metadata WHERE name = 'scheme'")
            copy.execute("INSERT INTO metadata (name, value) VALUES ('scheme', ?)", (scheme,))
            copy.commit()


class TileWriter:
    """Adds tiles to a file; existing ones stay, so that an interrupted import can continue.

    Raises: ConfigError: the file cannot be written, or is no MBTiles file.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._database = sqlite3.connect(path, timeout=PATIENCE_S)
            self._database.executescript(
                "CREATE TABLE IF NOT EXISTS metadata (name TEXT PRIMARY KEY, value TEXT);"
                "CREATE TABLE IF NOT EXISTS tiles (zoom_level INTEGER, tile_column INTEGER,"
                " tile_row INTEGER, tile_data BLOB,"
                " PRIMARY KEY (zoom_level, tile_column, tile_row));"
            )
            self.describe(metadata)
            self._scheme = read_scheme(self._database)
        except (OSError, sqlite3.Error) as error:
            raise ConfigError(
                f"cannot write the map {path}: {error}; free some disk space"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._database.commit()
        self._database.close()

    def describe(self, metadata: Mapping[str, str]) -> None:
        rows = list(metadata.items())
        self._database.executemany("INSERT OR REPLACE INTO metadata VALUES (?, ?)", rows)
        self._database.commit()

    def has(self, z: int, x: int, y: int) -> bool:
        query = "SELECT 1 FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        return (
            self._database.execute(query, (z, x, flip_row(z, y, self._scheme))).fetchone()
            is not None
        )

    def put(self, z: int, x: int, y: int, data: bytes) -> None:
        row = (z, x, flip_row(z, y, self._scheme), data)
        self._database.execute("INSERT OR REPLACE INTO tiles VALUES (?, ?, ?, ?)", row)


def _open_read_only(path: Path) -> sqlite3.Connection:
    """Open a file read-only, for one request: threads cannot share a connection of SQLite."""
    where = f"{path.resolve().as_uri()}?mode=ro"
    database = sqlite3.connect(where, uri=True, timeout=PATIENCE_S)
    limit_work(database, MAX_STEPS)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
    return database
