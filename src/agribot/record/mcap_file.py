"""MCAP files: written so that ROS 2 tools read them, read so that a cut-off tail does no harm."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Header, Message
from mcap.writer import CompressionType, Writer

from agribot.core.errors import RecordingError
from agribot.core.topics import Qos, Topic
from agribot.record.background_file import BackgroundFile
from agribot.record.damage import Damage, warn_of
from agribot.record.mcap_records import LIBRARY, McapRecords, read_parts
from agribot.ros.messages.rosmsg import load_types

MSGPACK_SCHEMA = "agribot.TickRecord"


class McapFile:
    """Writes topics of the table, chunked and LZ4-compressed; `flush` closes a chunk.

    A thread of its own brings the chunks to the disk.
    Raises: RecordingError: the file cannot be created or written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = BackgroundFile(path)
        except OSError as error:
            raise _make_error("create", path, error) from error
        stream: Any = self._file
        self._writer = Writer(stream, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library=LIBRARY)

    @property
    def closed(self) -> bool:
        return self._file.closed

    @property
    def size_bytes(self) -> int:
        """Bytes written to the file; a chunk in progress does not count yet."""
        return self._file.tell()

    def write(self, topic: Topic, log_ns: int, data: bytes, publish_ns: int) -> None:
        channel = self._channels.get(topic.name)
        if channel is None:
            channel = self._channels[topic.name] = self._register(topic)
        with self._give_up_on_error("write"):
            self._writer.add_message(channel, log_ns, data, max(publish_ns, 0))

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        with self._give_up_on_error("write"):
            self._writer.add_attachment(0, 0, name, media_type, data)

    def describe(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record: a few words that tools show without opening a message."""
        with self._give_up_on_error("write"):
            self._writer.add_metadata(name, values)

    def flush(self) -> None:
        with self._give_up_on_error("write"):
            self._writer.flush()  # type: ignore[no-untyped-call]

    def drain(self) -> None:
        """Close the chunk and wait for the disk."""
        self.flush()
        with self._give_up_on_error("write"):
            self._file.drain()

    def end(self) -> None:
        """Write the index, without waiting for the disk; `close` waits."""
        if self._file.closed:
            return
        with self._give_up_on_error("finish"):
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.end()

    def close(self) -> None:
        self.end()
        with self._give_up_on_error("finish"):
            self._file.close()

    def _register(self, topic: Topic) -> int:
        if not topic.ros_type:
            schema = self._writer.register_schema(MSGPACK_SCHEMA, "", b"")
            return int(self._writer.register_channel(topic.name, "msgpack", schema))
        schema = self._schemas.get(topic.ros_type, 0)
        if not schema:
            text, _ = load_types().generate_msgdef(topic.ros_type, ros_version=2)
            schema = self._writer.register_schema(topic.ros_type, "ros2msg", text.encode())
            self._schemas[topic.ros_type] = schema
        metadata = {
            "offered_qos_profiles": format_qos(topic.qos),
            "topic_type_hash": load_types().hash_rihs01(topic.ros_type),
        }
        return int(self._writer.register_channel(topic.name, "cdr", schema, metadata))

    @contextmanager
    def _give_up_on_error(self, verb: str) -> Iterator[None]:
        """Give up a file that fails: what reached the disk before stays readable."""
        try:
            yield
        except OSError as error:
            self._file.end()
            raise _make_error(verb, self.path, error) from error


def _make_error(verb: str, path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"cannot {verb} recording {path}: {error.strerror or error}; "
        "check that the folder is writable and the disk has room, or choose another --out"
    )


def format_qos(qos: Qos) -> str:
    """Format as rosbag2 stores it, so that a player offers latched topics latched again."""
    forever = "{sec: 9223372036, nsec: 854775807}"
    return (
        f"- history: keep_last\n  depth: {qos.depth}\n"
        f"  reliability: {'reliable' if qos.reliable else 'best_effort'}\n"
        f"  durability: {'transient_local' if qos.latched else 'volatile'}\n"
        f"  deadline: {forever}\n  lifespan: {forever}\n"
        f"  liveliness: automatic\n  liveliness_lease_duration: {forever}\n"
        "  avoid_ros_namespace_conventions: false\n"
    )


def read_records(path: Path) -> Iterator[Any]:
    """Read channels, messages and attachments in file order, and go on behind damage.

    Warns of it (`DamagedRecording`). A robot that lost power leaves a file without its end:
    everything before the cut is read. Further parts of the recording follow.
    Raises: RecordingError: no such file, or no MCAP file.
    """
    for record in read_parts(path):
        if isinstance(record, Damage):
            warn_of([record])
        else:
            yield record


def find_damage(path: Path) -> tuple[Damage, ...]:
    """Find what is damaged in a recording of ours and its further parts, or missing of them."""
    return tuple(read_parts(path, McapRecords.find_damage))


def check_whole(path: Path) -> None:
    """Refuse a recording with missing messages or files.

    Raises: RecordingError: it cannot stand for the whole drive.
    """
    lost = [damage.describe() for damage in find_damage(path) if damage.is_loss]
    if lost:
        raise RecordingError(f"{path} cannot be checked: {'; '.join(lost)}")


def read_messages(path: Path, topic: Topic) -> Iterator[Message]:
    """Read the messages of one topic in file order."""
    channel_id = None
    for record in read_records(path):
        if isinstance(record, Header):  # another part, with numbers of its own
            channel_id = None
        elif isinstance(record, Channel) and record.topic == topic.name:
            channel_id = record.id
        elif isinstance(record, Message) and record.channel_id == channel_id:
            yield record


def read_attachment(path: Path, name: str) -> bytes:
    """Read a file inside the recording.

    Raises: RecordingError: the recording has no attachment of this name.
    """
    damage: list[Damage] = []
    for record in read_parts(path, McapRecords.iterate_outer):
        if isinstance(record, Attachment) and record.name == name:
            return bytes(record.data)
        if isinstance(record, Damage):
            damage.append(record)
    warn_of(damage)
    advice = "it is damaged, see agribot record recover" if damage else "give a run of AGRIBOT"
    raise RecordingError(f"{path} has no attachment '{name}'; {advice}")


def read_attachment_unless_damaged(path: Path, name: str) -> bytes | None:
    """Read a file inside the recording; None where it is lost in damage, which is warned of.

    Raises: RecordingError: a sound recording without it.
    """
    try:
        return read_attachment(path, name)
    except RecordingError:
        if not any(damage.is_loss for damage in find_damage(path)):
            raise
        return None
