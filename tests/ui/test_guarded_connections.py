"""Deadlines of connections, in a server of this process with the times made short."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.types import Message, Scope
from starlette.websockets import WebSocket

from agribot.ui.server import guarded_connections, request_bodies
from agribot.ui.server.access import Caller
from agribot.ui.server.connection_slots import ConnectionSlots, Slot
from agribot.ui.server.guarded_connections import GuardedHttp, GuardedSocket
from agribot.ui.server.request_bodies import RequestBodies, limit_bytes
from tests.ui.client import Page
from tests.waiting import PATIENCE_S, wait_for

FLOOD = b"x" * 4_000_000
RECEIVE_BYTES = 64 * 1024
HURRY_S = 0.1


def hurry(request: Request) -> None:
    """A test may ask for a short time, which does not count for its own request any more."""
    if "hurry" in request.query_params:
        guarded_connections.HEAD_S = HURRY_S


async def much(request: Request) -> Response:
    hurry(request)
    return Response(FLOOD)


async def pieces(request: Request) -> Response:
    hurry(request)
    return StreamingResponse(FLOOD[at : at + 65536] for at in range(0, len(FLOOD), 65536))


async def talk(line: WebSocket) -> None:
    await line.accept()
    if "flood" in line.query_params:
        await line.send_bytes(FLOOD)
    while (await line.receive())["type"] != "websocket.disconnect":
        pass


@pytest.fixture(scope="module")
def slots() -> ConnectionSlots:
    return ConnectionSlots()


@pytest.fixture(scope="module")
def port(slots: ConnectionSlots) -> Iterator[int]:
    @contextlib.asynccontextmanager
    async def lifespan(_: Any) -> Any:
        yield {"slots": slots}

    app = Starlette(
        routes=[Route("/", much), Route("/pieces", pieces), WebSocketRoute("/ws", talk)],
        lifespan=lifespan,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(guarded_connections, "CLOSE_S", 1.0)
        patch.setattr(guarded_connections, "LOOK_S", 0.1)
        patch.setattr(guarded_connections, "SILENT_S", 3.0)
        patch.setattr(guarded_connections, "PING_EVERY_S", 0.1)
        config = uvicorn.Config(
            app, port=0, http=GuardedHttp, ws=GuardedSocket, log_level="critical",
            ws_ping_interval=None, timeout_keep_alive=3600, timeout_graceful_shutdown=1,
        )  # fmt: skip
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        wait_for(lambda: server.started, "the server")
        yield server.servers[0].sockets[0].getsockname()[1]
        server.should_exit = True
        thread.join()


def connect(port: int, text: str, receive_bytes: int | None = None) -> socket.socket:
    line = socket.socket()
    if receive_bytes is not None:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
    line.settimeout(PATIENCE_S)
    line.connect(("127.0.0.1", port))
    line.sendall(text.encode())
    return line


def is_cut(line: socket.socket) -> bool:
    """Waits until the other side has ended it, whatever it sends before."""
    try:
        while line.recv(65536):
            pass
    except ConnectionResetError:
        pass
    return True


HEAD = "GET / HTTP/1.1\r\nHost: x\r\n"
UPGRADE = (
    "GET /ws{} HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


@pytest.mark.parametrize(
    "text",
    ["", "GET", HEAD, f"HEAD{HEAD[3:]}\r\nG"],
    ids=["nothing", "a word", "half a head", "half of the next request"],
)
def test_who_does_not_finish_a_request_is_cut(
    port: int, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guarded_connections, "HEAD_S", 1.0)
    with connect(port, text) as line:
        assert is_cut(line)


@pytest.mark.parametrize("path", ["/", "/pieces"], ids=["at once", "in pieces"])
def test_who_does_not_take_an_answer_is_cut(
    port: int, slots: ConnectionSlots, path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guarded_connections, "STALL_S", 1.0)
    with connect(port, f"GET {path} {HEAD[6:]}\r\n") as line:
        assert line.recv(8) == b"HTTP/1.1"
        wait_for(lambda: len(slots) == 0, "the end of the connection")


@pytest.mark.parametrize("path", ["/", "/pieces"], ids=["at once", "in pieces"])
@pytest.mark.parametrize("more", ["", "Connection: close\r\n"], ids=["kept", "closed"])
def test_a_slow_line_gets_all_of_an_answer_however_long_it_takes(
    port: int, path: str, more: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rests are longer than the time for the next request, which has not begun yet."""
    monkeypatch.setattr(guarded_connections, "HEAD_S", PATIENCE_S)
    monkeypatch.setattr(guarded_connections, "STALL_S", PATIENCE_S)
    request = f"GET {path}?hurry {HEAD[6:]}{more}\r\n"
    with connect(port, request, receive_bytes=RECEIVE_BYTES) as line:
        for _ in range(4):
            take(line, len(FLOOD) // 4)
            time.sleep(5.0 * HURRY_S)


def take(line: socket.socket, count: int) -> None:
    while count > 0:
        chunk = line.recv(count)
        assert chunk, f"cut {count} bytes too early"
        count -= len(chunk)


@pytest.mark.parametrize("query", ["", "?flood"], ids=["silent", "takes nothing"])
def test_a_vanished_page_is_dropped(port: int, slots: ConnectionSlots, query: str) -> None:
    with connect(port, UPGRADE.format(query)) as line:
        assert line.recv(12) == b"HTTP/1.1 101"
        wait_for(lambda: len(slots) == 0, "the end of the connection")


def test_a_page_on_a_slow_line_is_kept_for_as_long_as_it_takes_what_is_sent(
    port: int, slots: ConnectionSlots
) -> None:
    with connect(port, UPGRADE.format("?flood")) as line:
        line.settimeout(PATIENCE_S)
        end_s = time.monotonic() + 2.0 * guarded_connections.SILENT_S
        while time.monotonic() < end_s:  # and answers none of the pings
            assert line.recv(20_000)
            time.sleep(0.05)
        assert len(slots) == 1
        wait_for(lambda: len(slots) == 0, "the end of the connection")


def test_a_page_that_answers_pings_is_kept(port: int, slots: ConnectionSlots) -> None:
    with Page(port, path="/ws") as page:
        with connect(port, UPGRADE.format("")) as silent:
            assert is_cut(silent)
        assert len(slots) == 1
        page.line.ping().wait(PATIENCE_S)


def test_a_stranger_gives_way_to_whoever_comes_and_an_operator_to_nobody() -> None:
    cut: list[str] = []
    slots = ConnectionSlots(limit=3)

    def enter(name: str, address: str, role: str | None) -> bool:
        slot = Slot(address, lambda: cut.append(name))
        has_place = slots.enter(slot)
        slot.identify(role)
        return has_place

    enter("operator", "tablet", "operator")
    enter("viewer", "phone", "viewer")
    enter("stranger", "laptop", None)
    assert enter("second operator", "tablet", "operator")
    assert enter("third operator", "tablet", "operator")
    assert cut == ["stranger", "viewer"]
    assert not enter("stranger", "laptop", None)
    assert len(slots) == 3


def test_the_address_with_the_most_connections_loses_its_oldest() -> None:
    cut: list[str] = []
    slots = ConnectionSlots(limit=4)
    for name in ("tablet", "flood", "flood", "flood", "phone"):
        slots.enter(Slot(name, lambda name=name: cut.append(name)))  # type: ignore[misc]
    assert cut == ["flood"]


def exchange(headers: dict[str, str], chunks: list[bytes], role: str = "operator") -> list[Message]:
    """What is sent in answer to a mark whose body comes in these pieces, and then no more."""
    sent: list[Message] = []
    left = list(chunks)

    async def receive() -> Message:
        if not left:
            await asyncio.get_running_loop().create_future()
        return {"type": "http.request", "body": left.pop(0), "more_body": True}

    async def send(message: Message) -> None:
        sent.append(message)

    async def never(*_: Any) -> None:
        raise AssertionError("the application must not see it")

    named = [(name.encode(), value.encode()) for name, value in headers.items()]
    caller = Caller(session="x", role="operator" if role == "operator" else "viewer")
    scope: Scope = {
        "type": "http", "method": "POST", "path": "/api/v1/recordings/mark", "headers": named,
        "agribot.caller": caller,
    }  # fmt: skip
    asyncio.run(RequestBodies(never)(scope, receive, send))
    return sent


def test_a_body_that_does_not_come_is_answered_and_the_connection_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(request_bodies, "START_S", 0.01)
    start = exchange({"content-length": "100"}, [b"half"])[0]
    assert start["status"] == 408
    assert (b"connection", b"close") in start["headers"]


def test_a_body_without_a_length_is_counted_as_it_comes() -> None:
    pieces = [b"x" * 10_000] * 100
    start = exchange({"transfer-encoding": "chunked"}, pieces)[0]
    assert start["status"] == 413


@pytest.mark.parametrize("length", ["-1", "1e9", "٣", "9" * 5000, "1, 1"])
def test_a_length_that_is_no_number_is_refused(length: str) -> None:
    if not length.isascii():
        length = length.encode().decode("latin-1")
    assert exchange({"content-length": length}, [])[0]["status"] in {400, 413}


def test_only_operators_may_send_large_files() -> None:
    path = "/api/v1/fields/import"
    assert limit_bytes(path, "operator") > 10_000_000
    for role in ("viewer", None):
        assert limit_bytes(path, role) < 100_000
    assert limit_bytes("/api/v1/no/such/path", "operator") < 100_000
