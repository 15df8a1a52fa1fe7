"""Who publishes and who listens in a domain of DDS, from what its participants announce."""

from __future__ import annotations

import contextlib
import threading
from collections import defaultdict
from typing import Any, NamedTuple

from agribot.core.errors import BridgeError
from agribot.core.topics import Qos
from agribot.ros.dds.node import NODES, DdsNode
from agribot.ros.dds.types import load_dds_types
from agribot.ros.decoding import make_undecodable
from agribot.ros.graph import Graph, make_graph
from agribot.ros.messages.dds_names import from_dds_name

_MOST_ENDPOINTS = 4000
_ALIVE = 16  # state of an instance that lives
_TOPIC = "rt/"  # prefix of a topic's name; services have others


class DdsEndpoint(NamedTuple):
    """A writer or reader of a topic of ROS; `type_hash` is empty where none is said (Humble)."""

    node: str
    name: str
    ros_type: str
    type_hash: str
    qos: Qos


class Discovery:
    """What `node` has found of all participants but its own."""

    def __init__(self, node: DdsNode) -> None:
        from cyclonedds.builtin import (
            BuiltinDataReader,
            BuiltinTopicDcpsPublication,
            BuiltinTopicDcpsSubscription,
        )

        self._own = node.participant.guid
        self._writers: Any = BuiltinDataReader(node.participant, BuiltinTopicDcpsPublication)
        self._readers: Any = BuiltinDataReader(node.participant, BuiltinTopicDcpsSubscription)
        self._lock = threading.Lock()
        self._names: dict[bytes, str] = {}  # names by the id of an endpoint
        self._nodes: dict[bytes, set[str]] = {}  # nodes by the id of their participant
        node.subscribe_nodes(self._on_nodes)

    def list_writers(self) -> list[DdsEndpoint]:
        return self._list(self._read(self._writers))

    def read_graph(self) -> Graph:
        """Read who publishes and who listens."""
        written, read = self._read(self._writers), self._read(self._readers)
        publishers, subscribers = self._list(written), self._list(read)
        types = {one.name: one.ros_type for one in (*subscribers, *publishers)}
        with self._lock:
            alive = {one.participant_key.bytes for one in (*written, *read)}
            nodes = set().union(*(self._nodes.get(each, set()) for each in alive))
        return make_graph("ROS 2 on DDS", nodes, types, _group(publishers), _group(subscribers))

    def _read(self, reader: Any) -> list[Any]:
        """Read the endpoints that are alive."""
        return [
            one
            for one in reader.read(_MOST_ENDPOINTS)
            if one.sample_info.valid_data
            and one.sample_info.instance_state == _ALIVE
            and one.participant_key != self._own
        ]

    def _list(self, found: list[Any]) -> list[DdsEndpoint]:
        return [
            DdsEndpoint(
                node=self._name(one),
                name=one.topic_name.removeprefix("rt"),
                ros_type=from_dds_name(one.type_name),
                type_hash=read_user_data(one.qos, "typehash"),
                qos=_read_qos(one.qos),
            )
            for one in found
            if one.topic_name.startswith(_TOPIC) and from_dds_name(one.type_name)
        ]

    def _name(self, found: Any) -> str:
        """Name the node of an endpoint: a program without ROS has but a participant's id."""
        with self._lock:
            return self._names.get(found.key.bytes, f"participant {found.key.hex[8:24]}")

    def _on_nodes(self, data: bytes) -> None:
        with contextlib.suppress(BridgeError):  # a participant of Humble has longer ids
            message = _decode_nodes(data)
            names = set()
            for node in message.node_entities_info_seq:
                name = f"{node.node_namespace.rstrip('/')}/{node.node_name}"
                names.add(name)
                gids = (*node.reader_gid_seq, *node.writer_gid_seq)
                with self._lock:
                    self._names.update({gid.data.tobytes(): name for gid in gids})
            with self._lock:
                self._nodes[message.gid.data.tobytes()] = names


def _decode_nodes(data: bytes) -> Any:
    """Decode what a participant says of its nodes.

    Raises: BridgeError: it is another message.
    """
    try:
        return load_dds_types().deserialize_cdr(data, NODES.ros_type)
    except Exception as error:  # the generated code of rosbags raises any error
        raise make_undecodable(data, NODES.ros_type) from error


def read_user_data(qos: Any, key: str) -> str:
    """Read the value of a key from the user data of an endpoint; "" if it lacks the key."""
    from cyclonedds.qos import Policy

    user = qos[Policy.Userdata].data.decode(errors="replace") if Policy.Userdata in qos else ""
    pairs = (part.partition("=") for part in str(user).split(";"))
    return next((value for name, _, value in pairs if name == key), "")


def _read_qos(qos: Any) -> Qos:
    from cyclonedds.qos import Policy

    reliable, durable = Policy.Reliability, Policy.Durability
    return Qos(
        reliable=reliable in qos and qos[reliable] != reliable.BestEffort,
        latched=durable in qos and qos[durable] != durable.Volatile,
    )


def _group(endpoints: list[DdsEndpoint]) -> dict[str, set[str]]:
    """Group the nodes by topic."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for one in endpoints:
        found[one.name].add(one.node)
    return dict(found)
