"""Listening to one topic of a ROS 1 master: a connection and a thread for each publisher."""

from __future__ import annotations

import socket
import threading
import xmlrpc.client
from collections.abc import Callable
from typing import Any
from urllib.parse import urlparse

from agribot.core.errors import BridgeError
from agribot.ros.ros1 import tcpros
from agribot.ros.ros1.node import Node
from agribot.ros.ros1.types import definition, ros1_name

_RETRY_S = 0.5
_ANSWER_S = 5.0

Heard = Callable[[bytes, str, str], None]  # the message, "ROS 1 node /name", and its type
ANY = "*"
Refused = Callable[[str], None]


class Hearing:
    """Calls `heard` from the thread of a connection; `refused` is told why a publisher is not.

    With the type `ANY` it hears whatever is published there.

    Raises: BridgeError: the master does not answer.
    """

    def __init__(self, node: Node, name: str, ros_type: str, heard: Heard, refused: Refused):
        self._node, self._name, self._ros_type = node, name, ros_type
        self._heard, self._refused = heard, refused
        self._stopped = threading.Event()
        self._links: set[str] = set()
        node.subscribe(name, ros_type, self._link)

    def close(self) -> None:
        self._stopped.set()

    def _link(self, _topic: str, uris: list[str]) -> None:
        wanted = {uri for uri in uris if uri != self._node.uri}
        new, self._links = wanted - self._links, wanted  # first: a thread ends where it is not
        for uri in new:
            threading.Thread(target=self._follow, args=(uri,), daemon=True).start()

    def _follow(self, uri: str) -> None:
        """Until the master says that this publisher is gone."""
        while uri in self._links and not self._stopped.is_set():
            try:
                self._listen(uri)
            except BridgeError as error:
                self._refused(f"ROS 1: {uri}: {error}")
                return
            except (OSError, xmlrpc.client.Error, TypeError, ValueError):
                self._stopped.wait(_RETRY_S)

    def _listen(self, uri: str) -> None:
        with xmlrpc.client.ServerProxy(uri) as proxy:
            slave: Any = proxy
            code, text, protocol = slave.requestTopic(self._node.name, self._name, [["TCPROS"]])
        if code != 1:
            raise BridgeError(f"does not hand out {self._name}: {text}")
        _, host, port = protocol
        peer_host = str(host) or str(urlparse(uri).hostname)
        with socket.create_connection((peer_host, int(port)), timeout=_ANSWER_S) as sock:
            sock.sendall(tcpros.pack_header(self._wish()))
            answer = tcpros.read_header(tcpros.receive_frame(sock, tcpros.MAX_HEADER_BYTES))
            if "error" in answer:
                raise BridgeError(answer["error"])
            source = f"ROS 1 node {answer.get('callerid', uri)}"
            ros_type = "/msg/".join(answer.get("type", "").split("/"))
            limit = tcpros.MAX_SENSOR_BYTES if self._ros_type == ANY else tcpros.MAX_MESSAGE_BYTES
            sock.settimeout(None)
            while uri in self._links and not self._stopped.is_set():
                self._heard(tcpros.receive_frame(sock, limit), source, ros_type)

    def _wish(self) -> dict[str, str]:
        return {
            "callerid": self._node.name,
            "topic": self._name,
            "type": ros1_name(self._ros_type),
            "md5sum": ANY if self._ros_type == ANY else definition(self._ros_type)[1],
            "tcp_nodelay": "1",
        }
