"""A ROS 1 program: it calls services, and speaks and hears on topics."""

from __future__ import annotations

import socket
import struct
from collections import defaultdict
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from agribot.ros.ros1 import tcpros
from agribot.ros.ros1.action_types import load_action_types
from agribot.ros.ros1.node import Node, Publication
from agribot.ros.ros1.service_server import SET_BOOL, TRIGGER, ServiceType
from agribot.ros.ros1.subscription import Subscription
from tests.ros.ros1_master import Master
from tests.waiting import PATIENCE_S, wait_for


class Outcome(NamedTuple):
    is_done: bool
    text: str


class ServiceError(Exception):
    """The service could not answer; its words."""


class Client:
    def __init__(self, master: Master, uri: str) -> None:
        self.master, self.node = master, Node("client", uri)
        self.types: Any = load_action_types()
        self.said: list[str] = []
        self._publications: dict[str, Publication] = {}
        self._heard: dict[str, list[Any]] = defaultdict(list)
        self._subscriptions: list[Subscription] = []

    def trigger(self, name: str) -> Outcome:
        return _read_outcome(self.call(name, TRIGGER, b""))

    def set_bool(self, name: str, *, value: bool) -> Outcome:
        return _read_outcome(self.call(name, SET_BOOL, bytes([value])))

    def connect(self, name: str, **fields: str) -> tuple[socket.socket, dict[str, str]]:
        """Shake hands with a service; its header."""
        at = urlsplit(self.master.services[name])
        sock = socket.create_connection((str(at.hostname), int(at.port or 0)), PATIENCE_S)
        wish = {"callerid": "/client", "service": name, "md5sum": "*", **fields}
        sock.sendall(tcpros.pack_header(wish))
        return sock, tcpros.read_header(tcpros.receive_frame(sock, tcpros.MAX_HEADER_BYTES))

    def call(self, name: str, kind: ServiceType, request: bytes) -> bytes:
        sock, _ = self.connect(name, md5sum=kind.md5)
        with sock:
            return ask(sock, request)

    def publish(self, topic: str, ros_type: str, message: Any) -> None:
        """Publish once the robot listens."""
        publication = self._publications.get(topic)
        if publication is None:
            publication = self.node.advertise(topic, ros_type, latched=False, depth=10)
            self._publications[topic] = publication
        wait_for(lambda: publication.listeners, f"the robot to listen to {topic}")
        publication.put(bytes(self.types.serialize_ros1(message, ros_type)))

    def hear(self, topic: str, ros_type: str) -> list[Any]:
        """All messages of a topic since the first call."""
        if topic not in self._heard:
            heard = self._heard[topic]

            def on_bytes(data: bytes, _source: str, _type: str) -> None:
                heard.append(self.types.deserialize_ros1(data, ros_type))

            made = Subscription(self.node, topic, ros_type, on_bytes, self.said.append)
            self._subscriptions.append(made)
        return self._heard[topic]

    def make(self, ros_type: str, *fields: Any) -> Any:
        return self.types.types[ros_type](*fields)

    def header(self, frame: str) -> Any:
        return self.make("std_msgs/msg/Header", 0, self.time(0, 0), frame)

    def time(self, sec: int, nanosec: int) -> Any:
        return self.make("builtin_interfaces/msg/Time", sec, nanosec)

    def pose(self, x: float, y: float, xyzw: tuple[float, float, float, float]) -> Any:
        place = self.make("geometry_msgs/msg/Point", x, y, 0.0)
        turn = self.make("geometry_msgs/msg/Quaternion", *xyzw)
        return self.make("geometry_msgs/msg/Pose", place, turn)

    def close(self) -> None:
        for subscription in self._subscriptions:
            subscription.close()
        self.node.close()


def ask(sock: socket.socket, request: bytes) -> bytes:
    """The response to one request of a client that has shaken hands.

    Raises: ServiceError: with the service's words.
    """
    sock.sendall(struct.pack("<I", len(request)) + request)
    done = sock.recv(1)
    body = tcpros.receive_frame(sock, tcpros.MAX_MESSAGE_BYTES)
    if done != b"\x01":
        raise ServiceError(body.decode())
    return body


def _read_outcome(body: bytes) -> Outcome:
    is_done, size = struct.unpack_from("<?I", body)
    assert len(body) == 5 + size
    return Outcome(is_done, body[5:].decode())
