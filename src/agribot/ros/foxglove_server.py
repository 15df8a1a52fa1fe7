"""A live view for Foxglove: it watches and cannot ask anything of the robot."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from agribot.core.errors import BridgeError
from agribot.core.extras import format_install
from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.messages.rosmsg import load_types

HOST = "127.0.0.1"


class FoxgloveGateway:
    """Serves `out` on the loopback; no capability is offered, so that a client can only listen.

    Raises: BridgeError: foxglove-sdk is not installed, or the port is taken.
    """

    def __init__(self, out: Sequence[Topic], port: int = 8765) -> None:
        try:
            import foxglove
        except ImportError as error:
            raise BridgeError(
                f"the Foxglove server needs foxglove-sdk; {format_install('foxglove')}"
            ) from error
        context = self._context = foxglove.Context()  # kept: its channels go with it
        self._lock = threading.Lock()
        self._latched: dict[str, tuple[bytes, int]] = {}
        self._channels: dict[str, Any] = {}
        self._names = {topic.name: topic.names for topic in out}
        for topic in [named for each in out for named in each.list_named()]:
            text, _ = load_types().generate_msgdef(topic.ros_type, ros_version=2)
            schema = foxglove.Schema(name=topic.ros_type, encoding="ros2msg", data=text.encode())
            self._channels[topic.name] = foxglove.Channel(
                topic.name, schema=schema, message_encoding="cdr", context=context
            )
        listener: Any = _SubscriptionListener(self._send_latched)
        try:
            self._server = foxglove.start_server(
                name="AGRIBOT",
                host=HOST,
                port=port,
                capabilities=[],
                server_listener=listener,
                context=context,
            )
        except (RuntimeError, OSError) as error:
            raise BridgeError(
                f"Foxglove: cannot serve on port {port}: {error}; choose another --foxglove-port"
            ) from error
        self.port = int(self._server.port)
        self._open = True

    def publish(self, topic: Topic, data: bytes, t_ns: int) -> None:
        if not self._open:
            return
        for name in self._names.get(topic.name, ()):
            if topic.qos.latched:
                with self._lock:
                    self._latched[name] = (data, t_ns)
            self._channels[name].log(data, log_time=t_ns)

    def step(self, _record: TickRecord) -> None:
        """Do nothing: all is in the topics."""

    def close(self) -> None:
        if self._open:
            self._open = False
            self._server.stop()

    def _send_latched(self, name: str) -> None:
        """Send the last message of a latched topic again, to all clients, for a new one."""
        with self._lock:
            kept = self._latched.get(name)
        if kept is not None:
            data, t_ns = kept
            self._channels[name].log(data, log_time=t_ns)


class _SubscriptionListener:
    def __init__(self, greet: Any) -> None:
        self._send_latched = greet

    def on_subscribe(self, _client: Any, channel: Any) -> None:
        self._send_latched(channel.topic)

    def on_unsubscribe(self, _client: Any, _channel: Any) -> None: ...
