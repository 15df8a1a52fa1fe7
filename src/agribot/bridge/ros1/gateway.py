"""AGRIBOT as a node of a ROS 1 master, under its own names and those of the original."""

from __future__ import annotations

import socket
import threading
import xmlrpc.client
from collections.abc import Sequence
from typing import Any
from urllib.parse import urlparse

from agribot import topics
from agribot.bridge.requests import Requests
from agribot.bridge.ros1 import tcpros
from agribot.bridge.ros1.node import Node, Publication
from agribot.bridge.ros1.types import Convert, definition, outputs, read_twist, ros1_name
from agribot.errors import BridgeError
from agribot.topic import Topic

MASTER = "http://127.0.0.1:11311"
_RETRY_S = 0.5
_ANSWER_S = 5.0


class Ros1Gateway:
    """Publishes `out`, sets robot_description and use_sim_time, hears cmd_vel if it may.

    Raises: BridgeError: no master answers.
    """

    def __init__(
        self, requests: Requests, out: Sequence[Topic], urdf: str, master_uri: str = MASTER
    ) -> None:
        self._requests = requests
        self._stopped = threading.Event()
        self._links: set[str] = set()
        self._node = Node("agribot", master_uri)
        try:
            self._node.set_param("/robot_description", urdf)
            self._node.set_param("/use_sim_time", any(t is topics.CLOCK for t in out))
            self._outputs = {topic.name: self._advertise(topic) for topic in out}
            if requests.allow_drive:
                self._node.subscribe(topics.CMD_VEL.name, topics.CMD_VEL.ros_type, self._link)
        except BridgeError:
            self.close()
            raise

    def publish(self, topic: Topic, data: bytes, _t_ns: int) -> None:
        for publication, convert in self._outputs.get(topic.name, ()):
            if publication.is_wanted:
                publication.put(convert(data))

    def close(self) -> None:
        self._stopped.set()
        self._node.close()

    def _advertise(self, topic: Topic) -> list[tuple[Publication, Convert]]:
        return [
            (
                self._node.advertise(o.name, o.ros_type, latched=o.latched, depth=o.depth),
                o.convert,
            )
            for o in outputs(topic)
        ]

    def _link(self, _topic: str, uris: list[str]) -> None:
        wanted = {uri for uri in uris if uri != self._node.uri}
        new, self._links = wanted - self._links, wanted  # first: a thread ends where it is not
        for uri in new:
            threading.Thread(target=self._hear, args=(uri,), daemon=True).start()

    def _hear(self, uri: str) -> None:
        """Until the master says that this publisher is gone."""
        while uri in self._links and not self._stopped.is_set():
            try:
                self._listen(uri)
            except BridgeError as error:
                self._requests.refuse(f"ROS 1: {uri}: {error}")
                return
            except (OSError, xmlrpc.client.Error, TypeError, ValueError):
                self._stopped.wait(_RETRY_S)

    def _listen(self, uri: str) -> None:
        name = topics.CMD_VEL.name
        with xmlrpc.client.ServerProxy(uri) as proxy:
            slave: Any = proxy
            code, text, protocol = slave.requestTopic(self._node.name, name, [["TCPROS"]])
        if code != 1:
            raise BridgeError(f"does not hand out {name}: {text}")
        _, host, port = protocol
        peer_host = str(host) or str(urlparse(uri).hostname)
        with socket.create_connection((peer_host, int(port)), timeout=_ANSWER_S) as sock:
            sock.sendall(tcpros.pack_header(self._wish()))
            answer = tcpros.read_header(tcpros.receive_frame(sock, tcpros.MAX_HEADER_BYTES))
            if "error" in answer:
                raise BridgeError(answer["error"])
            source = f"ROS 1 node {answer.get('callerid', uri)}"
            sock.settimeout(None)
            while uri in self._links and not self._stopped.is_set():
                data = tcpros.receive_frame(sock, tcpros.MAX_TWIST_BYTES)
                twist = read_twist(data)
                if twist is None:
                    self._requests.refuse(f"{source}: {len(data)} bytes are no geometry_msgs/Twist")
                else:
                    self._requests.twist(twist, source)

    def _wish(self) -> dict[str, str]:
        ros_type = topics.CMD_VEL.ros_type
        return {
            "callerid": self._node.name,
            "topic": topics.CMD_VEL.name,
            "type": ros1_name(ros_type),
            "md5sum": definition(ros_type)[1],
            "tcp_nodelay": "1",
        }
