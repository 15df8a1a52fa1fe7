"""What a browser's page does, in a few lines: a WebSocket with an origin, kinds to wait for."""

from __future__ import annotations

import itertools
import json
import time
from contextlib import ExitStack
from typing import Any, Self, TypeVar
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import msgspec
from websockets.sync.client import ClientConnection, connect

from agribot.ui import wire
from tests.waiting import PATIENCE_S

M = TypeVar("M", bound=wire.Message)


class Never(wire.Message, frozen=True):
    """A kind that is never sent: a test that waits for it waits for the end of the line."""


class Page:
    def __init__(self, port: int, tab: str = "one", **options: Any) -> None:
        headers = options.setdefault("additional_headers", {})
        options.setdefault("max_queue", None)  # a test that does not read shall not stall
        options.setdefault("close_timeout", 1)
        origin = options.pop("origin", f"http://127.0.0.1:{port}")
        if origin is not None:
            headers["Origin"] = origin
        path = options.pop("path", f"/ws/v1?tab={tab}")
        url = f"ws://127.0.0.1:{port}{path}"
        self._connect: Any = lambda: connect(url, compression=None, proxy=None, **options)
        self._stack = ExitStack()
        self._numbers = itertools.count(1)
        self.line: ClientConnection

    def __enter__(self) -> Self:
        self.line = self._stack.enter_context(self._connect())
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def send(self, message: wire.PageMessage) -> None:
        self.send_text(wire.encode(message).decode())

    def send_text(self, text: str) -> None:
        """Whatever it says."""
        self.line.send(text)

    def receive(self, kind: type[M], timeout_s: float = PATIENCE_S) -> M:
        """The next message of this kind."""
        end_s = time.monotonic() + timeout_s
        while True:
            message = self.receive_any(max(0.0, end_s - time.monotonic()))
            if isinstance(message, kind):
                return message

    def receive_any(self, timeout_s: float = PATIENCE_S) -> wire.ServerMessage:
        """The next message of whatever kind."""
        return wire.read_server_message(self.line.recv(timeout=timeout_s))

    def ask(self, request: wire.PageRequest) -> wire.Verdict:
        """Send a request and wait for the verdict on it."""
        id = request.id or f"ask-{next(self._numbers)}"
        self.send(msgspec.structs.replace(request, id=id))
        while True:
            verdict = self.receive(wire.Verdict)
            if verdict.id == id:
                return verdict

    def take_seat(self) -> None:
        verdict = self.ask(wire.TakeSeat(force=True))
        assert verdict.ok, verdict


class Browser:
    """A page's other requests, with its cookie."""

    def __init__(self, port: int) -> None:
        self.port = port
        with urlopen(f"http://127.0.0.1:{port}/") as answer:
            self.cookie: str = answer.headers["set-cookie"].split(";")[0]

    def ask(
        self, method: str, path: str, body: object = None, language: str = "en"
    ) -> tuple[int, Any]:
        """Status and answer, as JSON where it is JSON; bytes are sent as they are."""
        data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        headers = {
            "Cookie": self.cookie, "Origin": f"http://127.0.0.1:{self.port}",
            "Accept-Language": language,
        }  # fmt: skip
        url = f"http://127.0.0.1:{self.port}{path}"
        try:
            with urlopen(Request(url, data, headers, method=method)) as answer:
                return answer.status, _content(answer)
        except HTTPError as error:
            with error:
                return error.code, _content(error)


def _content(answer: Any) -> Any:
    data = answer.read()
    is_json = "json" in answer.headers.get("content-type", "")
    return json.loads(data) if is_json and data else data
