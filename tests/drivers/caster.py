"""Casters of corrections: a made-up one that misbehaves on request, and a base station's bytes."""

from __future__ import annotations

import socket
import ssl
import threading
from collections.abc import Callable, Iterable, Sequence

from agribot.core.geo import ecef_from_geodetic
from agribot.drivers.gnss import rtcm
from tests.drivers.receiver_bytes import ALT_M, LAT_DEG, LON_DEG

# RTCM 10403.3, the example of message 1005: it stands near Washington.
EXAMPLE = bytes.fromhex("d300133ed7d30202980edeef34b4bd62ac0941986f33360b98")


def make_station(ecef_m: Iterable[float], *, is_virtual: bool = False) -> bytes:
    """Write message 1005 of a base there."""
    bits = int.from_bytes(EXAMPLE[3:-3]) | is_virtual << 152 - 34
    for at, value in zip((34, 74, 114), ecef_m, strict=True):
        shift = 152 - 38 - at
        bits = bits & ~(((1 << 38) - 1) << shift) | (round(value * 1e4) % (1 << 38)) << shift
    return rtcm.make_message(bits.to_bytes(19))


# Four kilometres from the receivers of these tests.
STATION = make_station(ecef_from_geodetic(LAT_DEG + 0.03, LON_DEG - 0.03, ALT_M))
Serve = Callable[[socket.socket, bytes], None]
YES = b"HTTP/1.1 200 OK\r\nNtrip-Version: Ntrip/2.0\r\nContent-Type: gnss/data\r\n"
TABLE = b"STR;FARM;Farm;RTCM 3.3;\r\nSTR;FARMVRS;Farm;RTCM 3.3;\r\nENDSOURCETABLE\r\n"


def make_observation(kind: int = 1077, length: int = 180) -> bytes:
    """Write a message of that number with any content."""
    return rtcm.make_message(bytes((kind >> 4, (kind & 0xF) << 4)) + b"\x5a" * (length - 2))


def make_empty_observation(kind: int = 1074) -> bytes:
    """Write a message of that number of a base that hears no satellite."""
    return rtcm.make_message(bytes((kind >> 4, (kind & 0xF) << 4)) + bytes(20))


def chunk(data: bytes) -> bytes:
    return f"{len(data):X};made=up\r\n".encode() + data + b"\r\n"


class FakeCaster:
    """Serves each connection as the next of `answers` does, and all further ones as the last.

    An answer gets the socket and the request's head, and the line is closed when it returns.
    """

    def __init__(self, *answers: Serve, tls: ssl.SSLContext | None = None) -> None:
        self._answers: Sequence[Serve] = answers
        self._tls = tls
        self.requests: list[bytes] = []
        self.heard = bytearray()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self.ended = threading.Event()
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        self.ended.set()
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()

    def listen(self, peer: socket.socket) -> None:
        """Keep what the rover says until it goes or the caster ends."""
        peer.settimeout(0.05)
        while not self.ended.is_set():
            try:
                data = peer.recv(4096)
            except TimeoutError:
                continue
            if not data:
                return
            self.heard += data

    def _accept(self) -> None:
        while not self.ended.is_set():
            try:
                peer, _ = self._server.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(peer,), daemon=True).start()

    def _serve(self, plain: socket.socket) -> None:
        try:
            peer = self._tls.wrap_socket(plain, server_side=True) if self._tls else plain
        except OSError:  # no handshake, or a rover that does not believe
            plain.close()
            return
        with peer:
            head = b""
            while b"\r\n\r\n" not in head:
                data = peer.recv(4096)
                if not data:
                    return
                head += data
            answer = self._answers[min(len(self.requests), len(self._answers) - 1)]
            self.requests.append(head)
            try:
                answer(peer, head)
            except OSError:  # the rover is gone
                return
