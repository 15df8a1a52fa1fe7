"""A ROS 1 master in this process, for machines without one: names, and where to find them."""

from __future__ import annotations

import contextlib
import threading
import xmlrpc.client
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

FOUND, MISSING = 1, -1


class Master:
    """Answers as rosmaster does; subscribers get new publishers at once."""

    def __init__(self) -> None:
        self.publishers: dict[str, list[str]] = defaultdict(list)
        self.subscribers: dict[str, list[str]] = defaultdict(list)
        self.services: dict[str, str] = {}
        self.parameters: dict[str, Any] = {}
        self.nodes: dict[str, str] = {}
        self.watchers: dict[str, list[str]] = defaultdict(list)

    def getPid(self, _caller: str) -> Any:
        return FOUND, "", 1

    def lookupNode(self, _caller: str, name: str) -> Any:
        if name not in self.nodes:
            return MISSING, f"unknown node [{name}]", ""
        return FOUND, "", self.nodes[name]

    def setParam(self, _caller: str, name: str, value: Any) -> Any:
        self.parameters[name] = value
        for uri in self.watchers[name]:
            _send(uri, "paramUpdate", "/master", name, value)
        return FOUND, "", 0

    def subscribeParam(self, _caller: str, uri: str, name: str) -> Any:
        self.watchers[name].append(uri)
        return FOUND, "", self.parameters.get(name, {})

    def getParam(self, _caller: str, name: str) -> Any:
        if name not in self.parameters:
            return MISSING, f"Parameter [{name}] is not set", 0
        return FOUND, "", self.parameters[name]

    def registerPublisher(self, caller: str, name: str, _type: str, uri: str) -> Any:
        self.nodes[caller] = uri
        self.publishers[name].append(uri)
        self._tell(name)
        return FOUND, "", self.subscribers[name]

    def unregisterPublisher(self, _caller: str, name: str, uri: str) -> Any:
        self.publishers[name].remove(uri)
        self._tell(name)
        return FOUND, "", 1

    def registerSubscriber(self, caller: str, name: str, _type: str, uri: str) -> Any:
        self.nodes[caller] = uri
        self.subscribers[name].append(uri)
        return FOUND, "", self.publishers[name]

    def unregisterSubscriber(self, _caller: str, name: str, uri: str) -> Any:
        self.subscribers[name].remove(uri)
        return FOUND, "", 1

    def registerService(self, caller: str, name: str, at: str, uri: str) -> Any:
        self.nodes[caller] = uri
        self.services[name] = at
        return FOUND, "", 1

    def unregisterService(self, _caller: str, name: str, _at: str) -> Any:
        return FOUND, "", int(self.services.pop(name, None) is not None)

    def _tell(self, name: str) -> None:
        for uri in self.subscribers[name]:
            _send(uri, "publisherUpdate", "/master", name, list(self.publishers[name]))


def _send(uri: str, method: str, *arguments: Any) -> None:
    """Call a method of a node, in a thread: the node may be the caller that waits."""
    threading.Thread(target=_call, args=(uri, method, arguments), daemon=True).start()


def _call(uri: str, method: str, arguments: tuple[Any, ...]) -> None:
    with contextlib.suppress(OSError), xmlrpc.client.ServerProxy(uri) as proxy:  # it has ended
        getattr(proxy, method)(*arguments)


@contextmanager
def master() -> Iterator[tuple[Master, str]]:
    """The master and its URI."""
    made = Master()
    server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    server.register_instance(made)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield made, f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
