"""A ROS 2 node on DDS: endpoints with their type hash, and a node name for `ros2 node list`.

Source: the design of rmw_dds_common and of rmw_cyclonedds_cpp and rmw_fastrtps_cpp (Jazzy).
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from importlib import metadata
from typing import Any, NamedTuple

import msgspec
import numpy as np
from rosbags.typesys.store import Typestore

from agribot.core.errors import BridgeError
from agribot.core.extras import format_install
from agribot.core.topics import LATCHED, Qos, Topic
from agribot.ros.dds.types import load_dds_types, make_dds_service_type, make_dds_type

NODES = Topic(
    name="ros_discovery_info",
    ros_type="rmw_dds_common/msg/ParticipantEntitiesInfo",
    qos=LATCHED,
)
_ANY_STATE = 127
_TAKEN_AT_ONCE = 32
_BLOCKING_MS = 100
_MOST_PARTICIPANTS = 100  # participants whose nodes are kept until they are read
# Settings of Cyclone by default: nothing leaves this machine; with small fragments Fast DDS would
# lose images. Late peers are found, too: Cyclone alone announces itself every 30 s, and stops
# without a first answer.
_LOCAL = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast>
<FragmentSize>63000B</FragmentSize><MaxMessageSize>65500B</MaxMessageSize></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>60</MaxAutoParticipantIndex><SPDPInterval>2s</SPDPInterval>{keep}
<Peers><Peer Address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""
# Setting from version 11 on.
_KEEP_PEERS = "<InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"


class SampleOrigin(NamedTuple):
    """Where a message came from: a writer, by its handle at the reader."""

    reader: Any
    handle: int

    def find_writer(self) -> Any:
        """Find what is known of the writer; None if it is gone."""
        return self.reader.get_matched_publication_data(self.handle)


OnSample = Callable[[bytes, SampleOrigin], None]  # with CDR


class DdsNode:
    """One participant with one node in it.

    Raises: BridgeError: cyclonedds is not installed, or the domain cannot be joined.
    """

    def __init__(self, name: str, domain: int) -> None:
        try:
            from cyclonedds.core import DDSException
            from cyclonedds.domain import Domain, DomainParticipant
            from cyclonedds.pub import Publisher
            from cyclonedds.qos import Policy
            from cyclonedds.qos import Qos as DdsQos
            from cyclonedds.sub import Subscriber
        except ImportError as error:
            raise BridgeError(
                "ROS 2 on DDS needs cyclonedds, which has no wheel for Linux on ARM and for Python "
                f"3.14; {format_install('dds')}, or use --ros2 and rmw_zenoh_cpp there"
            ) from error
        self._name = name
        user = DdsQos(Policy.Userdata(b"enclave=/;"))
        try:
            self._domain: Any = _join_domain(Domain, domain)
            self._participant: Any = DomainParticipant(domain, qos=user)
        except DDSException as error:
            raise BridgeError(
                f"DDS: cannot join domain {domain}: {error}; check CYCLONEDDS_URI and the network"
            ) from error
        self._publisher: Any = Publisher(self._participant)
        self._subscriber: Any = Subscriber(self._participant)
        self._kept: list[Any] = []
        self._readers: list[bytes] = []
        self._writers: list[bytes] = []
        self._discovery = self._create_writer(NODES, NODES.name)
        self.announce()

    @property
    def participant(self) -> Any:
        return self._participant

    def create_publisher(
        self, topic: Topic, types: Typestore | None = None
    ) -> Callable[[bytes], None]:
        """Create a publisher that takes CDR; call `announce` after the last one.

        `types` has the topic's type where the default types have not.
        """
        writer = self.open_writer(topic, f"rt{topic.name}", types)
        return lambda data: write(writer, data)

    def open_writer(
        self, topic: Topic, name: str, types: Typestore | None = None, user: str = ""
    ) -> Any:
        """Open a writer for `write`; its `name` is that of DDS.

        `user` is the user data of a service's endpoint; empty for a topic.
        """
        writer = self._create_writer(topic, name, types, user)
        self._writers.append(writer.guid.bytes)
        return writer

    def open_reader(
        self,
        topic: Topic,
        name: str,
        on_sample: OnSample,
        types: Typestore,
        user: str,
        on_writer: Callable[[SampleOrigin], None] | None = None,
    ) -> None:
        """Open the reader of a service, as `open_writer` its writer.

        `on_writer` is called with each writer that is found.
        """
        qos = _make_qos(topic, types, user)
        reader, *_ = self._create_reader(topic, name, on_sample, types, qos, user, on_writer)
        self._readers.append(reader.guid.bytes)

    def subscribe(
        self, topic: Topic, on_message: Callable[[bytes], None], types: Typestore | None = None
    ) -> Callable[[], None]:
        """Call `on_message` with CDR in a thread of DDS; call `announce` after the last one.

        As in ROS 1 the node does not hear itself. Return what ends the subscription.
        """
        from cyclonedds.qos import Policy
        from cyclonedds.qos import Qos as DdsQos

        own = Policy.IgnoreLocal.Participant
        qos = DdsQos(own, base=_make_qos(topic, types))
        made = self._create_reader(
            topic, f"rt{topic.name}", lambda data, _origin: on_message(data), types, qos
        )
        guid = made[0].guid.bytes
        self._readers.append(guid)

        def end() -> None:
            if made not in self._kept:
                return  # the node was closed
            self._kept.remove(made)
            made.clear()  # clearing removes them from the domain
            self._readers.remove(guid)
            self.announce()

        return end

    def subscribe_nodes(self, on_message: Callable[[bytes], None]) -> None:
        """Call `on_message` with the nodes of participants in other processes, in a thread of DDS.

        A write waits for readers of its own process with Python's lock held, and a reader that is
        called by another thread waits for that lock; so `announce` has no reader here.
        """
        from cyclonedds.qos import Policy
        from cyclonedds.qos import Qos as DdsQos

        topic = msgspec.structs.replace(NODES, qos=Qos(latched=True, depth=_MOST_PARTICIPANTS))
        qos = _make_qos(topic, None) + DdsQos(Policy.IgnoreLocal.Process)
        self._create_reader(topic, topic.name, lambda data, _origin: on_message(data), None, qos)

    def _create_reader(
        self,
        topic: Topic,
        name: str,
        on_sample: OnSample,
        types: Typestore | None,
        qos: Any,
        user: str = "",
        on_writer: Callable[[SampleOrigin], None] | None = None,
    ) -> list[Any]:
        """Create a reader; it lives as long as the list of it and its parts."""
        from cyclonedds.core import Listener
        from cyclonedds.sub import DataReader

        class MessageListener(Listener):
            def on_data_available(self, reader: Any) -> None:
                if reader is None:  # it is being closed
                    return
                for data, handle in _take(reader):
                    on_sample(data, SampleOrigin(reader, handle))

            def on_subscription_matched(self, reader: Any, status: Any) -> None:
                if reader is not None and on_writer and status.current_count_change > 0:
                    on_writer(SampleOrigin(reader, status.last_publication_handle))

        listener = MessageListener()  # type: ignore[no-untyped-call]
        made = self._create_topic(topic, name, types, user)
        reader = [DataReader(self._subscriber, made, qos, listener), listener, made]
        self._kept.append(reader)
        return reader

    def announce(self) -> None:
        """Announce the name of the node of these endpoints."""
        make = load_dds_types().types
        node = make["rmw_dds_common/msg/NodeEntitiesInfo"](
            "/",
            self._name,
            [_make_gid(guid) for guid in self._readers],
            [_make_gid(guid) for guid in self._writers],
        )
        info = make[NODES.ros_type](_make_gid(self._participant.guid.bytes), [node])
        write(self._discovery, bytes(load_dds_types().serialize_cdr(info, NODES.ros_type)))

    def close(self) -> None:
        """Drop all entities, which removes them from the domain."""
        self._kept.clear()
        self._discovery = self._publisher = self._subscriber = self._participant = None
        self._domain = None

    def _create_writer(
        self, topic: Topic, name: str, types: Typestore | None = None, user: str = ""
    ) -> Any:
        from cyclonedds.pub import DataWriter

        made = self._create_topic(topic, name, types, user)
        writer = DataWriter(self._publisher, made, _make_qos(topic, types, user))
        self._kept.append([writer, made])
        return writer

    def _create_topic(self, topic: Topic, name: str, types: Typestore | None, user: str) -> Any:
        from cyclonedds.topic import Topic as DdsTopic

        make = make_dds_service_type if user else make_dds_type
        described = make(topic.ros_type, types or load_dds_types())
        return DdsTopic(self._participant, name, described)


def _join_domain(make: Any, domain: int) -> Any:
    """Join a domain with our settings, unless it was joined before or the user has settings."""
    from cyclonedds.core import DDSException

    if os.environ.get("CYCLONEDDS_URI"):
        return None  # Cyclone reads it itself

    try:
        return make(domain, _LOCAL.format(keep=_KEEP_PEERS if _read_major_version() >= 11 else ""))
    except DDSException:
        return None


def _make_qos(topic: Topic, types: Typestore | None, user: str = "") -> Any:
    from cyclonedds.qos import Policy
    from cyclonedds.qos import Qos as DdsQos
    from cyclonedds.util import duration

    qos: Qos = topic.qos
    reliable = Policy.Reliability.Reliable(duration(milliseconds=_BLOCKING_MS))
    type_hash = (types or load_dds_types()).hash_rihs01(topic.ros_type)
    return DdsQos(
        reliable if qos.reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if qos.latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(qos.depth),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
        Policy.Userdata(f"{user}typehash={type_hash};".encode()),
    )


def write(writer: Any, data: bytes) -> None:
    """Write a message in CDR.

    Raises: BridgeError: the writer is gone.
    """
    from cyclonedds._clayer import ddspy_write

    if ddspy_write(writer._ref, data) < 0:
        raise BridgeError("DDS: cannot send; was the participant closed?")


def _take(reader: Any) -> list[tuple[bytes, int]]:
    """Take all messages as bytes, each with the handle of its writer.

    The package's own decoder is 500 times slower.
    """
    from cyclonedds._clayer import ddspy_take

    mask = (_ANY_STATE,) if _read_major_version() >= 11 else ()
    taken: list[tuple[bytes, int]] = []
    while True:
        samples = ddspy_take(reader._ref, *mask, _TAKEN_AT_ONCE)
        if not isinstance(samples, list) or not samples:
            return taken
        taken += [(data, info.publication_handle) for data, info in samples if info.valid_data]


@functools.cache  # asked for every message that arrives
def _read_major_version() -> int:
    return int(metadata.version("cyclonedds").partition(".")[0])


def _make_gid(guid: bytes) -> Any:
    return load_dds_types().types["rmw_dds_common/msg/Gid"](np.frombuffer(guid, dtype=np.uint8))
