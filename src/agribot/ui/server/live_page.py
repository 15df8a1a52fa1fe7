"""The page of `agribot live --show`: one moving picture, for browsers of this machine.

It needs no package beside Python's own: a program that looks through a camera has no robot.
"""

from __future__ import annotations

import contextlib
import secrets
import socket
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from agribot.ui.address import Address, bound
from agribot.ui.server.access import Access, Refusal

MOST_VIEWERS = 8
VIEWER_TIMEOUT_S = 10.0  # time for a viewer that takes no more bytes
LAST_PICTURE_S = 1.0  # time for the last picture, before the program ends
BOUNDARY = "agribot-frame"
HEADERS = {
    "cache-control": "no-store",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "content-security-policy": "default-src 'none'; img-src 'self'; style-src 'unsafe-inline'; "
    "frame-ancestors 'none'",
}
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>AGRIBOT live</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>body{margin:0;background:#111;color:#eee;font:16px system-ui,sans-serif}
img{display:block;margin:auto;width:100vw;height:100vh;object-fit:contain}</style>
<img src="/stream.mjpg" alt="the camera's picture: weeds red, crops green; frames per second and
latency below it"></html>"""


class LivePage:
    """A server in threads of its own; `show` replaces the picture that everybody sees.

    Raises: ConfigError: the port is taken.
    """

    def __init__(self, port: int | None = None) -> None:
        listener = bound(Address(port=port))
        self.port: int = listener.getsockname()[1]
        self._newest = _NewestPicture()
        self._server = _Server(listener, self._newest, _make_access(self.port))
        self._thread = threading.Thread(
            target=self._server.serve_forever, name="live page", daemon=True
        )
        self._thread.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    @property
    def viewers(self) -> int:
        """Count the browsers that follow the moving picture now."""
        return self._server.viewers

    def show(self, jpeg: bytes) -> None:
        self._newest.put(jpeg)

    def close(self, last_jpeg: bytes = b"") -> None:
        """End the server; who looks on sees `last_jpeg` from then on. Safe to call twice."""
        if not self._thread.is_alive():
            return
        if last_jpeg:
            self.show(last_jpeg)
        self._newest.end()
        self._server.wait_until_empty()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


class _NewestPicture:
    """The newest picture, with its number from 1 on; a slow viewer leaves some out."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._jpeg, self._number, self._has_ended = b"", 0, False

    def put(self, jpeg: bytes) -> None:
        with self._changed:
            self._jpeg, self._number = jpeg, self._number + 1
            self._changed.notify_all()

    def end(self) -> None:
        with self._changed:
            self._has_ended = True
            self._changed.notify_all()

    def wait(self, after: int) -> tuple[bytes, int] | None:
        """Wait for a picture later than number `after`; None when there will be no more."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > after or self._has_ended)
            return (self._jpeg, self._number) if self._number > after else None


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False  # a viewer that takes no bytes must not keep the program

    def __init__(self, listener: socket.socket, newest: _NewestPicture, access: Access) -> None:
        address = listener.getsockname()[:2]
        super().__init__(address, _Viewer, bind_and_activate=False)
        self.socket.close()
        self.socket = listener
        self.newest, self.access, self.viewers = newest, access, 0
        self._changed = threading.Condition()

    def seat(self, change: int) -> bool:
        """Count a viewer in (1) or out (-1); False where all places are taken."""
        with self._changed:
            if self.viewers + change > MOST_VIEWERS:
                return False
            self.viewers += change
            self._changed.notify_all()
            return True

    def wait_until_empty(self) -> None:
        """Let those who look on see the last picture, unless one of them takes no bytes."""
        with self._changed:
            self._changed.wait_for(lambda: not self.viewers, LAST_PICTURE_S)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Keep quiet: a browser that leaves is no fault."""


class _Viewer(BaseHTTPRequestHandler):
    server: _Server
    timeout = VIEWER_TIMEOUT_S

    def do_GET(self) -> None:
        headers = {name.lower(): value for name, value in self.headers.items()}
        verdict = self.server.access.check("http", "GET", self.path, headers)
        answers: dict[str, Callable[[], None]] = {
            "/": lambda: self._answer(200, "text/html; charset=utf-8", PAGE.encode()),
            "/stream.mjpg": self._stream,
            "/latest.jpg": self._send_latest,
        }
        if isinstance(verdict, Refusal):
            self._refuse(verdict.status, verdict.reason)
        elif self.path not in answers:
            self._refuse(404, f"nothing is here; there are {', '.join(answers)}")
        else:
            with contextlib.suppress(OSError):  # the viewer has left
                answers[self.path]()

    def log_message(self, format: str, *args: Any) -> None:
        """Keep the terminal for the network's lines."""

    def _send_latest(self) -> None:
        found = self.server.newest.wait(0)
        if found is None:
            self._refuse(503, "no picture has come; look at the terminal of agribot live")
        else:
            self._answer(200, "image/jpeg", found[0])

    def _stream(self) -> None:
        if not self.server.seat(1):
            self._refuse(503, f"{MOST_VIEWERS} browsers look on already; close one of them")
            return
        try:
            self._begin(200, f"multipart/x-mixed-replace; boundary={BOUNDARY}")
            number = 0
            while (found := self.server.newest.wait(number)) is not None:
                jpeg, number = found
                head = f"content-type: image/jpeg\r\ncontent-length: {len(jpeg)}\r\n\r\n"
                self.wfile.write(f"--{BOUNDARY}\r\n{head}".encode() + jpeg + b"\r\n")
        finally:
            self.server.seat(-1)

    def _refuse(self, status: int, reason: str) -> None:
        self._answer(status, "text/plain; charset=utf-8", f"{reason}\n".encode())

    def _answer(self, status: int, media_type: str, body: bytes) -> None:
        self._begin(status, media_type, {"content-length": str(len(body))})
        self.wfile.write(body)

    def _begin(self, status: int, media_type: str, more: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in {"content-type": media_type, **HEADERS, **(more or {})}.items():
            self.send_header(name, value)
        self.end_headers()


def _make_access(port: int) -> Access:
    token, watch, key = (secrets.token_hex() for _ in range(3))
    return Access((), port, token, watch, key, is_local=True)
