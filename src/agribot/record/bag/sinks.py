"""Where a conversion writes: a ROS 1 bag, a rosbag2 folder or database, an MCAP file."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol

import lz4.frame
from mcap.writer import CompressionType, Writer
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys.store import Typestore

from agribot.core.errors import RecordingError
from agribot.core.topics import LATCHED, STREAM
from agribot.record.bag.definitions import make_ros1_store, make_ros2_store
from agribot.record.bag.source import BagFile, BagTopic
from agribot.record.damage import Damage
from agribot.record.mcap_file import format_qos
from agribot.record.mcap_records import LIBRARY, note_lost

Compression = Literal["none", "lz4", "bz2"]
Storage = Literal["sqlite3", "mcap"]

_FOREVER = QosTime(9223372036, 854775807)
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    _FOREVER,
    _FOREVER,
    QosLiveliness.AUTOMATIC,
    _FOREVER,
    avoid_ros_namespace_conventions=False,
)


class Sink(Protocol):
    """`add` gives the number under which messages of the topic are written."""

    store: Typestore  # the types it writes; it may learn further ones
    is_ros2: bool
    holds_anything: bool  # also what is no ROS message, files and notes of what is lost
    last_ns: int  # last time of messages that fit into it, from 1970 on

    def add(self, topic: BagTopic) -> int: ...

    def write(self, number: int, log_ns: int, publish_ns: int, data: bytes) -> None: ...

    def attach(self, file: BagFile) -> None: ...

    def note_lost(self, damage: Damage) -> None: ...

    def close(self) -> None: ...


def compress_for_ros1(data: bytes) -> bytes:
    """Compress to an LZ4 frame with the one set of options that ROS 1's reader (roslz4) takes.

    Blocks stand alone, a checksum of the whole content ends it, its size is left out.
    """
    frame: bytes = lz4.frame.compress(
        data,
        block_size=lz4.frame.BLOCKSIZE_MAX1MB,
        block_linked=False,
        content_checksum=True,
        store_size=False,
    )
    return frame


class _RosbagSink:
    """What the two formats of rosbags have in common: they hold messages of ROS alone."""

    holds_anything = False
    _writer: Any

    def attach(self, file: BagFile) -> None:
        raise NotImplementedError

    def note_lost(self, damage: Damage) -> None:
        raise NotImplementedError

    def close(self) -> None:
        self._writer.close()


class Ros1Sink(_RosbagSink):
    is_ros2 = False
    last_ns = (1 << 32) * 1_000_000_000 - 1

    def __init__(self, path: Path, compression: Compression) -> None:
        self.store = make_ros1_store()
        self._writer = rosbag1.Writer(path)
        if compression != "none":
            self._writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
        if compression == "lz4":
            self._writer.compressor = compress_for_ros1
        self._writer.open()
        self._connections: list[Any] = []

    def add(self, topic: BagTopic) -> int:
        connection = self._writer.add_connection(
            topic.name,
            topic.ros_type,
            typestore=self.store,
            latching=1 if topic.is_latched else None,
            callerid=f"/{LIBRARY}{len(self._connections) or ''}",
        )
        self._connections.append(connection)
        return len(self._connections) - 1

    def write(self, number: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        self._writer.write(self._connections[number], log_ns, data)


class Rosbag2Sink(_RosbagSink):
    is_ros2 = True
    last_ns = (1 << 63) - 1

    def __init__(self, folder: Path, storage: Storage) -> None:
        self.store = make_ros2_store()
        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        self._writer = rosbag2.Writer(folder, version=9, storage_plugin=plugin)
        self._writer.open()
        self._connections: dict[tuple[str, str, bool], tuple[int, Any]] = {}
        self._by_number: list[Any] = []

    def add(self, topic: BagTopic) -> int:
        key = (topic.name, topic.ros_type, topic.is_latched)
        if key not in self._connections:
            connection = self._writer.add_connection(
                topic.name,
                topic.ros_type,
                typestore=self.store,
                offered_qos_profiles=[_LATCHED] if topic.is_latched else [],
            )
            self._connections[key] = (len(self._by_number), connection)
            self._by_number.append(connection)
        return self._connections[key][0]

    def write(self, number: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        self._writer.write(self._by_number[number], log_ns, data)


class McapSink:
    is_ros2 = True
    holds_anything = True
    last_ns = (1 << 64) - 1

    def __init__(self, path: Path) -> None:
        self.store = make_ros2_store()
        self._file = path.open("xb")
        self._writer = Writer(self._file, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._schemas: dict[tuple[str, str], int] = {}

    def add(self, topic: BagTopic) -> int:
        if topic.encoding != "cdr":
            definition = topic.definition.encode()
            schema = self._schema(topic.schema_name, topic.schema_encoding, definition)
            return int(self._writer.register_channel(topic.name, topic.encoding, schema))
        text, _ = self.store.generate_msgdef(topic.ros_type, ros_version=2)
        schema = self._schema(topic.ros_type, "ros2msg", text.encode())
        metadata = {
            "offered_qos_profiles": topic.qos_yaml
            or format_qos(LATCHED if topic.is_latched else STREAM),
            "topic_type_hash": self.store.hash_rihs01(topic.ros_type),
        }
        return int(self._writer.register_channel(topic.name, "cdr", schema, metadata))

    def write(self, number: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        self._writer.add_message(number, log_ns, data, publish_ns)

    def attach(self, file: BagFile) -> None:
        self._writer.add_attachment(0, 0, file.name, file.media_type, file.data)

    def note_lost(self, damage: Damage) -> None:
        note = note_lost(damage)
        self._writer.add_metadata(note.name, note.metadata)

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _schema(self, name: str, encoding: str, data: bytes) -> int:
        if not name and not data:
            return 0
        key = (name, encoding)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(name, encoding, data)
        return self._schemas[key]


@contextmanager
def open_sink(
    path: Path, compression: Compression = "none", storage: Storage = "sqlite3"
) -> Iterator[Sink]:
    """Open a target by its name: .bag, .mcap, .db3, or a folder for a whole rosbag2.

    It appears under its name when it is complete; an error leaves nothing behind.
    Raises: RecordingError: it exists, or cannot be written.
    """
    if path.exists():
        raise RecordingError(f"{path} exists already; remove it or choose another name")
    if compression != "none" and path.suffix != ".bag":
        raise RecordingError(
            f"{path.name}: compression {compression} is for a .bag; leave it out or name a .bag"
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        workshop = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise _make_error(path, error) from error
    try:
        sink = _make_sink(workshop / path.name, compression, storage)
        try:
            yield sink
        finally:
            sink.close()
        os.replace(_take_product(workshop, path), path)
    except OSError as error:
        raise _make_error(path, error) from error
    finally:
        shutil.rmtree(workshop, ignore_errors=True)


def _make_sink(path: Path, compression: Compression, storage: Storage) -> Sink:
    if path.suffix == ".bag":
        return Ros1Sink(path, compression)
    if path.suffix == ".mcap":
        return McapSink(path)
    if path.suffix == ".db3":
        return Rosbag2Sink(path.with_suffix(""), "sqlite3")
    return Rosbag2Sink(path, storage)


def _take_product(workshop: Path, path: Path) -> Path:
    """Take a single database out of its folder; it has its own description inside."""
    if path.suffix == ".db3":
        return workshop / path.stem / path.name
    return workshop / path.name


def _make_error(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"cannot write {path}: {error.strerror or error}; "
        "check that the folder is writable and the disk has room"
    )
