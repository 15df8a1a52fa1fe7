"""Write a recording that was cut off, is damaged or has no index again as a whole one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from agribot.core.errors import RecordingError
from agribot.record.damage import Damage
from agribot.record.mcap_records import LIBRARY, McapRecords, note_lost


class Recovery(msgspec.Struct, frozen=True, kw_only=True):
    """`was_whole`: nothing was damaged and the data ended as it should.

    `lost_bytes` could not be read; `damage` says where they lie and what is missing. `has_gaps`:
    messages or files of the middle are missing, which the new file says, too.
    """

    path: str
    messages: int
    topics: int
    files: int
    duration_s: float
    was_whole: bool
    lost_bytes: int
    damage: tuple[str, ...]
    has_gaps: bool


def recover(source: Path, target: Path) -> Recovery:
    """Write everything sound in `source` with an index, and a note of each gap, to `target`.

    Raises: RecordingError: nothing sound is in it, or the target exists or cannot be written.
    """
    if target.exists():
        raise RecordingError(f"{target} exists already; remove it or choose another name: -o FILE")
    partial = target.with_name(f".{target.name}.partial")
    try:
        with partial.open("wb") as file:
            copy = _Copy(Writer(file, compression=CompressionType.LZ4))
            for record in McapRecords(source):
                copy(record)
            copy.finish()
        size = source.stat().st_size
        if copy.is_empty:
            raise RecordingError(
                f"{source}: nothing can be recovered: the first {size - copy.lost_bytes} of its "
                f"{size} bytes are sound and hold no message and no file; "
                f"{target} is not written"
            )
        partial.replace(target)
    except OSError as error:
        raise RecordingError(
            f"cannot write {target}: {error.strerror or error}; name another file with --out"
        ) from error
    finally:
        partial.unlink(missing_ok=True)
    return Recovery(
        path=str(target),
        messages=copy.messages,
        topics=len(copy.channels),
        files=copy.files,
        duration_s=max(copy.last_ns - copy.first_ns, 0) * 1e-9,
        was_whole=not copy.damage,
        lost_bytes=copy.lost_bytes,
        damage=tuple(damage.describe() for damage in copy.damage),
        has_gaps=any(damage.is_gap for damage in copy.damage),
    )


class _Copy:
    """A copy of the records of one file into another, with ids of its own."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[int, int] = {0: 0}
        self.channels: dict[int, int] = {}
        self.messages = self.files = 0
        self._notes = 0
        self.first_ns, self.last_ns = 2**64, 0
        self.damage: list[Damage] = []
        self._is_started = False

    @property
    def lost_bytes(self) -> int:
        return sum(damage.lost_bytes for damage in self.damage)

    @property
    def is_empty(self) -> bool:
        return not (self.messages or self.files or self._notes)

    def __call__(self, record: Any) -> None:
        if isinstance(record, Header):
            self._start(record.profile, record.library)
            return
        if not self._is_started:  # its header is damaged
            self._start("", LIBRARY)
        if isinstance(record, Message):
            self._copy_message(record)
        elif isinstance(record, Damage):
            self._note_damage(record)
        elif isinstance(record, Schema):
            if record.id not in self._schemas:
                self._schemas[record.id] = self._writer.register_schema(
                    record.name, record.encoding, record.data
                )
        elif isinstance(record, Channel):
            self._copy_channel(record)
        elif isinstance(record, Attachment):
            self.files += 1
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        elif isinstance(record, Metadata):
            self._notes += 1
            self._writer.add_metadata(record.name, record.metadata)

    def finish(self) -> None:
        if self._is_started:
            self._writer.finish()  # type: ignore[no-untyped-call]

    def _start(self, profile: str, library: str) -> None:
        self._is_started = True
        self._writer.start(profile=profile, library=library)

    def _note_damage(self, damage: Damage) -> None:
        self.damage.append(damage)
        if damage.is_gap:
            note = note_lost(damage)
            self._writer.add_metadata(note.name, note.metadata)

    def _copy_channel(self, record: Channel) -> None:
        if record.id not in self.channels and record.schema_id in self._schemas:
            self.channels[record.id] = self._writer.register_channel(
                record.topic, record.message_encoding, self._schemas[record.schema_id],
                record.metadata,
            )  # fmt: skip

    def _copy_message(self, record: Message) -> None:
        channel = self.channels.get(record.channel_id)
        if channel is None:
            return
        self._writer.add_message(
            channel, record.log_time, record.data, record.publish_time, record.sequence
        )
        self.messages += 1
        self.first_ns = min(self.first_ns, record.log_time)
        self.last_ns = max(self.last_ns, record.log_time)
