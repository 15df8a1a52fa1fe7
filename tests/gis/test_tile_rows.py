"""Tiles lie where they belong, whichever way a file counts its rows."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.gis.mbtiles import describe_map, read_tile
from agribot.gis.tile_grid import GeoBounds, find_tile, iterate_tiles
from tests.gis.test_map_import import maps, png

__all__ = ["maps"]  # a fixture
FARM = GeoBounds(11.59, 48.19, 11.62, 48.21)


def _write(path: Path, counts_from: str, **metadata: str) -> None:
    """Write zooms 15 to 17 of a farm; red says the column of a tile, green its row from north."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute(
            "CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)"
        )
        database.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        for z, x, y in iterate_tiles(FARM, 15, 17):
            row = y if counts_from == "north" else 2**z - 1 - y
            data = png((x % 256, y % 256, z))
            database.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (z, x, row, data))
        database.commit()


@pytest.mark.parametrize("scheme", ["xyz", "tms", ""])
@pytest.mark.parametrize("bounds", [FARM.to_text(), ""])
@pytest.mark.parametrize("counts_from", ["north", "south"])
def test_every_tile_is_at_its_place_where_the_scheme_or_the_bounds_say_the_order(
    counts_from: str, bounds: str, scheme: str, tmp_path: Path, maps: Path
) -> None:
    is_stated = bool(bounds) or scheme == {"north": "xyz", "south": "tms"}[counts_from]
    is_default = counts_from == "south" and not scheme
    if not (is_stated or is_default):
        return  # nothing in the file says it
    metadata = {"bounds": bounds, "scheme": scheme}
    _write(tmp_path / "farm.mbtiles", counts_from, **{k: v for k, v in metadata.items() if v})
    assert main(["map", "import", str(tmp_path / "farm.mbtiles")]) == 0
    for z in (15, 16, 17):
        middle = find_tile(48.2, 11.605, z)
        for x, y in ((middle.x, middle.y), (middle.x + 1, middle.y - 1)):
            expected = png((x % 256, y % 256, z)) if (z, x, y) in _list_addresses() else None
            assert read_tile(maps / "farm.mbtiles", z, x, y) == expected


@pytest.mark.parametrize(
    "metadata",
    [
        {"center": "11.605,48.2,15"},
        {"center": "11.605, 48.2", "bounds": "-180.0,-85.0511,180.0,85.0511"},
        {"scheme": "google"},
    ],
)
def test_rows_from_north_are_found_by_the_middle_where_bounds_say_nothing(
    metadata: dict[str, str], tmp_path: Path, maps: Path
) -> None:
    _write(tmp_path / "farm.mbtiles", "north", **metadata)
    assert main(["map", "import", str(tmp_path / "farm.mbtiles")]) == 0
    z, x, y = find_tile(48.2, 11.605, 17)
    assert read_tile(maps / "farm.mbtiles", z, x, y) == png((x % 256, y % 256, z))


def _list_addresses() -> set[tuple[int, int, int]]:
    return {tuple(tile) for tile in iterate_tiles(FARM, 15, 17)}  # type: ignore[misc]


def test_tiles_that_are_kept_in_two_tables_are_read_from_north_too(
    tmp_path: Path, maps: Path
) -> None:
    """Many programs store equal pictures once; `tiles` is a view then."""
    path = tmp_path / "farm.mbtiles"
    _write(path, "north", scheme="xyz")
    with closing(sqlite3.connect(path)) as database:
        database.execute("ALTER TABLE tiles RENAME TO map")
        database.execute("CREATE VIEW tiles AS SELECT * FROM map")
    assert main(["map", "import", str(path)]) == 0
    z, x, y = find_tile(48.2, 11.605, 17)
    assert read_tile(maps / "farm.mbtiles", z, x, y) == png((x % 256, y % 256, z))


@pytest.mark.parametrize(
    ("bounds", "why"),
    [
        ("48.19,11.59,48.21,11.62", "do not fit its tiles"),
        ("72.78,21.16,72.79,21.17", "do not fit its tiles"),
        ("11.62,48.21,11.59,48.19", "are no place on Earth"),
        ("11.59,48.19", "are no place on Earth"),
        ("nan,48.19,11.62,48.21", "are no place on Earth"),
    ],
)
def test_bounds_that_are_those_of_another_place_are_refused_with_the_right_ones(
    bounds: str, why: str, tmp_path: Path, maps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _write(tmp_path / "farm.mbtiles", "south", bounds=bounds)
    assert main(["map", "import", str(tmp_path / "farm.mbtiles")]) == 2
    said = capsys.readouterr().err
    assert f"farm.mbtiles: its bounds {bounds} {why}" in said
    assert "its tiles cover 11.5878296,48.1898946,11.6207886,48.2100321" in said
    assert not list(maps.glob("*"))


def test_bounds_of_the_whole_world_say_nothing_of_the_rows(tmp_path: Path, maps: Path) -> None:
    _write(tmp_path / "farm.mbtiles", "north", scheme="xyz", bounds="-180,-85.0511,180,85.0511")
    assert main(["map", "import", str(tmp_path / "farm.mbtiles")]) == 0
    z, x, y = find_tile(48.2, 11.605, 17)
    assert read_tile(maps / "farm.mbtiles", z, x, y) == png((x % 256, y % 256, z))


def test_tiles_in_the_log_beside_a_file_are_taken_in(tmp_path: Path, maps: Path) -> None:
    path = tmp_path / "farm.mbtiles"
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)")
        database.execute("INSERT INTO tiles VALUES (1, 0, 1, ?)", (png((1, 2, 3)),))
        database.commit()
        assert main(["map", "import", str(path)]) == 0
    assert read_tile(maps / "farm.mbtiles", 1, 0, 0) == png((1, 2, 3))
    assert describe_map(maps / "farm.mbtiles")["tiles"] == 1


@pytest.mark.parametrize("address", [("'deep'", 0, 0), (99, 0, 0), (3, "'x'", 0), (-1, 0, 0)])
def test_tiles_with_addresses_that_are_none_are_refused(
    address: tuple[object, ...], tmp_path: Path, maps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _write(tmp_path / "farm.mbtiles", "south")
    with closing(sqlite3.connect(tmp_path / "farm.mbtiles")) as database:
        database.execute("DELETE FROM tiles")
        values = ", ".join(map(str, address))
        database.execute(f"INSERT INTO tiles VALUES ({values}, x'89504e47')")
        database.commit()
    assert main(["map", "import", str(tmp_path / "farm.mbtiles")]) == 2
    assert "farm.mbtiles: zoom" in capsys.readouterr().err
    assert not list(maps.glob("*"))
