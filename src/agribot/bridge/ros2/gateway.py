"""A ROS 2 node on plain zenoh: what `rmw_zenoh_cpp` would do, without ROS.

Opt-in and local: it listens on the loopback and takes the role of the zenoh router, so that ROS 2
programs with RMW_IMPLEMENTATION=rmw_zenoh_cpp find it as they are. Where a router runs already,
the node joins it.
"""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from agribot import topics
from agribot.bridge.requests import PAUSE_SERVICE, SERVICES, Requests, read_twist_cdr
from agribot.bridge.ros2 import wire
from agribot.bridge.ros2.services import service_types
from agribot.errors import BridgeError
from agribot.ros.rosmsg import typestore
from agribot.topic import Qos, Topic

if TYPE_CHECKING:
    import zenoh

ROUTER = "tcp/127.0.0.1:7447"
NODE = "agribot"
_SERVICE_QOS = Qos()
_COMMAND_QOS = Qos()
_HEARTBEAT_S = 0.5  # of latched topics, as rmw_zenoh does


class Ros2Gateway:
    """Publishes `out`; hears cmd_vel (with `requests.allow_drive`) and the services.

    Raises: BridgeError: zenoh is not installed, or neither role of the endpoint can be had.
    """

    def __init__(
        self,
        requests: Requests,
        out: Sequence[Topic],
        *,
        domain: int = 0,
        router: str = ROUTER,
        listen: bool = True,
    ) -> None:
        self._requests, self._domain = requests, domain
        self._session, self.role = _open(router, listen=listen)
        zid = str(self._session.info.zid())
        self._node = wire.NodeName(domain=domain, zid=zid, name=NODE)
        self._ids = itertools.count(1)
        self._kept: list[Any] = []  # what is dropped is undeclared
        self._token(self._node.token())
        self._writers = {topic.name: self._writer(topic) for topic in out}
        self._watch_publishers()
        if requests.allow_drive:
            self._hear_twists()
        for name, action in SERVICES:
            self._serve(name, "std_srvs/srv/Trigger", self._trigger(action))
        self._serve(PAUSE_SERVICE, "std_srvs/srv/SetBool", self._pause)

    def publish(self, topic: Topic, data: bytes, _t_ns: int) -> None:
        writer = self._writers.get(topic.name)
        if writer is not None:
            writer(data)

    def close(self) -> None:
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]

    def _token(self, token: str) -> None:
        self._kept.append(self._session.liveliness().declare_token(token))

    def _writer(self, topic: Topic) -> _Writer:
        type_hash = typestore().hash_rihs01(topic.ros_type)
        key = wire.topic_key(self._domain, topic.name, topic.ros_type, type_hash)
        token = self._node.endpoint_token(
            next(self._ids), "MP", topic.name, topic.ros_type, type_hash, topic.qos
        )
        writer = _Writer(_declare(self._session, key, topic.qos), wire.gid_of(token))
        self._token(token)
        return writer

    def _hear_twists(self) -> None:
        topic = topics.CMD_VEL
        type_hash = typestore().hash_rihs01(topic.ros_type)
        key = wire.topic_key(self._domain, topic.name, topic.ros_type, type_hash)

        def heard(sample: zenoh.Sample) -> None:
            try:
                self._requests.twist(read_twist_cdr(sample.payload.to_bytes()), "ROS 2")
            except BridgeError as error:
                self._requests.refuse(f"ROS 2: {topic.name}: {error}")

        self._kept.append(self._session.declare_subscriber(key, heard))
        token = self._node.endpoint_token(
            next(self._ids), "MS", topic.name, topic.ros_type, type_hash, _COMMAND_QOS
        )
        self._token(token)

    def _watch_publishers(self) -> None:
        """A twist of another type goes to another key and is never heard: say so."""
        import zenoh

        wanted = wire.dds_type(topics.CMD_VEL.ros_type)

        def appeared(sample: zenoh.Sample) -> None:
            peer = wire.read_endpoint(str(sample.key_expr))
            is_ours = f"/{self._node.zid}/" in str(sample.key_expr)
            if peer is None or is_ours or sample.kind != zenoh.SampleKind.PUT:
                return
            if (peer.kind, peer.name) != ("MP", topics.CMD_VEL.name):
                return
            if peer.type_name != wanted:
                self._requests.refuse(
                    f"ROS 2: node {peer.node} publishes {peer.type_name} on {peer.name}, which "
                    f"takes {wanted}; it is not heard"
                )
            elif not self._requests.allow_drive:
                self._requests.refuse(
                    f"ROS 2: node {peer.node} publishes {peer.name}, which is refused; "
                    "start with --allow-drive to take it"
                )

        key = f"{wire.ADMIN_SPACE}/{self._domain}/**"
        watch = self._session.liveliness().declare_subscriber(key, appeared, history=True)
        self._kept.append(watch)

    def _serve(self, name: str, ros_type: str, answer: Callable[[bytes], tuple[bool, str]]) -> None:
        types = service_types()
        type_hash = types.hash_rihs01(ros_type)
        key = wire.topic_key(self._domain, name, ros_type, type_hash)
        response_type = f"{ros_type}_Response"

        def asked(query: zenoh.Query) -> None:
            with query:
                attachment = query.attachment
                request = wire.read_attachment(attachment.to_bytes()) if attachment else None
                if request is None or query.payload is None:
                    self._requests.refuse(f"ROS 2: {name} was asked by something that is no client")
                    return
                done, text = answer(query.payload.to_bytes())
                response = types.types[response_type](done, text)
                reply = bytes(types.serialize_cdr(response, response_type))
                mark = wire.pack_attachment(request.sequence, time.time_ns(), request.gid)
                query.reply(query.key_expr, reply, attachment=mark)

        self._kept.append(self._session.declare_queryable(key, asked, complete=True))
        token = self._node.endpoint_token(
            next(self._ids), "SS", name, ros_type, type_hash, _SERVICE_QOS
        )
        self._token(token)

    def _trigger(self, action: Any) -> Callable[[bytes], tuple[bool, str]]:
        return lambda _request: self._requests.act(action, "ROS 2")

    def _pause(self, request: bytes) -> tuple[bool, str]:
        if len(request) < 5:
            return False, f"{len(request)} bytes are no SetBool request"
        return self._requests.act("pause" if request[4] else "resume", "ROS 2")


class _Writer:
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
