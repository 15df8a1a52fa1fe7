"""A ROS 2 node on plain zenoh: what `rmw_zenoh_cpp` would do, without ROS.

Opt-in and local: it listens on the loopback and takes the role of the zenoh router, so that ROS 2
programs with RMW_IMPLEMENTATION=rmw_zenoh_cpp find it as they are. Where a router runs already,
the node joins it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from agribot import topics
from agribot.bridge.requests import PAUSE_SERVICE, SERVICES, Requests, read_twist_cdr
from agribot.bridge.ros2 import wire
from agribot.bridge.ros2.node import ROUTER, Ros2Node
from agribot.bridge.ros2.services import service_types
from agribot.errors import BridgeError
from agribot.topic import Qos, Topic

if TYPE_CHECKING:
    import zenoh

NODE = "agribot"
_SERVICE_QOS = Qos()
_COMMAND_QOS = Qos()


class Ros2Gateway:
    """Publishes `out`; hears cmd_vel (with `requests.allow_drive`) and, if it `serves`, services.

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
        serves: bool = True,
    ) -> None:
        self._requests = requests
        self._node = Ros2Node(NODE, domain, router, listen=listen)
        self.role = self._node.role
        self._writers = {topic.name: self._node.writer(topic) for topic in out}
        self._watch_publishers()
        if requests.allow_drive:
            self._hear_twists()
        for name, action in SERVICES if serves else ():
            self._serve(name, "std_srvs/srv/Trigger", self._trigger(action))
        if serves:
            self._serve(PAUSE_SERVICE, "std_srvs/srv/SetBool", self._pause)

    def publish(self, topic: Topic, data: bytes, _t_ns: int) -> None:
        writer = self._writers.get(topic.name)
        if writer is not None:
            writer(data)

    def close(self) -> None:
        self._node.close()

    def _hear_twists(self) -> None:
        topic = topics.CMD_VEL

        def heard(data: bytes) -> None:
            try:
                self._requests.twist(read_twist_cdr(data), "ROS 2")
            except BridgeError as error:
                self._requests.refuse(f"ROS 2: {topic.name}: {error}")

        self._node.hear(topic, heard, _COMMAND_QOS)

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

        key = f"{wire.ADMIN_SPACE}/{self._node.domain}/**"
        watch = self._node.session.liveliness().declare_subscriber(key, appeared, history=True)
        self._node.keep(watch)

    def _serve(self, name: str, ros_type: str, answer: Callable[[bytes], tuple[bool, str]]) -> None:
        types = service_types()
        type_hash = types.hash_rihs01(ros_type)
        key = wire.topic_key(self._node.domain, name, ros_type, type_hash)
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

        self._node.keep(self._node.session.declare_queryable(key, asked, complete=True))
        self._node.announce("SS", name, ros_type, type_hash, _SERVICE_QOS)

    def _trigger(self, action: Any) -> Callable[[bytes], tuple[bool, str]]:
        return lambda _request: self._requests.act(action, "ROS 2")

    def _pause(self, request: bytes) -> tuple[bool, str]:
        if len(request) < 5:
            return False, f"{len(request)} bytes are no SetBool request"
        return self._requests.act("pause" if request[4] else "resume", "ROS 2")
