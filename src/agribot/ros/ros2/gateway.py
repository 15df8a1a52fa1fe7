"""A ROS 2 node on plain zenoh, in the format of `rmw_zenoh_cpp`, without ROS.

Opt-in and local: it listens on the loopback and takes the role of the zenoh router, so that ROS 2
programs with RMW_IMPLEMENTATION=rmw_zenoh_cpp find it without settings. Where a router runs
already, the node joins it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from agribot.core import topics
from agribot.core.topics import Qos, Topic
from agribot.ros.messages.dds_names import to_dds_name
from agribot.ros.node_gateway import NodeGateway
from agribot.ros.requests import Requests
from agribot.ros.ros2 import wire
from agribot.ros.ros2.node import ROUTER, Ros2Node
from agribot.ros.ros2.parameters import Value
from agribot.ros.ros2.robot_server import Ros2RobotServer
from agribot.ros.ros2.service_server import ServiceServer

if TYPE_CHECKING:
    import zenoh

NODE = "agribot"
_COMMAND_QOS = Qos()


class Ros2Gateway(NodeGateway):
    """Publishes `out`; takes cmd_vel (with `requests.allow_drive`).

    If it `serves`, there are services, goals, the inbound topics, and `settings` as parameters.

    Raises: BridgeError: zenoh is not installed, or neither role of the endpoint is possible.
    """

    source = "ROS 2"

    def __init__(
        self,
        requests: Requests,
        out: Sequence[Topic],
        *,
        domain: int = 0,
        router: str = ROUTER,
        listen: bool = True,
        serves: bool = True,
        settings: Mapping[str, Value] | None = None,
    ) -> None:
        super().__init__(requests)
        self._node = Ros2Node(NODE, domain, router, listen=listen)
        self.role = self._node.role
        self._writers = {
            topic.name: [self._node.create_publisher(named) for named in topic.list_named()]
            for topic in out
        }
        self._watch_publishers()
        if requests.allow_drive:
            self._node.subscribe(topics.CMD_VEL, self._take_twist, _COMMAND_QOS)
        if serves:
            server = ServiceServer(self._node, requests.refuse)
            self._robot = Ros2RobotServer(server, NODE, requests, settings or {})

    def close(self) -> None:
        super().close()
        self._node.close()

    def _watch_publishers(self) -> None:
        """Report publishers of twists that are refused, or of another type, which cannot arrive."""
        import zenoh

        wanted = to_dds_name(topics.CMD_VEL.ros_type)

        def on_endpoint(sample: zenoh.Sample) -> None:
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
        watch = self._node.session.liveliness().declare_subscriber(key, on_endpoint, history=True)
        self._node.keep(watch)
