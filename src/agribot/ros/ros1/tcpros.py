"""TCPROS: length-prefixed frames over TCP, the first one a header of key=value fields.

Source: wiki.ros.org/ROS/TCPROS and wiki.ros.org/ROS/Connection Header.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections import deque
from collections.abc import Mapping

from agribot.core.errors import BridgeError

MAX_HEADER_BYTES = 1_000_000
MAX_MESSAGE_BYTES = 1_000_000  # size above all commands
MAX_SENSOR_BYTES = 64_000_000  # size above all images
_LENGTH = struct.Struct("<I")


def pack_header(fields: Mapping[str, str]) -> bytes:
    lines = [f"{key}={value}".encode() for key, value in fields.items()]
    body = b"".join(_LENGTH.pack(len(line)) + line for line in lines)
    return _LENGTH.pack(len(body)) + body


def read_header(body: bytes) -> dict[str, str]:
    """Read the fields of a header.

    Raises: BridgeError: the lengths inside do not add up.
    """
    fields, at = {}, 0
    while at < len(body):
        if at + 4 > len(body):
            raise BridgeError(
                "a ROS 1 connection header ends in the middle of a length; connect anew"
            )
        (size,) = _LENGTH.unpack_from(body, at)
        line = body[at + 4 : at + 4 + size]
        if len(line) < size:
            raise BridgeError(
                f"a field of a ROS 1 connection header claims {size} bytes; connect anew"
            )
        key, _, value = line.partition(b"=")
        fields[key.decode("utf-8", "replace")] = value.decode("utf-8", "replace")
        at += 4 + size
    return fields


def receive_frame(sock: socket.socket, limit: int) -> bytes:
    """Receive one frame without its length.

    Raises: BridgeError: longer than `limit`; OSError: the peer closed the connection.
    """
    (size,) = _LENGTH.unpack(_receive_exactly(sock, 4))
    if size > limit:
        raise BridgeError(f"a ROS 1 peer announces {size} bytes; at most {limit} are read")
    return _receive_exactly(sock, size)


def wake(sock: socket.socket) -> None:
    """Shut a socket down, so that a thread that waits on it goes on; it may be closed already."""
    with contextlib.suppress(OSError):
        sock.shutdown(socket.SHUT_RDWR)


def _receive_exactly(sock: socket.socket, size: int) -> bytes:
    received = bytearray()
    while len(received) < size:
        part = sock.recv(min(65536, size - len(received)))
        if not part:
            raise ConnectionError("the peer closed the connection in the middle of a message")
        received += part
    return bytes(received)


class Subscriber:
    """A subscribed peer with its own queue and thread; a slow one loses its oldest messages."""

    def __init__(self, sock: socket.socket, depth: int) -> None:
        self._sock = sock
        self._queue: deque[bytes] = deque(maxlen=depth)
        self._wake = threading.Event()
        self.is_alive = True
        threading.Thread(target=self._send, name="tcpros-send", daemon=True).start()

    def put(self, message: bytes) -> None:
        self._queue.append(_LENGTH.pack(len(message)) + message)
        self._wake.set()

    def close(self) -> None:
        self.is_alive = False
        self._wake.set()
        self._sock.close()

    def _send(self) -> None:
        try:
            while self.is_alive:
                self._wake.wait()
                self._wake.clear()
                while self._queue:
                    self._sock.sendall(self._queue.popleft())
        except OSError:
            pass  # it went away; others listen on
        self.is_alive = False
        self._sock.close()
