"""Nodes and topics of a ROS 2 domain over zenoh, from what they announce."""

from __future__ import annotations

from collections import defaultdict

from agribot.ros.graph import Graph, make_graph
from agribot.ros.messages.dds_names import from_dds_name
from agribot.ros.ros2 import wire
from agribot.ros.ros2.node import Ros2Node


def read_graph(node: Ros2Node) -> Graph:
    """Read who publishes and who listens; `node` is our own and is left out.

    Raises: BridgeError: no router answers.
    """
    node.check_router()
    publishers: defaultdict[str, set[str]] = defaultdict(set)
    subscribers: defaultdict[str, set[str]] = defaultdict(set)
    nodes: set[str] = set()
    types: dict[str, str] = {}
    own = f"{wire.ADMIN_SPACE}/{node.domain}/{node.zid}/"
    for token in node.list_tokens():
        name = wire.read_node_name(token)
        if token.startswith(own) or not name:
            continue
        nodes.add(name)
        endpoint = wire.read_endpoint(token)
        if endpoint is None or endpoint.kind not in ("MP", "MS"):
            continue
        side = publishers if endpoint.kind == "MP" else subscribers
        side[endpoint.name].add(name)
        types.setdefault(endpoint.name, from_dds_name(endpoint.type_name))
    return make_graph("ROS 2", nodes, types, dict(publishers), dict(subscribers))
