"""Services of a ROS 2 node over rmw_zenoh's wire, answered at once or later."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rosbags.typesys.store import Typestore

from agribot.core.topics import Qos, Topic
from agribot.ros.ros2 import wire
from agribot.ros.ros2.node import Ros2Node, TopicPublisher
from agribot.ros.ros2.serving import Answer, ServedType

if TYPE_CHECKING:
    import zenoh

_SERVICE_QOS = Qos()


class ServiceServer:
    """A node that serves, too; `refuse` is called for bytes that are no request."""

    source = "ROS 2"
    distinguishes_forms = True  # the hash of the type is a part of the key

    def __init__(self, node: Ros2Node, refuse: Callable[[str], None]) -> None:
        self._node, self._refuse = node, refuse

    def create_publisher(self, topic: Topic, types: Typestore | None = None) -> TopicPublisher:
        return self._node.create_publisher(topic, types)

    def subscribe(self, topic: Topic, on_message: Callable[[bytes], None]) -> None:
        self._node.subscribe(topic, on_message, topic.qos)

    def serve(
        self,
        types: Typestore,
        name: str,
        ros_type: str,
        answer: Answer,
        to_garbage: tuple[Any, ...] = (),
    ) -> None:
        type_hash = types.hash_rihs01(ros_type)
        key = wire.make_topic_key(self._node.domain, name, ros_type, type_hash)
        service = ServedType(types, name, ros_type, answer, to_garbage)

        def on_query(query: zenoh.Query) -> None:
            self._take(service, query)

        self._node.keep(self._node.session.declare_queryable(key, on_query, complete=True))
        self._node.announce("SS", name, ros_type, type_hash, _SERVICE_QOS)

    def _take(self, service: ServedType, query: zenoh.Query) -> None:
        payload, attachment = query.payload, query.attachment
        mark = wire.read_attachment(attachment.to_bytes()) if attachment else None
        if mark is None or payload is None:
            self._refuse(f"ROS 2: {service.name} was asked by something that is no client")
            query.drop()  # type: ignore[no-untyped-call]
            return

        def send(data: bytes) -> None:
            echo = wire.pack_attachment(mark.sequence, time.time_ns(), mark.gid)
            query.reply(query.key_expr, data, attachment=echo)
            query.drop()  # type: ignore[no-untyped-call]

        if wrong := service.take(payload.to_bytes(), send):
            self._refuse(f"ROS 2: {wrong}")
            if not service.to_garbage:
                query.drop()  # type: ignore[no-untyped-call]
