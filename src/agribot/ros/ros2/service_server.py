"""Services of a ROS 2 node, answered at once or later."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rosbags.typesys.store import Typestore

from agribot.core.topics import Qos
from agribot.ros.ros2 import wire
from agribot.ros.ros2.node import Ros2Node

if TYPE_CHECKING:
    import zenoh

Reply = Callable[..., None]  # with the fields of the response; may be called later, once
Answer = Callable[[Any, Reply], None]  # gets the request
_SERVICE_QOS = Qos()


class ServiceServer:
    """Services of one node; `refuse` is called for bytes that are no request."""

    def __init__(self, node: Ros2Node, refuse: Callable[[str], None]) -> None:
        self._node, self._refuse = node, refuse

    def serve(
        self,
        types: Typestore,
        name: str,
        ros_type: str,
        answer: Answer,
        to_garbage: tuple[Any, ...] = (),
    ) -> None:
        """Serve the service `name`; a thread of zenoh calls `answer` with each request.

        `to_garbage` are the fields of the answer to bytes that are no request; none: no answer.
        """
        type_hash = types.hash_rihs01(ros_type)
        key = wire.make_topic_key(self._node.domain, name, ros_type, type_hash)

        def on_query(query: zenoh.Query) -> None:
            payload, attachment = query.payload, query.attachment
            mark = wire.read_attachment(attachment.to_bytes()) if attachment else None
            if mark is None or payload is None:
                self._refuse(f"ROS 2: {name} was asked by something that is no client")
                query.drop()  # type: ignore[no-untyped-call]
                return

            def reply(*fields: Any) -> None:
                response_type = f"{ros_type}_Response"
                response = types.types[response_type](*fields)
                data = bytes(types.serialize_cdr(response, response_type))
                echo = wire.pack_attachment(mark.sequence, time.time_ns(), mark.gid)
                query.reply(query.key_expr, data, attachment=echo)
                query.drop()  # type: ignore[no-untyped-call]

            data = payload.to_bytes()
            try:
                request = types.deserialize_cdr(data, f"{ros_type}_Request")
            except Exception:  # noqa: BLE001  the generated code of rosbags raises any error
                self._refuse(f"ROS 2: {name}: {len(data)} bytes are no request of {ros_type}")
                if to_garbage:
                    reply(*to_garbage)
                else:
                    query.drop()  # type: ignore[no-untyped-call]
                return
            answer(request, reply)

        self._node.keep(self._node.session.declare_queryable(key, on_query, complete=True))
        self._node.announce("SS", name, ros_type, type_hash, _SERVICE_QOS)
