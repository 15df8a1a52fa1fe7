"""What a slow, held or vanished line does to the states of a page, and to a hand behind it."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import AsyncIterator
from types import SimpleNamespace
from typing import cast

import msgspec
import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from agribot.ui import wire
from agribot.ui.hand.remote import clock_of
from agribot.ui.server import guarded_connections
from agribot.ui.server.client import STATES_KEPT
from agribot.ui.server.connection_slots import ConnectionSlots
from agribot.ui.server.hub import Hub
from agribot.ui.server.sockets import GONE_S, Socket
from agribot.ui.server.window import LEAST_BYTES
from tests.ui.client import Page
from tests.ui.conftest import Robot
from tests.ui.messages import make_state
from tests.ui.slow_line import SlowLine
from tests.waiting import wait_for

STATE_BYTES = 400


def test_a_held_line_carries_few_old_states_and_then_the_newest(robot: Robot) -> None:
    last, reason = 3000, "x" * STATE_BYTES
    path = "/ws/v1?tab=held&acks=1"
    with SlowLine(robot.port) as line, Page(robot.port, path=path, sock=line.connected()) as page:
        page.receive(wire.Snapshot)
        with line.held():
            for number in range(1, last + 1):
                robot.say(msgspec.structs.replace(make_state(number), reason=reason))
            with Page(robot.port, tab="beside") as beside:
                while beside.receive(wire.State).tick != last:
                    pass
        seen: list[int] = []
        while not seen or seen[-1] != last:
            seen.append(page.receive(wire.State).tick)
            page.send(wire.Receipt(count=10**6))
    assert seen == sorted(seen)
    assert len(seen) <= LEAST_BYTES / STATE_BYTES + STATES_KEPT + 1


def test_a_hand_that_let_go_long_ago_is_not_obeyed(robot: Robot, page: Page) -> None:
    """What was held up on its way would drive a robot whose operator has let go meanwhile."""
    page.take_seat()
    page.send(wire.Ping(sent_ms=1))
    clock_ms = page.receive(wire.Pong).mono_ms
    page.send(wire.DriveByHand(v_mps=0.11, yaw_rate_radps=0.0, mono_ms=clock_ms - 5000.0))
    page.send(wire.DriveByHand(v_mps=0.12, yaw_rate_radps=0.0, mono_ms=clock_ms + 60000.0))
    robot.wait_for(wire.DriveOrder, lambda order: order.v_mps == 0.12)
    assert 0.11 not in [order.v_mps for order in robot.of_kind(wire.DriveOrder)]
    page.send(wire.DriveByHand(v_mps=0.0, yaw_rate_radps=0.0, mono_ms=clock_ms - 5000.0))
    robot.orders.clear()
    page.send(wire.DriveByHand(v_mps=0.13, yaw_rate_radps=0.0))
    robot.wait_for(wire.DriveOrder, lambda order: order.v_mps == 0.13)


def test_a_program_stamps_what_its_hand_asks_by_the_quickest_of_its_answers() -> None:
    ahead_s = 1000.0

    def pong(sent_s: float, there_s: float) -> wire.Pong:
        mono_ms = 1e3 * (sent_s + there_s + ahead_s)
        return wire.Pong(sent_ms=1e3 * sent_s, mono_ms=mono_ms, wall_ms=0.0)

    first = clock_of(pong(5.0, 0.01), 5.02, None)
    assert first.ahead_s == pytest.approx(ahead_s)
    assert clock_of(pong(6.0, 1.5), 7.5, first) is first
    assert clock_of(pong(40.0, 0.5), 41.0, first).ahead_s == pytest.approx(ahead_s)


def test_a_stop_is_heard_however_late_it_comes(robot: Robot) -> None:
    with SlowLine(robot.port) as line, Page(robot.port, sock=line.connected()) as page:
        page.receive(wire.Hello)
        with line.held():
            page.send(wire.PressStop(id="late"))
        robot.wait_for_request("stop")


def test_a_page_that_vanished_without_a_word_is_cut() -> None:
    cut: list[bool] = []
    scope = {
        "agribot.caller": SimpleNamespace(role="viewer", session="s"),
        "state": {"slot": SimpleNamespace(cut=lambda: cut.append(True))},
    }
    hub = SimpleNamespace(channel_of=lambda _: SimpleNamespace(state=None, weeds={}))
    line = SimpleNamespace(scope=scope, query_params={"acks": "1"})
    page = Socket(cast(Hub, hub), cast(WebSocket, line), 1)
    page.client.window.note_sent(100, 50.0)
    page.cut_if_gone(50.0 + 0.9 * GONE_S)
    assert not cut
    page.acknowledge(1)
    page.client.window.note_sent(100, 60.0)
    page.cut_if_gone(60.0 + 0.9 * GONE_S)
    assert not cut
    page.cut_if_gone(60.0 + 1.1 * GONE_S)
    assert cut


def test_a_line_that_takes_nothing_is_cut_and_does_not_wait_for_its_buffer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(guarded_connections, "STUCK_S", 0.2)
    ended = threading.Event()

    async def send_without_end(line: WebSocket) -> None:
        await line.accept()
        try:
            while True:
                await line.send_text("x" * 10_000)
        except (WebSocketDisconnect, RuntimeError):
            ended.set()

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[dict[str, ConnectionSlots]]:
        yield {"slots": ConnectionSlots()}

    app = Starlette(routes=[WebSocketRoute("/ws/v1", send_without_end)], lifespan=lifespan)
    listener = socket.create_server(("127.0.0.1", 0))
    config = uvicorn.Config(
        app,
        http=guarded_connections.GuardedHttp,
        ws=guarded_connections.GuardedSocket,
        log_level="error",
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, args=([listener],), daemon=True)
    thread.start()
    with Page(listener.getsockname()[1], max_queue=1):
        wait_for(ended.is_set, "the end of the line")
    server.should_exit = True
    thread.join()
