"""Nodes and topics that a ROS 1 master knows, asked without being a node."""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import Any

from agribot.core.errors import BridgeError
from agribot.ros.graph import Graph, make_graph
from agribot.ros.messages.shown_types import to_full_name

TIMEOUT_S = 3.0
_CALLER = "/agribot_graph"


class _Transport(xmlrpc.client.Transport):
    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection: http.client.HTTPConnection = super().make_connection(host)
        connection.timeout = TIMEOUT_S
        return connection


def read_graph(master_uri: str) -> Graph:
    """Read who publishes and who listens.

    Raises: BridgeError: no master answers, or it refuses.
    """
    with xmlrpc.client.ServerProxy(master_uri, transport=_Transport()) as master:
        published, subscribed, _services = _ask(master, master_uri, "getSystemState")
        types = _ask(master, master_uri, "getTopicTypes")
    publishers = {name: set(nodes) for name, nodes in published}
    subscribers = {name: set(nodes) for name, nodes in subscribed}
    found_types = {name: to_full_name(kind) for name, kind in types if kind != "*"}
    return make_graph("ROS 1", set(), found_types, publishers, subscribers)


def _ask(master: Any, uri: str, method: str) -> Any:
    try:
        code, text, value = getattr(master, method)(_CALLER)
    except (OSError, xmlrpc.client.Error, http.client.HTTPException, ValueError) as error:
        raise BridgeError(
            f"ROS 1: no master answers at {uri}; start roscore, or set --ros-master or "
            "ROS_MASTER_URI"
        ) from error
    if code != 1:
        raise BridgeError(f"ROS 1: the master at {uri} refuses {method}: {text}; restart roscore")
    return value
