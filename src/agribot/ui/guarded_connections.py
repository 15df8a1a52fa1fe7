"""Uvicorn's connections with the deadlines it lacks: nobody holds one by being slow or silent.

Uvicorn ends idle connections only between two requests. Here the head of a request has to come
within a time, an answer has to be taken, and a WebSocket whose other side is not heard is cut.
The body of a request has its own deadline in `request_bodies`.
"""

from __future__ import annotations

import array
import asyncio
import contextlib
import fcntl
import socket
import termios
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from agribot.ui.connection_slots import ConnectionSlots, Slot

HEAD_S = 10.0  # for the whole head of a request, and what is left of the one before
STALL_S = 60.0  # in which nothing like 100 kB of an answer is taken
PING_EVERY_S = 2.0
SILENT_S = 6.0  # a browser answers three pings by then, also with its page asleep
CLOSE_S = 2.0  # for the goodbyes of both sides
STUCK_S = 10.0  # in which a page takes not a byte, though it sends
UNSENT_BYTES = 16 * 1024  # waiting in this machine; what is newer waits where it can be left out


class GuardedHttp(H11Protocol):
    """`app_state` holds the server's `slots`; requests find their own in `scope["state"]`."""

    def __init__(self, config: Any, server_state: Any, app_state: dict[str, Any], **_: Any) -> None:
        super().__init__(config, server_state, dict(app_state))
        self._slots: ConnectionSlots = app_state["slots"]
        self._slot: Slot | None = None
        self._deadline: asyncio.TimerHandle | None = None
        self._stall: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        peer = transport.get_extra_info("peername")
        slot = Slot(str(peer[0]) if peer else "", transport.abort)
        if not self._slots.enter(slot):
            transport.abort()
            return
        self._slot = self.app_state["slot"] = slot
        super().connection_made(transport)
        self._expect_request()

    def connection_lost(self, exc: Exception | None) -> None:
        if self._slot is None:
            return
        self._slots.leave(self._slot)
        self._end_deadline()
        self._end_stall()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        before = self.cycle
        super().handle_events()
        if self.cycle is not before:
            self._end_deadline()

    def handle_websocket_upgrade(self, event: Any) -> None:
        self._end_deadline()
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        self._expect_request()
        super().on_response_complete()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._end_stall()
        self._stall = self.loop.call_later(STALL_S, self.transport.abort)

    def resume_writing(self) -> None:
        self._end_stall()
        super().resume_writing()

    def _expect_request(self) -> None:
        self._end_deadline()
        self._deadline = self.loop.call_later(HEAD_S, self.transport.abort)

    def _end_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _end_stall(self) -> None:
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None


class GuardedSocket(WebSocketsSansIOProtocol):
    """Signs of life are whatever is heard, and that what waits to be sent gets less.

    On a slow line a ping waits behind a picture, and its answer comes late. Little waits in the
    buffers, so that states that are out of date are left out before they get there. A line that
    is given up is aborted: a close in order would wait until the page has taken all of it.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._heard_s = self.loop.time()
        self._queued_bytes = 0
        self._look: asyncio.TimerHandle | None = None
        self._stuck: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=UNSENT_BYTES)
        with contextlib.suppress(OSError, AttributeError):  # where the system knows the option
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
        self._watch_buffer(self.transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        self._watch_buffer(None)
        super().resume_writing()

    def data_received(self, data: bytes) -> None:
        self._heard_s = self.loop.time()
        super().data_received(data)

    def on_task_complete(self, task: asyncio.Task[None]) -> None:
        """A close waits until all is sent, which may be never."""
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
        """What was written and not yet taken by the other side, here and in the system."""
        count = array.array("i", [0])
        line = self.transport.get_extra_info("socket")
        with contextlib.suppress(OSError, AttributeError):
            fcntl.ioctl(line.fileno(), termios.TIOCOUTQ, count)  # tcp(7): SIOCOUTQ
        return count[0] + self.transport.get_write_buffer_size()

    def _watch_buffer(self, size_bytes: int | None) -> None:
        """Look again later whether it has shrunk; None ends that."""
        if self._stuck is not None:
            self._stuck.cancel()
            self._stuck = None
        if size_bytes is not None:
            self._stuck = self.loop.call_later(STUCK_S, self._cut_if_stuck, size_bytes)

    def _cut_if_stuck(self, before_bytes: int) -> None:
        size_bytes = self.transport.get_write_buffer_size()
        if size_bytes >= before_bytes:
            self.transport.abort()
        else:
            self._watch_buffer(size_bytes)
