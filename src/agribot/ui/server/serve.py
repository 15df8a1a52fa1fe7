"""The server's process: reads the robot's two lines, serves the page, ends with the robot."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import gc
import queue
import signal
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import uvicorn

from agribot.core.signals import ignore_interrupts
from agribot.ros.display_requests import DisplayRequest, OnOutcome, TakeDisplay
from agribot.ui import wire
from agribot.ui.about import About
from agribot.ui.server.app import build_app
from agribot.ui.server.camera import Camera, unpack_pixels
from agribot.ui.server.connection_slots import ConnectionSlots
from agribot.ui.server.guarded_connections import GuardedHttp, GuardedSocket, serve_guarded
from agribot.ui.server.hub import Hub
from agribot.ui.server.off_the_loop import run_in_thread
from agribot.ui.server.replay import STATE_HZ, Replay
from agribot.ui.server.replays import EVERYBODY

MAX_FRAME_BYTES = 64 * 1024
ORDERS_KEPT = 500
WATCH_S = 0.25
LEAVE_S = 5.0


class QuietServer(uvicorn.Server):
    """Signals are the robot's business: an interrupt must stop the wheels before the page."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class RobotLine:
    """Orders to the robot, written by a thread: a robot that hangs does not hang the server."""

    def __init__(self, link: Connection) -> None:
        self._link = link
        self._orders: queue.SimpleQueue[wire.RobotOrder] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="orders", daemon=True).start()

    def put(self, order: wire.RobotOrder) -> None:
        is_stop = isinstance(order, wire.RequestOrder) and order.request.word == "stop"
        if is_stop or self._orders.qsize() < ORDERS_KEPT:
            self._orders.put(order)

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                self._link.send_bytes(wire.encode(self._orders.get()))


def main(about: About, link: Connection, camera_link: Connection, listener: socket.socket) -> None:
    """Serve until the robot's end of `link` is closed."""
    ignore_interrupts()
    gc.freeze()
    asyncio.run(_serve(about, link, camera_link, listener))


async def _serve(
    about: About, link: Connection, camera_link: Connection, listener: socket.socket
) -> None:
    line = RobotLine(link)
    hub = Hub(about, line.put)

    @contextlib.asynccontextmanager
    async def lifespan(app: Any) -> AsyncIterator[dict[str, Any]]:
        tasks = [asyncio.create_task(work(hub)) for work in (_watch, _replay, _keep_topics)]
        loop = asyncio.get_running_loop()
        camera: Camera = app.state.camera
        ended = functools.partial(_end, hub, server)
        _read(link, loop, lambda data: _hear(hub, data, ended), ended)
        _read(camera_link, loop, lambda data: camera.show(unpack_pixels(data)), lambda: None)
        if about.recording:  # the watch says meanwhile that the loop goes round
            path = Path(about.recording)
            player = await run_in_thread(Replay.load, path, about.current)
            hub.start_replay(EVERYBODY, player, "operator")
        hub.order(wire.Ready())
        yield {"slots": ConnectionSlots()}
        for task in tasks:
            task.cancel()

    config = uvicorn.Config(
        build_app(hub, lifespan),
        http=GuardedHttp,
        ws=GuardedSocket,
        ws_max_size=MAX_FRAME_BYTES,
        ws_per_message_deflate=False,
        ws_ping_interval=None,
        ws_ping_timeout=None,
        log_level="error",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=2,
        ssl_certfile=about.tls_cert or None,
        ssl_keyfile=about.tls_key or None,
    )
    server = QuietServer(config)
    loop = asyncio.get_running_loop()
    guarded = functools.partial(serve_guarded, loop.create_server)
    loop.create_server = guarded  # type: ignore[method-assign]
    with contextlib.suppress(NotImplementedError):  # Windows, which has no such signal
        loop.add_signal_handler(signal.SIGTERM, lambda: _end(hub, server))
    await server.serve(sockets=[listener])


def _read(link: Connection, loop: asyncio.AbstractEventLoop, hear: Any, end: Any) -> None:
    """Hand over one message after the other in a thread; a busy loop slows the sender down."""

    async def hand_over(data: bytes) -> None:
        hear(data)

    def run() -> None:
        with contextlib.suppress(OSError, EOFError, RuntimeError):
            while True:
                asyncio.run_coroutine_threadsafe(hand_over(link.recv_bytes()), loop).result()
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(end)

    threading.Thread(target=run, name="robot", daemon=True).start()


def _hear(hub: Hub, data: bytes, end: Callable[[], None]) -> None:
    message = wire.read_robot_message(data)
    if isinstance(message, wire.State):
        hub.live.publish_state(message)
    elif isinstance(message, wire.TickCounts):
        hub.counts.append(message)
    elif isinstance(message, wire.Answer):
        hub.hear_answer(message)
    elif isinstance(message, wire.End):
        end()
    else:
        hub.live.publish_growth(message)


def _end(hub: Hub, server: uvicorn.Server) -> None:
    if hub.is_robot_gone:
        return
    hub.is_robot_gone = True
    for page in hub.sockets:
        page.send(wire.Bye(reason="the robot's program has ended"))
    asyncio.get_running_loop().call_later(0.3, _close, server)


def _close(server: uvicorn.Server) -> None:
    server.should_exit = True


async def _watch(hub: Hub) -> None:
    """Report to pages that the seat is free, and to the robot that its operator is gone.

    The robot hears each time that the loop goes round.
    """
    was_silent = True
    while True:
        await asyncio.sleep(WATCH_S)
        hub.order(wire.Alive())
        hub.publish_live()
        hub.cut_gone_pages(time.monotonic())
        is_silent = hub.seat.is_silent(time.monotonic())
        if is_silent != was_silent:
            was_silent = is_silent
            hub.announce_seat()
            if is_silent and hub.seat.holder:
                hub.order(wire.OperatorLost(who=wire.Who(hub.seat.name)))


async def _keep_topics(hub: Hub) -> None:
    """Take layers from ROS, and leave the topics that no page shows any more."""
    loop = asyncio.get_running_loop()
    while True:
        for network in hub.about.ros.layers_from:
            take = _make_taker(hub, loop, network)
            await run_in_thread(hub.find_topics().take_layers, network, take)
            serve = _make_display_taker(hub, loop, network)
            await run_in_thread(hub.find_topics().serve_displays, network, serve)
        if hub.topics is not None:
            await run_in_thread(hub.topics.close_idle)
        await asyncio.sleep(LEAVE_S)


def _make_taker(hub: Hub, loop: asyncio.AbstractEventLoop, network: str) -> Callable[[str], None]:
    """Make what a thread of a network calls with each text for the loop."""

    def take(text: str) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(hub.take_layer, network, text)

    return take


def _make_display_taker(hub: Hub, loop: asyncio.AbstractEventLoop, network: str) -> TakeDisplay:
    """Make what a thread of a network calls with each display for the loop."""

    def take(request: DisplayRequest, on_outcome: OnOutcome) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(lambda: on_outcome(*hub.take_display(network, request)))

    return take


async def _replay(hub: Hub) -> None:
    next_s = time.monotonic()
    while True:
        hub.replays.step(time.monotonic())
        next_s = max(next_s + 1.0 / STATE_HZ, time.monotonic())
        await asyncio.sleep(next_s - time.monotonic())
