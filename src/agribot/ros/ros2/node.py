"""A ROS 2 node on plain zenoh: what `rmw_zenoh_cpp` would do, without ROS."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rosbags.typesys.store import Typestore

from agribot.core.errors import BridgeError
from agribot.core.topics import Qos, Topic
from agribot.ros.messages.rosmsg import typestore
from agribot.ros.ros2 import wire

if TYPE_CHECKING:
    import zenoh

ROUTER = "tcp/127.0.0.1:7447"
_HEARTBEAT_S = 0.5  # of latched topics, as rmw_zenoh does


class Ros2Node:
    """One session with one node in it; what it declares lives until it is closed.

    Raises: BridgeError: zenoh is not installed, or neither role of the endpoint can be had.
    """

    def __init__(self, name: str, domain: int, router: str, *, listen: bool) -> None:
        self.domain = domain
        self.session, self.role = _open(router, listen=listen)
        self.zid = str(self.session.info.zid())
        self._name = wire.NodeName(domain=domain, zid=self.zid, name=name)
        self._ids = itertools.count(1)
        self._kept: list[Any] = []  # what is dropped is undeclared
        self._token(self._name.token())

    def keep(self, declared: Any) -> None:
        self._kept.append(declared)

    def announce(
        self, kind: wire.EntityKind, name: str, ros_type: str, type_hash: str, qos: Qos
    ) -> str:
        """Tell others of an endpoint; returns its token."""
        token = self._name.endpoint_token(next(self._ids), kind, name, ros_type, type_hash, qos)
        self._token(token)
        return token

    def writer(self, topic: Topic, types: Typestore | None = None) -> Writer:
        """`types` knows the topic's type where the usual ones do not."""
        type_hash = (types or typestore()).hash_rihs01(topic.ros_type)
        key = wire.topic_key(self.domain, topic.name, topic.ros_type, type_hash)
        publisher = _declare(self.session, key, topic.qos)
        token = self.announce("MP", topic.name, topic.ros_type, type_hash, topic.qos)
        return Writer(publisher, wire.gid_of(token))

    def hear(self, topic: Topic, heard: Callable[[bytes], None], qos: Qos) -> None:
        """`heard` gets CDR in a thread of zenoh; a latched topic gives its last at once."""

        def arrived(sample: zenoh.Sample) -> None:
            heard(sample.payload.to_bytes())

        self.keep(_subscribe(self.session, self._key(topic), qos, arrived))
        self.announce("MS", topic.name, topic.ros_type, _hash_of(topic), qos)

    def hear_any(self, name: str, heard: Callable[[str, str, bytes], None]) -> None:
        """`heard` gets type, type hash and CDR of whatever is said on a topic of this name."""

        def arrived(sample: zenoh.Sample) -> None:
            found = wire.read_topic_key(str(sample.key_expr))
            if found is not None:
                heard(*found, sample.payload.to_bytes())

        key = f"{self.domain}/{name.strip('/')}/*/*"
        self.keep(self.session.declare_subscriber(key, arrived))

    def close(self) -> None:
        if not self.session.is_closed():
            self.session.close()  # type: ignore[no-untyped-call]

    def _token(self, token: str) -> None:
        self.keep(self.session.liveliness().declare_token(token))

    def _key(self, topic: Topic) -> str:
        return wire.topic_key(self.domain, topic.name, topic.ros_type, _hash_of(topic))


def _hash_of(topic: Topic) -> str:
    return typestore().hash_rihs01(topic.ros_type)


def _subscribe(
    session: zenoh.Session, key: str, qos: Qos, arrived: Callable[[zenoh.Sample], None]
) -> Any:
    from zenoh import ext

    if not qos.latched:
        return session.declare_subscriber(key, arrived)
    return ext.declare_advanced_subscriber(
        session,
        key,
        arrived,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth),
        recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
        subscriber_detection=True,
    )


class Writer:
    """Numbers and stamps what goes out on one topic."""

    def __init__(self, publisher: Any, gid: bytes) -> None:
        self._publisher, self._gid = publisher, gid
        self._sequence = itertools.count(1)

    def __call__(self, data: bytes) -> None:
        import zenoh

        mark = wire.pack_attachment(next(self._sequence), time.time_ns(), self._gid)
        try:
            self._publisher.put(data, attachment=mark)
        except zenoh.ZError as error:
            raise BridgeError(f"ROS 2: cannot send: {error}") from error


def _declare(session: zenoh.Session, key: str, qos: Qos) -> Any:
    import zenoh
    from zenoh import ext

    reliability = zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT
    drop = zenoh.CongestionControl.DROP
    if not qos.latched:
        return session.declare_publisher(key, congestion_control=drop, reliability=reliability)
    return ext.declare_advanced_publisher(
        session,
        key,
        congestion_control=drop,
        reliability=reliability,
        publisher_detection=True,
        cache=ext.CacheConfig(max_samples=qos.depth),
        sample_miss_detection=ext.MissDetectionConfig(
            heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S
        ),
    )


def _open(router: str, *, listen: bool) -> tuple[zenoh.Session, str]:
    """A session as router on the endpoint, or as a peer of the router that is there already."""
    try:
        import zenoh
    except ImportError as error:
        raise BridgeError(
            "the ROS 2 bridge needs eclipse-zenoh and xxhash: pip install 'agribot[ros]'"
        ) from error
    zenoh.init_log_from_env_or("error")
    roles = {"router": [router]} if listen else {}
    for role, endpoints in {**roles, "peer": ["tcp/127.0.0.1:0"]}.items():
        connect = [] if role == "router" else [router]
        try:
            return zenoh.open(_settings(role, endpoints, connect)), role
        except zenoh.ZError as error:
            last = error
    raise BridgeError(
        f"ROS 2: cannot listen on or connect to {router}: {last}; is the endpoint right?"
    )


def _settings(mode: str, listen: Sequence[str], connect: Sequence[str]) -> zenoh.Config:
    import zenoh

    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "scouting/multicast/enabled": False,  # nothing leaves this machine by itself
        "scouting/gossip/enabled": True,
        "timestamping/enabled": True,  # latched topics are ordered by it
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
