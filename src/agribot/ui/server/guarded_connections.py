"""Uvicorn's connections with the deadlines it lacks: a slow or silent client cannot hold one.

Uvicorn ends idle connections only between two requests. Here the head of a request has to come
within a time, an answer has to be taken, and a WebSocket whose other side is not heard is cut.
The body of a request has its own deadline in `request_bodies`.
"""

from __future__ import annotations

import array
import asyncio
import contextlib
import socket
import ssl
from asyncio.sslproto import SSLProtocol
from collections.abc import Awaitable, Callable
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.protocol import State

from agribot.ui.server.allowance import MAX_FRAMES_PER_S, FrameAllowance
from agribot.ui.server.connection_slots import ConnectionSlots, Slot

HEAD_S = 10.0  # time for the whole head of a request, and the rest of the one before
LOOK_S = 2.0  # period of looks at the untaken rest of an answer
STALL_S = 60.0  # time without progress of an answer; a slow line may take as long as it needs
HANDSHAKE_S = 5  # time limit of TLS
DAY_S = 24 * 3600  # time limit of TLS's goodbye, which HEAD_S and CLOSE_S limit once all is sent
ACCEPTED_AT_ONCE = 32
PING_EVERY_S = 2.0
SILENT_S = 6.0  # a browser answers three pings by then, also with its page asleep
CLOSE_S = 2.0  # time for the goodbyes of both sides
STUCK_S = 10.0  # time in which a page takes not a byte, though it sends
POLICY = 1008  # the code of RFC 6455 for a page that breaks a rule of the server
TOO_MUCH = f"more than {MAX_FRAMES_PER_S} frames, or kilobytes, in a second"
UNSENT_BYTES = 16 * 1024  # waiting in this machine; what is newer waits where it can be left out


class GuardedHttp(H11Protocol):
    """`app_state` holds the server's `slots`; requests find their own in `scope["state"]`."""

    def __init__(self, config: Any, server_state: Any, app_state: dict[str, Any], **_: Any) -> None:
        super().__init__(config, server_state, dict(app_state))
        self._slots: ConnectionSlots = app_state["slots"]
        self._slot: Slot | None = None
        self._line: asyncio.Transport  # carries the bytes: with TLS, what is below it
        self._timer: asyncio.TimerHandle | None = None
        self._unsent_bytes = 0
        self._taken_s = 0.0  # when the other side last took something of an answer

    def enter(self, line: asyncio.Transport) -> bool:
        """Whether there is a slot for this line."""
        peer = line.get_extra_info("peername")
        slot = Slot(str(peer[0]) if peer else "", line.abort)
        if not self._slots.enter(slot):
            line.abort()
            return False
        self._slot = self.app_state["slot"] = slot
        self._line = self.app_state["line"] = line
        return True

    def leave(self) -> None:
        if self._slot is not None:
            self._slots.leave(self._slot)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        if self._slot is None and not self.enter(transport):
            return
        super().connection_made(transport)
        self._expect_request()

    def connection_lost(self, exc: Exception | None) -> None:
        if self._slot is None:
            return
        self.leave()
        self._end_timer()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        before = self.cycle
        super().handle_events()
        if self.cycle is not before:
            self._watch_answer()

    def handle_websocket_upgrade(self, event: Any) -> None:
        self._end_timer()
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        """Complete is what was written; a slow line may carry it for minutes yet."""
        self._watch_answer()
        super().on_response_complete()

    def resume_writing(self) -> None:
        self._taken_s = self.loop.time()
        super().resume_writing()

    def _expect_request(self) -> None:
        self._taken_s = self.loop.time()
        self._end_timer()
        self._timer = self.loop.call_later(HEAD_S, self._line.abort)

    def _watch_answer(self) -> None:
        """Look every so often whether it is taken, until all of it is."""
        now_s, unsent_bytes = self.loop.time(), count_unsent(self._line)
        if unsent_bytes == 0 and self.cycle.response_complete:
            self._expect_request()
            return
        if unsent_bytes == 0 or unsent_bytes < self._unsent_bytes:
            self._taken_s = now_s
        self._unsent_bytes = unsent_bytes
        if now_s - self._taken_s > STALL_S:
            self._line.abort()
            return
        self._end_timer()
        self._timer = self.loop.call_later(LOOK_S, self._watch_answer)

    def _end_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class GuardedTls(SSLProtocol):
    """TLS whose connection has its slot from the first byte on: a handshake costs one, too."""

    def __init__(self, http: GuardedHttp, context: ssl.SSLContext) -> None:
        super().__init__(
            http.loop, http, context, None, server_side=True,  # type: ignore[arg-type]
            ssl_handshake_timeout=HANDSHAKE_S, ssl_shutdown_timeout=DAY_S,
        )  # fmt: skip
        self._http = http

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        if self._http.enter(transport):
            super().connection_made(transport)

    def connection_lost(self, exc: BaseException | None) -> None:
        self._http.leave()
        super().connection_lost(exc)


async def serve_guarded(
    create_server: Callable[..., Awaitable[asyncio.Server]],
    make_http: Callable[[], GuardedHttp],
    *,
    sock: socket.socket,
    ssl: ssl.SSLContext | None,
    backlog: int,
) -> asyncio.Server:
    """Do what the loop's `create_server` does, with `GuardedTls` and without its long rounds.

    The loop accepts as many connections in one round as may wait, before any of them gives way to
    another: a flood would take all descriptors, and then no client is accepted for 1 s.
    """
    make = make_http if ssl is None else lambda: GuardedTls(make_http(), ssl)
    server = await create_server(make, sock=sock, backlog=ACCEPTED_AT_ONCE)
    sock.listen(backlog)
    return server


def count_unsent(line: asyncio.Transport) -> int:
    """Count what was written and not yet taken by the other side, here and in the system."""
    with contextlib.suppress(OSError, ValueError, AttributeError):  # the line has gone
        return _count_in_system(line.get_extra_info("socket")) + line.get_write_buffer_size()
    return line.get_write_buffer_size()


def _count_in_system(line: socket.socket) -> int:
    """Count the bytes that the system has not sent yet; 0 where unknown, as on Windows."""
    try:
        import fcntl
        import termios
    except ImportError:
        return 0
    count = array.array("i", [0])
    fcntl.ioctl(line.fileno(), termios.TIOCOUTQ, count)  # tcp(7)
    return count[0]


class GuardedSocket(WebSocketsSansIOProtocol):
    """Signs of life are whatever is heard, and that what waits to be sent gets less.

    On a slow line a ping waits behind a picture, and its answer comes late. Little waits in the
    buffers, so that states that are out of date are left out before they get there. A line that
    is given up is aborted: a close in order would wait until the page has taken all of it.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._heard_s = self.loop.time()
        self._frames = FrameAllowance(self._heard_s)
        self._is_flooded = False
        self._queued_bytes = 0
        self._look: asyncio.TimerHandle | None = None
        self._stuck: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=UNSENT_BYTES)
        with contextlib.suppress(OSError, AttributeError):  # some systems lack the option
            line = transport.get_extra_info("socket")
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
        self._look = self.loop.call_later(PING_EVERY_S, self._ping)

    def connection_lost(self, exc: Exception | None) -> None:
        self.app_state["slots"].leave(self.app_state["slot"])
        if self._look is not None:
            self._look.cancel()
        self._watch_buffer(None)
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        super().pause_writing()
        self._watch_buffer(self._count_queued())

    def resume_writing(self) -> None:
        self._watch_buffer(None)
        super().resume_writing()

    def data_received(self, data: bytes) -> None:
        """Take what is within the allowance, and the first frame above it: it may be a STOP."""
        self._heard_s = self.loop.time()
        if not self.handshake_initiated:
            super().data_received(data)
        elif not self._is_flooded:
            end = self._frames.find_excess(data, self._heard_s)
            super().data_received(data[:end])
            if end is not None:
                self._refuse_flood()

    def _refuse_flood(self) -> None:
        """Read no more, and close the line with the reason once all before is obeyed."""
        self._is_flooded = True
        self.queue.put_nowait({"type": "websocket.disconnect", "code": POLICY, "reason": TOO_MUCH})
        if self.handshake_complete and self.conn.state is State.OPEN:
            self.conn.send_close(POLICY, TOO_MUCH)
            self.transport.write(b"".join(self.conn.data_to_send()))
        self.transport.close()

    def on_task_complete(self, task: asyncio.Task[None]) -> None:
        """Cut the connection: a close would wait until all is sent, which may be never."""
        super().on_task_complete(task)
        self.loop.call_later(CLOSE_S, self.transport.abort)

    def _ping(self) -> None:
        queued_bytes = self._count_queued()
        if queued_bytes < self._queued_bytes:
            self._heard_s = self.loop.time()
        self._queued_bytes = queued_bytes
        if self.loop.time() - self._heard_s > SILENT_S:
            self.transport.abort()
            return
        if self.handshake_complete and not self.close_sent and not self.transport.is_closing():
            self.conn.send_ping(b"")
            self.transport.write(b"".join(self.conn.data_to_send()))
        self._look = self.loop.call_later(PING_EVERY_S, self._ping)

    def _count_queued(self) -> int:
        return count_unsent(self.app_state["line"])

    def _watch_buffer(self, size_bytes: int | None) -> None:
        """Look again later whether it has shrunk; None ends that."""
        if self._stuck is not None:
            self._stuck.cancel()
            self._stuck = None
        if size_bytes is not None:
            self._stuck = self.loop.call_later(STUCK_S, self._cut_if_stuck, size_bytes)

    def _cut_if_stuck(self, before_bytes: int) -> None:
        size_bytes = self._count_queued()
        if size_bytes >= before_bytes:
            self.transport.abort()
        else:
            self._watch_buffer(size_bytes)
