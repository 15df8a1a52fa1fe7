"""SQLite files are read with what lies beside them, and nothing beside them changes."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from agribot.core.sqlite_file import open_sqlite, read_with_log

ROWS = [(number,) for number in range(6)]


@pytest.fixture
def live(tmp_path: Path) -> Iterator[Path]:
    """A file whose rows are all in its log, as another program has it open."""
    path = tmp_path / "live.db"
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("CREATE TABLE rows (number INTEGER)")
        database.executemany("INSERT INTO rows VALUES (?)", ROWS)
        database.commit()
        yield path


def _read(path: Path) -> list[tuple[int]]:
    with open_sqlite(path) as database:
        return database.execute("SELECT number FROM rows ORDER BY number").fetchall()


def _copy(path: Path, folder: Path, *endings: str) -> Path:
    folder.mkdir()
    for ending in ("", *endings):
        shutil.copyfile(f"{path}{ending}", folder / f"{path.name}{ending}")
    return folder / path.name


def _list_files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_file_that_another_program_has_open_is_read_with_its_log(live: Path) -> None:
    assert _read(live) == ROWS


def test_the_log_of_a_program_that_was_killed_is_read_and_left_as_it_is(
    live: Path, tmp_path: Path
) -> None:
    left = _copy(live, tmp_path / "left", "-wal")
    before = _list_files(left.parent)
    assert _read(left) == ROWS
    assert _list_files(left.parent) == before


def test_a_log_is_read_where_nothing_can_be_written_beside_it(live: Path, tmp_path: Path) -> None:
    left = _copy(live, tmp_path / "left", "-wal")
    Path(f"{left}-shm").mkdir()  # as in a folder that is read-only, SQLite cannot make its index
    assert _read(left) == ROWS


def test_a_change_that_was_not_finished_is_taken_back(tmp_path: Path) -> None:
    path = tmp_path / "old.db"
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("CREATE TABLE rows (number INTEGER, text TEXT)")
        database.executemany("INSERT INTO rows VALUES (?, 'x')", ROWS)
        database.execute("PRAGMA cache_size = 1")
        database.execute("BEGIN")
        database.execute("UPDATE rows SET number = 99, text = hex(zeroblob(20000))")
        left = _copy(path, tmp_path / "left", "-journal")
    assert _read(left) == ROWS


def test_a_file_that_was_closed_is_read_whatever_its_mode(live: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(live)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    closed = _copy(live, tmp_path / "closed")
    assert _read(closed) == ROWS
    assert set(_list_files(closed.parent)) == {"live.db"}


def test_the_bytes_of_a_file_hold_its_log_and_open_in_memory(live: Path) -> None:
    with closing(sqlite3.connect(":memory:")) as database:
        database.deserialize(read_with_log(live))
        assert database.execute("SELECT number FROM rows").fetchall() == ROWS


def test_what_is_no_database_is_an_error_of_sqlite(tmp_path: Path) -> None:
    (tmp_path / "text.db").write_text("no database" * 100)
    with pytest.raises(sqlite3.DatabaseError, match="not a database"):
        _read(tmp_path / "text.db")
