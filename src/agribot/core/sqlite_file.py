"""SQLite files of other programs, read with what lies beside them.

A program that writes, or that was killed, keeps part of a file beside it: new pages in `-wal`, or
in `-journal` the old ones of a change that was not finished. Nothing in the folder is changed.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

MAGIC = b"SQLite format 3\x00"
BESIDE = ("-wal", "-journal")
MAX_STEPS_AT_ONCE = 1_000_000
PATIENCE_S = 10.0  # while another program writes into the same file
_HEADER_BYTES, _LARGEST_PAGE_BYTES = 100, 65536
_PAGE_SIZE, _PAGES = slice(16, 18), slice(28, 32)
_WAL_VERSION, _VERSIONS = 2, slice(18, 20)  # bytes of the header: how to write and read the file


def limit_work(database: sqlite3.Connection, most_steps: int) -> None:
    """Interrupt a connection after `most_steps` steps of SQLite's virtual machine in total."""
    steps = iter(range(most_steps // MAX_STEPS_AT_ONCE))
    database.set_progress_handler(lambda: next(steps, None) is None, MAX_STEPS_AT_ONCE)


@contextmanager
def open_sqlite(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a file read-only, with what its write-ahead log or its rollback journal holds.

    Where SQLite would have to write beside it, a copy in the folder of temporary files is read.
    Raises: sqlite3.Error: no database. OSError: it cannot be read, or there is no room for a copy.
    """
    where = path.resolve().as_uri()
    if not _list_beside(path):
        with closing(_connect(f"{where}?mode=ro&immutable=1")) as database:
            yield database
        return
    if (shared := _open_in_place(path)) is not None:
        with closing(shared):
            yield shared
        return
    with tempfile.TemporaryDirectory(prefix="agribot-sqlite-") as folder:
        copy = Path(folder) / path.name
        for name in ("", *_list_beside(path)):
            shutil.copyfile(f"{path}{name}", f"{copy}{name}")
        with closing(_connect(copy.as_uri())) as database:
            yield database


def read_with_log(path: Path) -> bytes:
    """Read any file, a database as the bytes of one file that holds its log, too."""
    data = path.read_bytes()
    if not data.startswith(MAGIC):
        return data
    try:
        with open_sqlite(path) as database:
            return settle_log(database.serialize())
    except sqlite3.Error:
        return data  # the reader of its format says what is wrong


def settle_log(data: bytes) -> bytes:
    """Mark the bytes of a database as one without a log, so that they can be opened in memory."""
    versions = bytes(min(version, 1) for version in data[_VERSIONS])
    return data[: _VERSIONS.start] + versions + data[_VERSIONS.stop :]


def expects_log(data: bytes) -> bool:
    """Return whether a database was last written with a log beside it."""
    return data.startswith(MAGIC) and data[_VERSIONS] == bytes([_WAL_VERSION] * 2)


def is_cut_off(path: Path) -> bool:
    """Return whether a database is shorter than its header says."""
    with path.open("rb") as file:
        header = file.read(_HEADER_BYTES)
    page_bytes = int.from_bytes(header[_PAGE_SIZE], "big")
    pages = int.from_bytes(header[_PAGES], "big")
    return path.stat().st_size < pages * (_LARGEST_PAGE_BYTES if page_bytes == 1 else page_bytes)


def _list_beside(path: Path) -> list[str]:
    """List the endings of the files beside a database that hold something."""
    found = []
    for name in BESIDE:
        with suppress(FileNotFoundError):
            found += [name] if Path(f"{path}{name}").stat().st_size else []
    return found


def _open_in_place(path: Path) -> sqlite3.Connection | None:
    """Open a file that another program has open too; None where SQLite would write beside it."""
    if not Path(f"{path}-shm").exists():
        return None
    database = _connect(f"{path.resolve().as_uri()}?mode=ro")
    try:
        database.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.OperationalError:
        database.close()
        return None
    return database


def _connect(uri: str) -> sqlite3.Connection:
    return sqlite3.connect(uri, uri=True, timeout=PATIENCE_S)
