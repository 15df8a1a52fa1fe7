"""`/ws/v1`: states out, requests in."""

from __future__ import annotations

import asyncio
import contextlib
import time
from typing import Any

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from agribot import __version__
from agribot.ui.channel import Channel, Client
from agribot.ui.commands import Commands, Refused
from agribot.ui.hub import Hub

MAX_SOCKETS = 64
MAX_MESSAGES_PER_S = 120  # 20 Hz of driving needs a sixth of it
POLICY, TRY_LATER = 1008, 1013


class Socket:
    """One page on the line. `session` is the browser's, with the tab where it names one."""

    def __init__(self, hub: Hub, socket: WebSocket, number: int) -> None:
        caller = socket.scope["agribot.caller"]
        self.hub, self.role = hub, caller.role
        self.session = f"{caller.session or f'visit-{number}'}/{socket.query_params.get('tab', '')}"
        self.name = f"{self.role} {number}"
        self.client = Client()
        self.channel = hub.channel_of(self.session)
        self._socket = socket
        self._commands = Commands(hub, self)
        self._window_s, self._in_window = 0.0, 0

    async def serve(self) -> None:
        hub = self.hub
        hub.sockets.add(self)
        hub.seat.heard(self.session, time.monotonic())
        self.tell(self._hello())
        self.follow(self.channel)
        hub.tell_seat()
        sender = asyncio.create_task(self._send_all())
        try:
            await self._listen()
        except Refused as refused:
            hub.refuse(self.name, str(refused))
            await self._leave(str(refused))
        except WebSocketDisconnect:
            pass
        finally:
            sender.cancel()
            hub.sockets.discard(self)
            self.channel.clients.discard(self.client)
            self._commands.let_go()
            hub.tell_seat()

    def tell(self, message: dict[str, Any]) -> None:
        self.client.tell(msgspec.json.encode(message).decode())

    def tell_seat(self) -> None:
        self.tell({"k": "seat", **self._seat()})

    def follow(self, channel: Channel) -> None:
        """Show another stream: the page gets its snapshot and then its states."""
        self.channel.clients.discard(self.client)
        self.channel = channel
        channel.clients.add(self.client)
        self.client.start_over()
        if channel.state_text:
            self.client.state(channel.state_text)

    def _seat(self) -> dict[str, Any]:
        hub = self.hub
        seen = hub.seat.seen_by(self.session, time.monotonic())
        return {"seat": seen, "holder": hub.seat.name, "clients": len(hub.sockets)}

    def _hello(self) -> dict[str, Any]:
        return {
            "k": "hello",
            "session": self.session.partition("/")[0][:8],
            "role": self.role,
            "version": __version__,
            "source": self.channel.source,
            **self._seat(),
        }

    async def _send_all(self) -> None:
        """A page that takes nothing holds up its own line only, until its pings are missed."""
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await self._socket.send_text(await self.client.next(self.channel))

    async def _listen(self) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if text is None:
                raise Refused("a binary frame; this line speaks JSON text")
            self._count(text)
            self._commands.obey(text)

    def _count(self, text: str) -> None:
        """A stop is always heard, however much else this page sends."""
        now_s = time.monotonic()
        if now_s - self._window_s >= 1.0:
            self._window_s, self._in_window = now_s, 0
        self._in_window += 1
        if self._in_window > MAX_MESSAGES_PER_S and '"stop"' not in text:
            raise Refused(f"more than {MAX_MESSAGES_PER_S} messages in a second")

    async def _leave(self, reason: str) -> None:
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await self._socket.send_text(
                msgspec.json.encode({"k": "bye", "reason": reason}).decode()
            )
            await self._socket.close(POLICY, reason[:120])


async def state_socket(socket: WebSocket) -> None:
    hub: Hub = socket.app.state.hub
    if len(hub.sockets) >= MAX_SOCKETS:
        hub.refuse("a page", f"{MAX_SOCKETS} pages are connected already")
        await socket.close(TRY_LATER)
        return
    await socket.accept()
    hub.visits += 1
    await Socket(hub, socket, hub.visits).serve()
