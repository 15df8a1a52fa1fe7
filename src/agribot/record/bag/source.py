"""Any recording behind one interface: topics, messages, files inside, and notes on damage."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg
from rosbags.typesys import get_typestore as rosbags_store
from rosbags.typesys.store import Typestore

from agribot.core.errors import RecordingError
from agribot.record.bag.definitions import (
    collect_definitions,
    deserialize,
    list_inner_types,
    ros1_store,
    ros2_store,
)
from agribot.record.damage import Damage, warn_of

_IDL_RULE = "=" * 80 + "\n"


class BagTopic(msgspec.Struct, frozen=True, kw_only=True):
    """A topic of a recording.

    `encoding` is cdr (ROS 2), ros1, or what another program wrote; `ros_type` the type's full
    name in the ROS 2 manner, empty where it is no ROS message. `definition` is the text that
    came along, in `definition_format` msg or idl.
    """

    id: int
    name: str
    ros_type: str
    encoding: str
    definition: str = ""
    definition_format: str = ""
    schema_name: str = ""
    schema_encoding: str = ""
    is_latched: bool = False
    qos_yaml: str = ""
    count: int = 0

    @property
    def is_ros(self) -> bool:
        return self.encoding in ("cdr", "ros1")


class BagMessage(NamedTuple):
    topic: BagTopic
    log_ns: int
    publish_ns: int
    data: bytes


class BagFile(NamedTuple):
    """A file inside a recording; only MCAP has a place for them."""

    name: str
    media_type: str
    data: bytes


class UndecodableMessage(RecordingError):
    """The bytes of a message do not fit its type."""


class Bag:
    """Result of `open_bag`. Subclasses fill the attributes and read `messages`.

    `damage` is what cannot be read, `notes` what else is missing, in words for the user.
    `times_ns` are the first and the last log time, None for a recording without messages.
    """

    kind = ""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: tuple[BagTopic, ...] = ()
        self.notes: list[str] = []
        self.damage: tuple[Damage, ...] = ()
        self.file_names: tuple[str, ...] = ()
        self.times_ns: tuple[int, int] | None = None
        self.compression = ""
        self._store: Typestore | None = None

    def messages(self, names: frozenset[str] | None = None) -> Iterator[BagMessage]:
        """Iterate over the topics called `names`, or all, in the order of the recording."""
        raise NotImplementedError

    def files(self) -> Iterator[BagFile]:
        """Iterate over the files inside, in the order they were attached."""
        yield from ()

    def close(self) -> None:
        """Close the recording. Safe to call twice."""

    @property
    def count(self) -> int:
        return sum(topic.count for topic in self.topics)

    @property
    def contents(self) -> str:
        """Topics that hold messages, with their types, in words."""
        held = (f"{t.name} ({t.ros_type or t.encoding})" for t in self.topics if t.count)
        return ", ".join(held) or "no messages"

    def find(self, name: str) -> BagTopic:
        """Find a topic by its name.

        Raises: RecordingError: no such topic; the message lists those there are.
        """
        for topic in self.topics:
            if topic.name == name:
                return topic
        known = ", ".join(sorted(topic.name for topic in self.topics)) or "none at all"
        raise RecordingError(f"{self.path} has no topic {name}; it has: {known}")

    def store(self) -> Typestore:
        """Return the types of the topics as the recording defines them, else as ROS and agribot do.

        Types that no topic has are left out: Python code is written for each that is there.
        """
        if self._store is None:
            self._store = self._read_definitions()
        return self._store

    def knows(self, topic: BagTopic) -> bool:
        """Return whether the messages of the topic can be read."""
        return topic.is_ros and is_complete(self.store(), topic.ros_type)

    def values(self, names: frozenset[str]) -> Iterator[tuple[BagMessage, Any]]:
        """Iterate over the messages of topics, decoded; warn of those whose bytes do not fit.

        Raises: UndecodableMessage: no message fits its type.
        """
        failed: list[UndecodableMessage] = []
        count = 0
        for message in self.messages(names):
            try:
                value = self.value(message)
            except UndecodableMessage as error:
                failed.append(error)
                continue
            count += 1
            yield message, value
        if failed and not count:
            raise failed[0]
        if failed:
            warn_of([Damage(what=str(failed[0]), lost_messages=len(failed))])

    def value(self, message: BagMessage) -> Any:
        """Decode a message into an object.

        Raises: UndecodableMessage: its bytes do not fit its type.
        """
        topic = message.topic
        try:
            return deserialize(self.store(), topic.ros_type, topic.encoding == "cdr", message.data)
        except Exception as error:  # rosbags' generated code fails in many ways on wrong bytes
            raise UndecodableMessage(
                f"{self.path}: a message on {topic.name} is no {topic.ros_type} ({error}); "
                "the recording is damaged or its message definition is wrong"
            ) from error

    def _read_definitions(self) -> Typestore:
        types: dict[str, Any] = {}
        for topic in self.topics:
            if topic.is_ros and topic.definition:
                try:
                    is_idl = topic.definition_format == "idl"
                    types.update(_parse_definition(topic.ros_type, topic.definition, is_idl))
                except (TypesysError, ValueError, AssertionError, LookupError) as error:
                    self.notes.append(
                        f"the definition of {topic.ros_type} inside cannot be understood ({error})"
                    )
        is_ros1 = any(topic.encoding == "ros1" for topic in self.topics)
        store = rosbags_store(Stores.EMPTY)
        defaults = (ros1_store() if is_ros1 else ros2_store()).fielddefs
        used = (topic.ros_type for topic in self.topics if topic.is_ros)
        store.register(collect_definitions({**defaults, **types}, *used))
        return store


def is_latched(qos_yaml: str) -> bool:
    """Return whether one of the offered profiles keeps messages for late subscribers."""
    return "transient_local" in qos_yaml or "durability: 1" in qos_yaml


def is_complete(store: Typestore, ros_type: str) -> bool:
    """Return whether the type and all types inside it are defined."""
    return ros_type in store.fielddefs and all(
        is_complete(store, inner) for inner in list_inner_types(store.fielddefs, ros_type)
    )


@functools.lru_cache(maxsize=512)  # parsing takes tens of milliseconds, and all bags have the same
def _parse_definition(ros_type: str, definition: str, is_idl: bool) -> dict[str, Any]:
    if not is_idl:
        return dict(get_types_from_msg(definition, ros_type))
    if not definition.startswith(f"{_IDL_RULE}IDL: "):
        return dict(get_types_from_idl(definition))
    types: dict[str, Any] = {}
    for part in definition.split(_IDL_RULE)[1:]:
        types.update(get_types_from_idl(part.partition("\n")[2]))
    return types
