"""The body of a request: read whole, within a size and a time, before anything looks at it."""

from __future__ import annotations

import asyncio
import re
from typing import NamedTuple

from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from agribot.ui.server.answers import refuse_request

START_S = 10.0  # time for a body of no size
SLOWEST_BYTES_PER_S = 4000.0  # a field file over a bad line
LARGE_BYTES = 100_000
MAX_LARGE = 4  # limit of large bodies at a time: memory
MAX_COMMAND_BYTES = 16_000
# Limits by path, first match first; all other paths are commands.
LIMITS: tuple[tuple[str, int], ...] = (
    (r"/api/v1/login", 2_000),
    (r"/api/v1/fields/import", 20_000_000),  # files of a large farm
    (r"/api/v1/fields/.*|/api/v1/plan(/apply)?", 8_000_000),  # 200,000 corners
    (r"/api/v1/views/import", 64_000),  # a configuration of mapviz with 200 displays
    (r"/api/v1/views/.*", 500_000),
    (r"/api/v1/panels/.*", 500_000),
    (r"/api/v1/layers(/.*)?", 2_100_000),
)


class _Refusal(NamedTuple):
    status: int
    reason: str


class RequestBodies:
    """Large bodies are taken from operators alone."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._large = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not _has_body(headers := Headers(scope=scope)):
            await self._app(scope, receive, send)
            return
        limit = limit_bytes(scope["path"], scope["agribot.caller"].role)
        length = headers.get("content-length", "0")
        if not length.isascii() or not length.isdigit() or len(length) > 15:
            await refuse_request(400, "the content-length is no number")(scope, receive, send)
            return
        if int(length) > limit:
            await _too_large(limit)(scope, receive, send)
            return
        body = await self._read(receive, limit)
        if isinstance(body, _Refusal):
            answer = refuse_request(body.status, body.reason)
            answer.headers["connection"] = "close"
            await answer(scope, receive, send)
            return
        await self._app(scope, _replay(body, receive), send)

    async def _read(self, receive: Receive, limit: int) -> bytes | _Refusal:
        data, is_large = bytearray(), False
        begin_s = asyncio.get_running_loop().time()
        try:
            while True:
                deadline_s = begin_s + START_S + len(data) / SLOWEST_BYTES_PER_S
                async with asyncio.timeout_at(deadline_s):
                    message = await receive()
                if message["type"] == "http.disconnect":
                    return _Refusal(400, "the connection broke off")
                data += message.get("body", b"")
                if len(data) > limit:
                    return _Refusal(413, _too_large_text(limit))
                if len(data) > LARGE_BYTES and not is_large:
                    if self._large >= MAX_LARGE:
                        return _Refusal(503, f"{MAX_LARGE} large files arrive already; try again")
                    is_large = True
                    self._large += 1
                if not message.get("more_body", False):
                    return bytes(data)
        except TimeoutError:
            return _Refusal(408, f"the rest of the request did not come; {len(data)} bytes did")
        finally:
            self._large -= is_large


def limit_bytes(path: str, role: str | None) -> int:
    """Return the largest body that makes sense for a path."""
    found = next((size for pattern, size in LIMITS if re.fullmatch(pattern, path)), None)
    limit = MAX_COMMAND_BYTES if found is None else found
    return limit if role == "operator" else min(limit, MAX_COMMAND_BYTES)


def _has_body(headers: Headers) -> bool:
    return "transfer-encoding" in headers or headers.get("content-length", "0") != "0"


def _too_large_text(limit: int) -> str:
    return f"larger than {limit // 1000} kB, the most that is taken here"


def _too_large(limit: int) -> Response:
    return refuse_request(413, _too_large_text(limit))


def _replay(body: bytes, receive: Receive) -> Receive:
    """Receive what was read once more; after it the connection itself is asked."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive_again() -> Message:
        return waiting.pop() if waiting else await receive()

    return receive_again
