"""rosbag2 databases (`.db3`): read with their log, and on behind damage.

Source of the tables: rosbag2_storage_sqlite3, versions 1 to 4 of its schema.
"""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec

from agribot.core.errors import RecordingError
from agribot.core.sqlite_file import is_cut_off, open_sqlite
from agribot.record.bag.source import Bag, BagMessage, BagTopic, is_latched
from agribot.record.damage import Damage

_FORMATS = {"ros2msg": "msg", "ros2idl": "idl"}
_SMALLEST_ROW_BYTES = 16
_FAILURES_A_STEP = 1000  # failures before ids are tried in growing steps
# Tries, more than there can be rows, before the rest of a database counts as lost.
_TRIES_A_ROW, _MORE_TRIES = 10, 1_000_000
_FIRST_ID = -(1 << 63)


class MessageRow(NamedTuple):
    """A row of the table of messages."""

    id: int
    topic_id: int
    t_ns: int
    data: bytes


class SqliteBag(Bag):
    """One database of rosbag2.

    Raises: RecordingError: no such database, or its description is damaged.
    """

    kind = "rosbag2"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._stack = ExitStack()
        with _refuse(path):
            self._database = self._stack.enter_context(open_sqlite(path))
            # Without it SQLite opens no file that was cut off.
            self._database.execute("PRAGMA writable_schema = ON")
            topics = {topic.id: topic for topic in _read_topics(self._database)}
            counts, times_ns = self._count(topics)
        self.topics = tuple(
            msgspec.structs.replace(topic, count=counts[number])
            for number, topic in sorted(topics.items())
        )
        self.times_ns = times_ns
        if self.topics and not any(topic.definition for topic in self.topics):
            self.notes.append("it brings no message definitions; those of ROS 2 Jazzy are assumed")

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        topics = {t.id: t for t in self.topics if names is None or t.name in names}
        if not topics:
            return
        with _refuse(self.path):
            for row in self._rows(topics):
                if row.topic_id in topics:
                    yield BagMessage(topics[row.topic_id], row.t_ns, row.t_ns, row.data)

    def close(self) -> None:
        self._stack.close()

    def _rows(self, topics: dict[int, BagTopic]) -> Iterator[MessageRow]:
        if self.damage:
            yield from _RowWalk(self._database, self.path, {topic.id for topic in self.topics})
            return
        marks = ", ".join("?" * len(topics))
        yield from map(
            MessageRow._make,
            self._database.execute(
                "SELECT id, topic_id, timestamp, data FROM messages"
                f" WHERE topic_id IN ({marks}) ORDER BY timestamp",
                tuple(topics),
            ),
        )

    def _count(self, topics: dict[int, BagTopic]) -> tuple[Counter[int], tuple[int, int] | None]:
        """Count the messages of each topic, and find their first and last time."""
        if _is_sound(self._database):
            found = self._database.execute(
                "SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages"
                " GROUP BY topic_id"
            ).fetchall()
            counts = Counter({number: count for number, count, _, _ in found})
            times = [t_ns for row in found for t_ns in row[2:]]
        else:
            counts, times = Counter(), []
            walk = _RowWalk(self._database, self.path, set(topics))
            for row in walk:
                counts[row.topic_id] += 1
                times = [min((row.t_ns, *times[:1])), max((row.t_ns, *times[1:]))]
            self.damage = tuple(walk.damage)
        return counts, (min(times), max(times)) if times else None


class _RowWalk:
    """Iterate over the messages in the order of their ids, on behind pages that are damaged."""

    def __init__(self, database: sqlite3.Connection, path: Path, topic_ids: set[int]) -> None:
        self._database, self._path, self._topic_ids = database, path, topic_ids
        self.damage: list[Damage] = []
        self._next_id = 1
        self._most_ids = path.stat().st_size // _SMALLEST_ROW_BYTES
        self._tries = 0
        self._most_tries = self._most_ids + min(_TRIES_A_ROW * self._most_ids, _MORE_TRIES)
        self._last: MessageRow | None = None
        self._begin_ns: int | None = None
        self._bad_rows = 0

    def __iter__(self) -> Iterator[MessageRow]:
        start_id: int | None = _FIRST_ID
        while start_id is not None:
            try:
                yield from self._read_from(start_id)
                break
            except sqlite3.DatabaseError:
                start_id = self._find_next()
        self._finish(is_end_lost=start_id is None)

    def _work(self) -> None:
        """Count a row that was tried.

        Raises: DatabaseError: pages lead in circles.
        """
        self._tries += 1
        if self._tries > self._most_tries:
            raise sqlite3.DatabaseError("its pages lead in circles")

    def _read_from(self, start_id: int) -> Iterator[MessageRow]:
        rows = self._database.execute(
            "SELECT id, topic_id, timestamp, data FROM messages NOT INDEXED WHERE id >= ?"
            " ORDER BY id",
            (start_id,),
        )
        is_resumed = start_id != _FIRST_ID
        for row in map(MessageRow._make, rows):
            self._work()
            lost = row.id - self._next_id
            if not 0 <= lost <= self._most_ids:
                self._bad_rows += lost > 0  # another one was read before
                continue
            self._next_id = row.id + 1
            if row.topic_id not in self._topic_ids or not isinstance(row.data, bytes):
                self._bad_rows += 1
                continue
            if is_resumed:
                self._note_gap(row, lost)
            is_resumed = False  # only the first row of a query follows a gap
            self._begin_ns = min(row.t_ns, self._begin_ns or row.t_ns)
            self._last = row
            yield row

    def _find_next(self) -> int | None:
        """Find the next id from which on a row can be read; None without one."""
        start_id, failures = self._next_id, 0
        while start_id <= self._most_ids and self._tries < self._most_tries:
            start_id += 1 + failures // _FAILURES_A_STEP
            self._tries += 1
            try:
                found = self._database.execute(
                    "SELECT id, topic_id, timestamp, data FROM messages NOT INDEXED WHERE id >= ?"
                    " ORDER BY id LIMIT 1",
                    (start_id,),
                ).fetchone()
            except sqlite3.DatabaseError:
                failures += 1
                continue
            return start_id if found else None
        return None

    def _note_gap(self, row: MessageRow, lost: int) -> None:
        self.damage.append(
            Damage(
                what=f"{self._path.name}: pages of it are damaged",
                begin_ns=self._begin_ns, after_ns=self._last.t_ns if self._last else None,
                before_ns=row.t_ns, lost_messages=lost,
            )
        )  # fmt: skip

    def _finish(self, is_end_lost: bool) -> None:
        is_cut, name = is_cut_off(self._path), self._path.name
        how = "its end is cut off" if is_cut else "the database is damaged"
        if is_end_lost or self._bad_rows or not self.damage:
            self.damage.append(
                Damage(
                    what=f"{name}: {how}",
                    begin_ns=self._begin_ns, after_ns=self._last.t_ns if self._last else None,
                    lost_messages=None if is_end_lost else self._bad_rows, is_end=is_cut,
                )
            )  # fmt: skip


def _is_sound(database: sqlite3.Connection) -> bool:
    try:
        found = database.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.DatabaseError:
        return False
    return bool(found == ("ok",))


def _read_topics(database: sqlite3.Connection) -> Iterator[BagTopic]:
    definitions = _read_definitions(database)
    columns = _list_columns(database, "topics")
    qos_column = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    for number, name, kind, encoding, qos in database.execute(
        f"SELECT id, name, type, serialization_format, {qos_column} FROM topics ORDER BY id"
    ):
        is_ros = encoding == "cdr"
        definition_format, definition = definitions.get(kind, ("", ""))
        yield BagTopic(
            id=number, name=name, ros_type=kind if is_ros else "", encoding=encoding,
            schema_name="" if is_ros else kind, definition=definition,
            definition_format=definition_format, is_latched=is_latched(str(qos)),
        )  # fmt: skip


def _read_definitions(database: sqlite3.Connection) -> dict[str, tuple[str, str]]:
    if not _list_columns(database, "message_definitions"):
        return {}
    rows = database.execute(
        "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
    )
    return {kind: (_FORMATS.get(encoding, ""), text) for kind, encoding, text in rows}


def _list_columns(database: sqlite3.Connection, table: str) -> list[str]:
    return [row[1] for row in database.execute(f"PRAGMA table_info({table})")]


@contextmanager
def _refuse(path: Path) -> Iterator[None]:
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        raise RecordingError(
            f"{path} cannot be read as a recording: {error}; where it is a damaged database, "
            f"sqlite3 {path.name} .recover may help"
        ) from error
