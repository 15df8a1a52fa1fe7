"""A node of a ROS 1 master: registration, the slave API and the TCPROS server behind it."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import threading
import xmlrpc.client
from collections.abc import Callable
from socketserver import ThreadingMixIn
from typing import Any
from urllib.parse import urlsplit
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

from rosbags.typesys.store import Typestore

from agribot.core.errors import BridgeError
from agribot.ros.ros1 import tcpros
from agribot.ros.ros1.types import generate_definition, to_ros1_name

_OK = 1
_CONNECT_S = 5.0
_ALIVE_S = 2.0  # time in which a node of the same name must take a connection


class Publication:
    """A published topic and its subscribers."""

    def __init__(
        self,
        name: str,
        ros_type: str,
        *,
        latched: bool,
        depth: int,
        types: Typestore | None = None,
    ) -> None:
        self.name, self.ros_type, self.latched, self.depth = name, ros_type, latched, depth
        self.text, self.md5 = generate_definition(ros_type, types)
        self._lock = threading.Lock()
        self._subscribers: list[tcpros.Subscriber] = []
        self._last: bytes | None = None

    @property
    def listeners(self) -> int:
        return sum(subscriber.is_alive for subscriber in self._subscribers)

    @property
    def is_wanted(self) -> bool:
        """Whether a message is needed: a latched topic keeps its last one for new subscribers."""
        return self.latched or bool(self._subscribers)

    def put(self, message: bytes) -> None:
        with self._lock:
            self._last = message
            self._subscribers = [s for s in self._subscribers if s.is_alive]
            for subscriber in self._subscribers:
                subscriber.put(message)

    def add(self, sock: socket.socket) -> None:
        subscriber = tcpros.Subscriber(sock, self.depth)
        with self._lock:
            if self.latched and self._last is not None:
                subscriber.put(self._last)
            self._subscribers.append(subscriber)

    def close(self) -> None:
        with self._lock:
            for subscriber in self._subscribers:
                subscriber.close()


class _Handler(SimpleXMLRPCRequestHandler):
    rpc_paths = ()  # any path, as ROS does


class _Server(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True


class Node:
    """A node registered at a master; in a `namespace` all of its names lie under it.

    A master ends a node when another one takes its name. So a name that is in use is refused, or
    with `may_rename` gets a number.

    Raises: BridgeError: the master does not answer or refuses, or the name is in use.
    """

    def __init__(
        self,
        name: str,
        master_uri: str,
        host: str = "127.0.0.1",
        *,
        namespace: str = "",
        may_rename: bool = False,
    ) -> None:
        self._namespace = namespace
        self.name, self.master_uri, self._host = self.resolve(f"/{name}"), master_uri, host
        self._master = xmlrpc.client.ServerProxy(master_uri)
        self._lock = threading.Lock()
        self._publications: dict[str, Publication] = {}
        self._on_publishers: dict[str, Callable[[str, list[str]], None]] = {}
        self._on_params: dict[str, Callable[[Any], None]] = {}
        self._closed = False
        self._listener = socket.create_server((host, 0))
        self._slave = _Server((host, 0), requestHandler=_Handler, logRequests=False)
        self.uri = f"http://{host}:{self._slave.server_address[1]}/"
        try:
            self.ask_master("getPid")
            self.name = self._find_free_name(may_rename=may_rename)
        except BridgeError:
            self._master("close")()
            self._slave.server_close()
            self._listener.close()
            raise
        methods: list[Callable[..., Any]] = [
            self._request_topic,
            self._publisher_update,
            self._get_publications,
            self._param_update,
        ]
        for method in methods:
            self._slave.register_function(method, _to_camel_case(method.__name__))
        self._slave.register_function(lambda _caller: (_OK, "", os.getpid()), "getPid")
        self._slave.register_function(lambda _caller: (_OK, "", []), "getBusInfo")
        self._slave.register_function(lambda _caller: (_OK, "", master_uri), "getMasterUri")
        for work in (self._slave.serve_forever, self._accept):
            threading.Thread(target=work, name="ros1", daemon=True).start()

    def advertise(
        self,
        name: str,
        ros_type: str,
        *,
        latched: bool,
        depth: int,
        types: Typestore | None = None,
    ) -> Publication:
        """Publish a topic; `types` has its type where the default types have not."""
        name = self.resolve(name)
        publication = Publication(name, ros_type, latched=latched, depth=depth, types=types)
        self._publications[name] = publication
        self.ask_master("registerPublisher", name, to_ros1_name(ros_type), self.uri)
        return publication

    def subscribe(self, name: str, ros_type: str, update: Callable[[str, list[str]], None]) -> None:
        """Call `update` with the topic and its publishers' slave URIs, now and at each change."""
        name = self.resolve(name)
        self._on_publishers[name] = update
        update(name, self.ask_master("registerSubscriber", name, to_ros1_name(ros_type), self.uri))

    def unsubscribe(self, name: str) -> None:
        """Leave a topic; a master that is gone needs no word."""
        name = self.resolve(name)
        if self._on_publishers.pop(name, None) is not None:
            with contextlib.suppress(BridgeError):
                self.ask_master("unregisterSubscriber", name, self.uri)

    def resolve(self, name: str) -> str:
        """Return a name as the master knows it: under the namespace, if there is one."""
        return f"/{self._namespace}{name}" if self._namespace else name

    def _find_free_name(self, *, may_rename: bool) -> str:
        for number in itertools.count(1):
            name = self.name if number == 1 else f"{self.name}_{number}"
            uri = self._find_node(name)
            if uri is None:
                return name
            if not may_rename:
                raise BridgeError(
                    f"ROS 1: a node {name} is at the master already ({uri}); give this one a "
                    "--ros-namespace of its own, or stop the other"
                )
        raise AssertionError("there is always a next number")

    def _find_node(self, name: str) -> str | None:
        """Find the address of a node that answers; None of a name that is free or was left."""
        code, _, uri = self._call_master("lookupNode", name)
        parts = urlsplit(str(uri))
        if code != _OK or parts.hostname is None:
            return None
        try:
            socket.create_connection((parts.hostname, parts.port or 80), _ALIVE_S).close()
        except OSError:
            return None
        return str(uri)

    def set_param(self, name: str, value: Any) -> None:
        self.ask_master("setParam", self.resolve(name), value)

    def subscribe_param(self, name: str, on_update: Callable[[Any], None]) -> None:
        """Call `on_update` with the new value at each change of a parameter, in another thread."""
        name = self.resolve(name)
        self._on_params[name] = on_update
        self.ask_master("subscribeParam", self.uri, name)

    def ask_master(self, method: str, *arguments: Any) -> Any:
        code, text, value = self._call_master(method, *arguments)
        if code != _OK:
            raise BridgeError(f"ROS 1: the master refuses {method}: {text}; restart roscore")
        return value

    def _call_master(self, method: str, *arguments: Any) -> tuple[int, str, Any]:
        try:
            with self._lock:
                code, text, value = getattr(self._master, method)(self.name, *arguments)
        except (OSError, xmlrpc.client.Error) as error:
            raise BridgeError(
                f"ROS 1: no master answers at {self.master_uri}: {error}; start roscore, or set "
                "--ros-master or ROS_MASTER_URI"
            ) from error
        return code, text, value

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        with contextlib.suppress(BridgeError):  # the master may be gone already
            for name in self._publications:
                self.ask_master("unregisterPublisher", name, self.uri)
            for name in self._on_publishers:
                self.ask_master("unregisterSubscriber", name, self.uri)
            for name in self._on_params:
                self.ask_master("unsubscribeParam", self.uri, name)
        self._master("close")()
        self._slave.shutdown()
        self._slave.server_close()
        tcpros.wake(self._listener)
        self._listener.close()
        for publication in self._publications.values():
            publication.close()

    def _request_topic(self, _caller: str, topic: str, protocols: list[list[Any]]) -> Any:
        if topic not in self._publications:
            return 0, f"{self.name} does not publish {topic}", 0
        if not any(protocol and protocol[0] == "TCPROS" for protocol in protocols):
            return 0, "only TCPROS is spoken here", 0
        return _OK, "", ["TCPROS", self._host, self._listener.getsockname()[1]]

    def _publisher_update(self, _caller: str, topic: str, uris: list[str]) -> Any:
        if topic in self._on_publishers:
            self._on_publishers[topic](topic, uris)
        return _OK, "", 0

    def _param_update(self, _caller: str, name: str, value: Any) -> Any:
        """Pass a parameter on; the master waits for the answer, so another thread works on it."""
        on_update = self._on_params.get(name.rstrip("/"))
        if on_update is not None:
            threading.Thread(target=on_update, args=(value,), daemon=True).start()
        return _OK, "", 0

    def _get_publications(self, _caller: str) -> Any:
        return _OK, "", [[p.name, to_ros1_name(p.ros_type)] for p in self._publications.values()]

    def _accept(self) -> None:
        while not self._closed:
            try:
                sock, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._accept_subscriber, args=(sock,), daemon=True).start()

    def _accept_subscriber(self, sock: socket.socket) -> None:
        try:
            sock.settimeout(_CONNECT_S)
            request = tcpros.read_header(tcpros.receive_frame(sock, tcpros.MAX_HEADER_BYTES))
            publication = self._publications.get(request.get("topic", ""))
            refusal = _find_refusal(publication, request)
            if publication is None or refusal:
                sock.sendall(tcpros.pack_header({"error": refusal}))
                sock.close()
                return
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.sendall(tcpros.pack_header(self._make_header(publication)))
            sock.settimeout(None)
        except (OSError, BridgeError):
            sock.close()
            return
        publication.add(sock)

    def _make_header(self, publication: Publication) -> dict[str, str]:
        return {
            "callerid": self.name,
            "latching": str(int(publication.latched)),
            "md5sum": publication.md5,
            "message_definition": publication.text,
            "topic": publication.name,
            "type": to_ros1_name(publication.ros_type),
        }


def _find_refusal(publication: Publication | None, request: dict[str, str]) -> str:
    if publication is None:
        return f"no such topic: {request.get('topic', '')}"
    if request.get("md5sum", "*") not in {"*", publication.md5}:
        return f"{publication.name} has md5 sum {publication.md5}, not {request['md5sum']}"
    return ""


def _to_camel_case(name: str) -> str:
    first, *others = name.strip("_").split("_")
    return first + "".join(word.title() for word in others)
