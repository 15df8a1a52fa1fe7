"""A ROS 2 node on plain zenoh, in the format of `rmw_zenoh_cpp`, without ROS."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rosbags.typesys.store import Typestore

from agribot.core.errors import BridgeError
from agribot.core.extras import format_install
from agribot.core.topics import Qos, Topic
from agribot.ros.messages.dds_names import from_dds_name
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.ros2 import wire

if TYPE_CHECKING:
    import zenoh

ROUTER = "tcp/127.0.0.1:7447"
_HEARTBEAT_S = 0.5  # period of latched topics, as in rmw_zenoh


class Ros2Node:
    """One session with one node in it; its declarations live until it is closed.

    Raises: BridgeError: zenoh is not installed, or neither role of the endpoint is possible.
    """

    def __init__(self, name: str, domain: int, router: str, *, listen: bool) -> None:
        self.domain, self._router = domain, router
        self.session, self.role = _open_session(router, listen=listen)
        self.zid = str(self.session.info.zid())
        self._name = wire.NodeName(domain=domain, zid=self.zid, name=name)
        self._ids = itertools.count(1)
        self._kept: list[Any] = []  # zenoh undeclares every object that is dropped
        self._declare_token(self._name.make_token())

    def keep(self, declared: Any) -> None:
        self._kept.append(declared)

    def announce(
        self, kind: wire.EntityKind, name: str, ros_type: str, type_hash: str, qos: Qos
    ) -> str:
        """Announce an endpoint; return its token."""
        token = self._name.make_endpoint_token(
            next(self._ids), kind, name, ros_type, type_hash, qos
        )
        self._declare_token(token)
        return token

    def create_publisher(self, topic: Topic, types: Typestore | None = None) -> TopicPublisher:
        """Create a publisher; `types` has the topic's type where the default types have not."""
        type_hash = (types or load_types()).hash_rihs01(topic.ros_type)
        key = wire.make_topic_key(self.domain, topic.name, topic.ros_type, type_hash)
        publisher = _declare_publisher(self.session, key, topic.qos)
        token = self.announce("MP", topic.name, topic.ros_type, type_hash, topic.qos)
        return TopicPublisher(publisher, wire.compute_gid(token))

    def subscribe(self, topic: Topic, on_message: Callable[[bytes], None], qos: Qos) -> None:
        """Call `on_message` with CDR in a thread of zenoh, at once with a latched message."""

        def on_sample(sample: zenoh.Sample) -> None:
            on_message(sample.payload.to_bytes())

        self.keep(_subscribe(self.session, self._make_key(topic), qos, on_sample))
        self.announce("MS", topic.name, topic.ros_type, _compute_hash(topic), qos)

    def subscribe_any(self, name: str, on_message: Callable[[str, str, bytes], None]) -> None:
        """Call `on_message` with type, type hash and CDR of every message of this topic name."""

        def on_sample(sample: zenoh.Sample) -> None:
            found = wire.read_topic_key(str(sample.key_expr))
            if found is not None:
                on_message(*found, sample.payload.to_bytes())

        key = f"{self.domain}/{name.strip('/')}/*/*"
        self.keep(self.session.declare_subscriber(key, on_sample))

    def list_topics(self) -> dict[str, str]:
        """List the topics that nodes of the domain publish, with their types."""
        found = (wire.read_endpoint(token) for token in self.list_tokens())
        return {one.name: from_dds_name(one.type_name) for one in found
                if one and one.kind == "MP"}  # fmt: skip

    def subscribe_found(
        self, found: wire.FoundPublisher, on_message: Callable[[bytes], None]
    ) -> Callable[[], None]:
        """Subscribe to a topic that another node announces; return what ends the subscription."""

        def on_sample(sample: zenoh.Sample) -> None:
            on_message(sample.payload.to_bytes())

        qos = Qos(reliable=found.is_reliable, latched=found.is_latched)
        key = wire.make_topic_key(self.domain, found.name, found.ros_type, found.type_hash)
        subscriber = _subscribe(self.session, key, qos, on_sample)
        token = self._name.make_endpoint_token(
            next(self._ids), "MS", found.name, found.ros_type, found.type_hash, qos
        )
        announced = self.session.liveliness().declare_token(token)

        def end() -> None:
            subscriber.undeclare()
            announced.undeclare()  # type: ignore[no-untyped-call]

        return end

    def check_router(self, timeout_s: float = 1.0) -> None:
        """Wait for a moment for the router.

        Raises: BridgeError: none answers.
        """
        end_s = time.monotonic() + timeout_s
        while not (self.role == "router" or self.session.info.routers_zid()):
            if time.monotonic() > end_s:
                raise BridgeError(
                    f"ROS 2: no zenoh router answers at {self._router}; start rmw_zenohd or a run "
                    "with --ros2, or set --ros-router"
                )
            time.sleep(0.05)

    def list_tokens(self, timeout_s: float = 2.0) -> list[str]:
        """List what the nodes of the domain announce: themselves and their endpoints."""
        replies = self.session.liveliness().get(
            f"{wire.ADMIN_SPACE}/{self.domain}/**", timeout=timeout_s
        )
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    def close(self) -> None:
        if not self.session.is_closed():
            self.session.close()  # type: ignore[no-untyped-call]

    def _declare_token(self, token: str) -> None:
        self.keep(self.session.liveliness().declare_token(token))

    def _make_key(self, topic: Topic) -> str:
        return wire.make_topic_key(self.domain, topic.name, topic.ros_type, _compute_hash(topic))


def _compute_hash(topic: Topic) -> str:
    return load_types().hash_rihs01(topic.ros_type)


def _subscribe(
    session: zenoh.Session, key: str, qos: Qos, on_sample: Callable[[zenoh.Sample], None]
) -> Any:
    import zenoh
    from zenoh import ext

    if not qos.latched:  # as in ROS 1 a node does not hear itself
        return session.declare_subscriber(key, on_sample, allowed_origin=zenoh.Locality.REMOTE)
    return ext.declare_advanced_subscriber(
        session,
        key,
        on_sample,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth),
        recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
        subscriber_detection=True,
    )


class TopicPublisher:
    """Numbers and stamps the messages of one topic."""

    def __init__(self, publisher: Any, gid: bytes) -> None:
        self._publisher, self._gid = publisher, gid
        self._sequence = itertools.count(1)

    def __call__(self, data: bytes) -> None:
        import zenoh

        mark = wire.pack_attachment(next(self._sequence), time.time_ns(), self._gid)
        try:
            self._publisher.put(data, attachment=mark)
        except zenoh.ZError as error:
            raise BridgeError(f"ROS 2: cannot send: {error}; check the router") from error


def _declare_publisher(session: zenoh.Session, key: str, qos: Qos) -> Any:
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


def _open_session(router: str, *, listen: bool) -> tuple[zenoh.Session, str]:
    """Open a session as router on the endpoint, or as a peer of a router that is there already."""
    try:
        import zenoh
    except ImportError as error:
        raise BridgeError(
            f"the ROS 2 bridge needs eclipse-zenoh and xxhash; {format_install('ros')}"
        ) from error
    zenoh.init_log_from_env_or("error")
    roles = {"router": [router]} if listen else {}
    for role, endpoints in {**roles, "peer": ["tcp/127.0.0.1:0"]}.items():
        connect = [] if role == "router" else [router]
        try:
            return zenoh.open(_make_config(role, endpoints, connect)), role
        except zenoh.ZError as error:
            last = error
    raise BridgeError(
        f"ROS 2: cannot listen on or connect to {router}: {last}; is the endpoint right?"
    )


def _make_config(mode: str, listen: Sequence[str], connect: Sequence[str]) -> zenoh.Config:
    import zenoh

    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "scouting/multicast/enabled": False,  # nothing leaves this machine by default
        "scouting/gossip/enabled": True,
        "timestamping/enabled": True,  # latched topics are ordered by it
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
