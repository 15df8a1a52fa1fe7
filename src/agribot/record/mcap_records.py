"""The records of an MCAP file in file order, with what is damaged between them."""

from __future__ import annotations

import glob
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any

import msgspec
from mcap.records import Chunk, Metadata

from agribot.core.errors import CHECK_PATH, RecordingError, explain_os_error
from agribot.record.damage import Damage
from agribot.record.mcap_parsing import MAGIC, Summary, break_up, read_summary
from agribot.record.mcap_tally import Tally
from agribot.record.mcap_walk import Hole, McapWalk

LIBRARY = "agribot"
LOST = "agribot.lost"  # the metadata record of messages that a recovered file lacks
_RECOVERED = "recovered from a damaged recording: "
_NUMBERED = re.compile(r"(.*)-(\d{4,})")


def part_path(first: Path, number: int) -> Path:
    return first if number == 0 else first.with_name(f"{first.stem}-{number:04d}{first.suffix}")


def list_parts(path: Path) -> list[Path]:
    """List the given part of a recording and all that follow it: run.mcap, run-0001.mcap, ..."""
    first, number = _find_first(path)
    parts = [path]
    while (following := part_path(first, number := number + 1)).exists():
        parts.append(following)
    return parts


def _find_first(path: Path) -> tuple[Path, int]:
    """Find the path of the first part, and the number of this one."""
    found = _NUMBERED.fullmatch(path.stem)
    if found is None:
        return path, 0
    return path.with_name(found[1] + path.suffix), int(found[2])


def list_later_parts(path: Path) -> list[tuple[int, Path]]:
    """List the parts behind a missing one, with their numbers."""
    first, number = _find_first(path)
    last = number + len(list_parts(path)) - 1
    found = []
    for other in first.parent.glob(f"{glob.escape(first.stem)}-*{first.suffix}"):
        _, other_number = _find_first(other)
        if other_number > last and _is_part(other, other_number):
            found.append((other_number, other))
    return sorted(found)


def _is_part(path: Path, number: int) -> bool:
    try:
        return read_part_number(path) == number
    except RecordingError:
        return False


def read_part_number(path: Path) -> int:
    """Read the number of a part: 0 for a whole recording or its first part.

    Raises: RecordingError: no MCAP file.
    """
    for record in McapRecords(path).iterate_outer():
        if isinstance(record, Metadata) and record.name == LIBRARY:
            return int(record.metadata.get("part", "0"))
    return 0


def read_parts(
    path: Path, read: Callable[[McapRecords], Iterable[Any]] = lambda records: records
) -> Iterator[Any]:
    """Iterate for what `read` gives of a recording and its further parts, and Damage between."""
    parts, later = list_parts(path), list_later_parts(path)
    for part in parts:
        for record in read(McapRecords(part)):
            if isinstance(record, Damage) and record.is_end and (part != parts[-1] or later):
                yield msgspec.structs.replace(record, is_end=False)
            else:
                yield record
    if later:
        _, part = later[0]
        yield Damage(what=f"{part.name} is there, and no part between it and {parts[-1].name}")
        yield from read_parts(part, read)


class McapRecords:
    """Iterate for Header, Schema, Channel, Message, Attachment and Metadata records, and Damage.

    A `Damage` stands where messages may be missing, before the first sound record behind it.
    After the last record `is_whole` says whether the data ended as it should.
    Raises: RecordingError: no such file, or it is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_whole = False
        self.summary: Summary | None = None

    def __iter__(self) -> Iterator[Any]:
        return self._iterate(breaks_up=True)

    def iterate_outer(self) -> Iterator[Any]:
        """Iterate without the records inside chunks, which takes a fraction of the time."""
        return self._iterate(breaks_up=False)

    def find_damage(self) -> tuple[Damage, ...]:
        """Find what is damaged; chunks are checked and counted, their records left alone."""
        found = tuple(each for each in self.iterate_outer() if isinstance(each, Damage))
        if not found:
            return found
        return tuple(each for each in self if isinstance(each, Damage))

    def _iterate(self, breaks_up: bool) -> Iterator[Any]:
        with self._open() as file:
            size = self.path.stat().st_size
            self.summary = read_summary(file, size)
            known = self.summary.channels if self.summary is not None else ()
            walk = McapWalk(file, size, known)
            tally = Tally(self.path.name, file, size, self.summary)
            for found in walk:
                if isinstance(found, Hole):
                    tally.add_hole(found)
                    continue
                yield from tally.close_hole(found.record)
                yield from _open_record(found.record, tally, breaks_up)
            self.is_whole = walk.data_end is not None
            yield from tally.finish(walk.data_end)

    def _open(self) -> IO[bytes]:
        with explain_os_error(f"cannot read recording {self.path}", CHECK_PATH):
            file = self.path.open("rb")
        if file.read(len(MAGIC)) != MAGIC:
            file.close()
            raise RecordingError(
                f"{self.path} is not an MCAP recording; give the run.mcap of a run"
            )
        return file


def note_lost(damage: Damage) -> Metadata:
    """Make the record that a recovered file keeps of what it lacks."""
    return Metadata(name=LOST, metadata={LOST: msgspec.json.encode(damage).decode()})


def _read_lost(record: Metadata) -> Damage | None:
    try:
        damage = msgspec.json.decode(record.metadata.get(LOST, ""), type=Damage)
    except msgspec.MsgspecError:
        return None
    what = damage.what.removeprefix(_RECOVERED)
    return msgspec.structs.replace(damage, what=f"{_RECOVERED}{what}", is_end=False)


def _open_record(record: Any, tally: Tally, breaks_up: bool) -> Iterator[Any]:
    if isinstance(record, Metadata) and record.name == LOST:
        yield _read_lost(record) or record
    elif isinstance(record, Chunk):
        tally.add_chunk(record)
        for inner in break_up(record) if breaks_up else ():
            tally.add(inner)
            yield inner
    else:
        tally.add(record)
        yield record
