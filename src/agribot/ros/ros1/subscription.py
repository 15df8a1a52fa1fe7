"""A subscription to a topic of a ROS 1 master: a connection and a thread for each publisher."""

from __future__ import annotations

import socket
import threading
import xmlrpc.client
from collections.abc import Callable
from typing import Any
from urllib.parse import urlparse

from agribot.core.errors import BridgeError, add_advice
from agribot.ros.ros1 import tcpros
from agribot.ros.ros1.node import Node
from agribot.ros.ros1.types import generate_definition, to_ros1_name

_RETRY_S = 0.5
_ANSWER_S = 5.0

OnMessage = Callable[[bytes, str, str], None]  # the message, "ROS 1 node /name", and its type
ANY = "*"
OnRefusal = Callable[[str], None]


class Subscription:
    """Calls `on_message` from the thread of a connection, `on_refusal` for a rejected publisher.

    With the type `ANY` it takes every type.

    Raises: BridgeError: the master does not answer.
    """

    def __init__(
        self, node: Node, name: str, ros_type: str, on_message: OnMessage, on_refusal: OnRefusal
    ):
        self._node, self._name, self._ros_type = node, node.resolve(name), ros_type
        self._on_message, self._on_refusal = on_message, on_refusal
        self._stopped = threading.Event()
        self._publishers: set[str] = set()
        self._sockets: set[socket.socket] = set()
        node.subscribe(name, ros_type, self._update_publishers)

    def close(self) -> None:
        self._stopped.set()
        for sock in tuple(self._sockets):
            tcpros.wake(sock)

    def _update_publishers(self, _topic: str, uris: list[str]) -> None:
        wanted = {uri for uri in uris if uri != self._node.uri}
        new, self._publishers = (
            wanted - self._publishers,
            wanted,
        )  # first: a thread ends where it is not
        for uri in new:
            threading.Thread(target=self._follow_publisher, args=(uri,), daemon=True).start()

    def _follow_publisher(self, uri: str) -> None:
        """Receive from a publisher until the master removes it."""
        while uri in self._publishers and not self._stopped.is_set():
            try:
                self._listen(uri)
            except BridgeError as error:
                self._on_refusal(f"ROS 1: {uri}: {error}")
                return
            except (OSError, xmlrpc.client.Error, TypeError, ValueError):
                self._stopped.wait(_RETRY_S)

    def _listen(self, uri: str) -> None:
        with xmlrpc.client.ServerProxy(uri) as proxy:
            slave: Any = proxy
            code, text, protocol = slave.requestTopic(self._node.name, self._name, [["TCPROS"]])
        if code != 1:
            raise BridgeError(f"does not hand out {self._name}: {text}; restart that node")
        _, host, port = protocol
        peer_host = str(host) or str(urlparse(uri).hostname)
        with socket.create_connection((peer_host, int(port)), timeout=_ANSWER_S) as sock:
            sock.sendall(tcpros.pack_header(self._make_request_header()))
            answer = tcpros.read_header(tcpros.receive_frame(sock, tcpros.MAX_HEADER_BYTES))
            if "error" in answer:
                raise BridgeError(add_advice(answer["error"], "publish that type"))
            source = f"ROS 1 node {answer.get('callerid', uri)}"
            ros_type = "/msg/".join(answer.get("type", "").split("/"))
            limit = tcpros.MAX_SENSOR_BYTES if self._ros_type == ANY else tcpros.MAX_MESSAGE_BYTES
            sock.settimeout(None)
            self._sockets.add(sock)
            try:
                while uri in self._publishers and not self._stopped.is_set():
                    self._on_message(tcpros.receive_frame(sock, limit), source, ros_type)
            finally:
                self._sockets.discard(sock)

    def _make_request_header(self) -> dict[str, str]:
        return {
            "callerid": self._node.name,
            "topic": self._name,
            "type": to_ros1_name(self._ros_type),
            "md5sum": ANY if self._ros_type == ANY else generate_definition(self._ros_type)[1],
            "tcp_nodelay": "1",
        }
