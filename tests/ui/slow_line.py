"""A line between a page and its server that a test can hold."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from typing import Self

CHUNK_BYTES = 1024


class SlowLine:
    """Forwards TCP to a port of this machine; what is held is kept, never lost."""

    def __init__(self, to_port: int) -> None:
        self._to_port = to_port
        self._flows = threading.Event()
        self._flows.set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._lines: list[socket.socket] = []
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self._start(self._accept)
        return self

    def __exit__(self, *_: object) -> None:
        self._flows.set()
        _end(self._listener)
        self._threads[0].join()
        for line in self._lines:
            _end(line)
        for thread in self._threads[1:]:
            thread.join()
        for line in [self._listener, *self._lines]:
            line.close()

    def connected(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port))

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Nothing passes either way, and neither end is notified."""
        self._flows.clear()
        yield
        self._flows.set()

    def _start(self, work: object, *arguments: object) -> None:
        thread = threading.Thread(target=work, args=arguments, daemon=True)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                page, _ = self._listener.accept()
                server = socket.create_connection(("127.0.0.1", self._to_port))
                self._lines += [page, server]
                self._start(self._forward, page, server)
                self._start(self._forward, server, page)

    def _forward(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(CHUNK_BYTES):
                self._flows.wait()
                sink.sendall(data)
        _end(sink)


def _end(line: socket.socket) -> None:
    with contextlib.suppress(OSError):
        line.shutdown(socket.SHUT_RDWR)
