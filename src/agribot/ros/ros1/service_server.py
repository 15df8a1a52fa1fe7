"""Services of a ROS 1 node: a TCPROS server that answers one request after the other.

Source: wiki.ros.org/ROS/TCPROS (the part on services) and wiki.ros.org/ROS/Connection Header.
"""

from __future__ import annotations

import contextlib
import hashlib
import socket
import struct
import threading
from collections.abc import Callable
from typing import NamedTuple
from urllib.parse import urlsplit

from agribot.core.errors import BridgeError
from agribot.ros.ros1 import tcpros
from agribot.ros.ros1.node import Node

_CONNECT_S = 5.0
_MOST_CLIENTS = 50
_MAX_REQUEST_BYTES = 100_000
_MOST_NAME = 200  # characters of a peer's name
_LENGTH = struct.Struct("<I")

# Gets the bytes of the request and the client; gives those of the response. Raises BridgeError.
Answer = Callable[[bytes, str], bytes]


class ServiceType(NamedTuple):
    """A service type; the texts are those of its .srv file, without comments and padding."""

    name: str
    request: str
    response: str

    @property
    def md5(self) -> str:
        """Checksum that both sides compare; right for fields of built-in types only."""
        return hashlib.md5(
            (self.request + self.response).encode(), usedforsecurity=False
        ).hexdigest()


TRIGGER = ServiceType("std_srvs/Trigger", "", "bool success\nstring message")
SET_BOOL = ServiceType("std_srvs/SetBool", "bool data", "bool success\nstring message")


class _Service(NamedTuple):
    name: str
    type: ServiceType
    answer: Answer


class Ros1ServiceServer:
    """Services of one node, behind a port of their own.

    Raises: BridgeError: the master refuses a service.
    """

    def __init__(self, node: Node, refuse: Callable[[str], None]) -> None:
        self._node, self._refuse = node, refuse
        self._services: dict[str, _Service] = {}
        self._free = threading.Semaphore(_MOST_CLIENTS)
        self._closed = False
        host = str(urlsplit(node.uri).hostname)
        self._listener = socket.create_server((host, 0))
        self._uri = f"rosrpc://{host}:{self._listener.getsockname()[1]}"
        self._clients: set[socket.socket] = set()
        threading.Thread(target=self._accept, name="ros1-services", daemon=True).start()

    def serve(self, name: str, service_type: ServiceType, answer: Answer) -> None:
        name = self._node.resolve(name)
        self._services[name] = _Service(name, service_type, answer)
        self._node.ask_master("registerService", name, self._uri, self._node.uri)

    def close(self) -> None:
        """Unregister, and close all connections. Safe to call twice."""
        if self._closed:
            return
        self._closed = True
        with contextlib.suppress(BridgeError):  # the master may be gone already
            for name in self._services:
                self._node.ask_master("unregisterService", name, self._uri)
        for sock in (self._listener, *self._clients.copy()):
            tcpros.wake(sock)
            sock.close()

    def _accept(self) -> None:
        while not self._closed:
            try:
                sock, _ = self._listener.accept()
            except OSError:
                return
            if not self._free.acquire(blocking=False):
                self._refuse(f"ROS 1: more than {_MOST_CLIENTS} clients of services at once")
                sock.close()
                continue
            threading.Thread(target=self._serve_client, args=(sock,), daemon=True).start()

    def _serve_client(self, sock: socket.socket) -> None:
        self._clients.add(sock)
        try:
            with contextlib.suppress(OSError, BridgeError), sock:
                self._talk(sock)
        finally:
            self._clients.discard(sock)
            self._free.release()

    def _talk(self, sock: socket.socket) -> None:
        """Shake hands, then answer one request, or all of a persistent client."""
        sock.settimeout(_CONNECT_S)
        wish = tcpros.read_header(tcpros.receive_frame(sock, tcpros.MAX_HEADER_BYTES))
        service = self._services.get(wish.get("service", ""))
        refusal = _find_refusal(service, wish)
        if service is None or refusal:
            sock.sendall(tcpros.pack_header({"error": refusal}))
            return
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.sendall(tcpros.pack_header(self._make_header(service)))
        if wish.get("probe") == "1":
            return
        is_persistent = wish.get("persistent") in {"1", "true"}
        if is_persistent:
            sock.settimeout(None)
        source = f"ROS 1 node {wish.get('callerid', 'without a name')[:_MOST_NAME]}"
        while not self._closed:
            request = tcpros.receive_frame(sock, _MAX_REQUEST_BYTES)
            sock.sendall(self._make_response(service, request, source))
            if not is_persistent:
                return

    def _make_response(self, service: _Service, request: bytes, source: str) -> bytes:
        """Make the byte that says whether it worked, and the response or the error."""
        try:
            done, body = 1, service.answer(request, source)
        except BridgeError as error:
            self._refuse(f"{source}: {service.name}: {error}")
            done, body = 0, str(error).encode()
        return bytes([done]) + _LENGTH.pack(len(body)) + body

    def _make_header(self, service: _Service) -> dict[str, str]:
        name = service.type.name
        return {
            "callerid": self._node.name,
            "md5sum": service.type.md5,
            "service": service.name,
            "type": name,
            "request_type": f"{name}Request",
            "response_type": f"{name}Response",
        }


def _find_refusal(service: _Service | None, wish: dict[str, str]) -> str:
    if service is None:
        return f"no such service: {wish.get('service', '')}"
    if wish.get("md5sum", "*") not in {"*", service.type.md5}:
        return f"{service.name} has md5 sum {service.type.md5}, not {wish['md5sum']}"
    return ""
