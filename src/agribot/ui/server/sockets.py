"""`/ws/v1`: states out, requests in."""

from __future__ import annotations

import asyncio
import contextlib
import time

from starlette.websockets import WebSocket, WebSocketDisconnect

from agribot.core.messages import AskerKind, Who
from agribot.core.version import __version__
from agribot.ui import wire
from agribot.ui.server.access import make_who
from agribot.ui.server.channel import Channel
from agribot.ui.server.client import Client
from agribot.ui.server.commands import Commands, Refused
from agribot.ui.server.guarded_connections import POLICY, TOO_MUCH
from agribot.ui.server.hub import Hub
from agribot.ui.server.languages import find_language
from agribot.ui.server.page_slots import make_room
from agribot.ui.server.window import Window

TRY_LATER = 1013
GONE_S = 10.0  # a page that acknowledges is cut where it has not done so for as long


class Socket:
    """One page on the line. `session` is the browser's, with the tab where it names one."""

    def __init__(self, hub: Hub, socket: WebSocket, number: int) -> None:
        caller = socket.scope["agribot.caller"]
        self.hub, self.role = hub, caller.role
        self.session = f"{caller.session or f'visit-{number}'}/{socket.query_params.get('tab', '')}"
        self.name = f"{self.role} {number}"
        window = Window(is_acknowledged=socket.query_params.get("acks") == "1")
        language = find_language(socket.query_params.get("language", ""))
        self.client = Client(hub.channel_of(self.session), window, language)
        self._socket = socket
        self._commands = Commands(hub, self)
        self.heard_s = time.monotonic()

    @property
    def who(self) -> Who:
        return make_who(self.name, self.role)

    async def serve(self) -> None:
        hub = self.hub
        hub.sockets.add(self)
        hub.seat.note_life(self.session, time.monotonic())
        self.send(self._hello())
        self.channel.clients.add(self.client)
        hub.announce_seat()
        sender = asyncio.create_task(self._send_all())
        try:
            await self._listen()
        except Refused as refused:
            hub.refuse(self.who, str(refused))
            await self._leave(str(refused))
        except WebSocketDisconnect:
            pass
        finally:
            sender.cancel()
            hub.sockets.discard(self)
            self.channel.clients.discard(self.client)
            self._commands.let_go()
            hub.announce_seat()

    def send(self, message: wire.ServerMessage) -> None:
        self.client.send(message)

    def cut(self) -> None:
        """End the connection at once, whatever waits to be sent on it."""
        self._socket.scope["state"]["slot"].cut()

    def send_seat(self) -> None:
        seat = self.hub.seat.seen_by(self.session, time.monotonic())
        self.send(
            wire.SeatChange(seat=seat, holder=self.hub.seat.name, clients=len(self.hub.sockets))
        )

    @property
    def channel(self) -> Channel:
        """The stream that this page is shown."""
        return self.client.channel

    def follow(self, channel: Channel) -> None:
        """Show another stream: the page gets its snapshot and then its states."""
        self.channel.clients.discard(self.client)
        channel.clients.add(self.client)
        self.client.follow(channel)

    def acknowledge(self, count: int) -> None:
        """Note how many messages the page has received since it was opened."""
        self.client.window.note_received(count, time.monotonic())
        self.client.wake()

    def cut_if_gone(self, now_s: float) -> None:
        """Cut the line of a page that vanished without a word."""
        if self.client.window.waiting_s(now_s) > GONE_S:
            self.cut()

    def _hello(self) -> wire.Hello:
        hub = self.hub
        return wire.Hello(
            run=hub.about.run_id,
            session=self.session.partition("/")[0][:8],
            role=self.role,
            version=__version__,
            source=self.channel.source,
            seat=hub.seat.seen_by(self.session, time.monotonic()),
            holder=hub.seat.name,
            clients=len(hub.sockets),
        )

    async def _send_all(self) -> None:
        """Send; a page that takes nothing holds up its own line only, until it is cut."""
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                text = await self.client.next()
                self.client.window.note_sent(len(text), time.monotonic())
                await self._socket.send_text(text)

    async def _listen(self) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                if message.get("code") == POLICY:
                    self.hub.refuse(self.who, TOO_MUCH)
                return
            text = message.get("text")
            if text is None:
                raise Refused("a binary frame; this line speaks JSON text")
            self._obey(text)

    def _obey(self, text: str) -> None:
        """Read a message and do what it asks.

        Raises: Refused: nothing that a page says, and nothing to answer it by.
        """
        self.heard_s = time.monotonic()
        try:
            message = wire.read_page_message(text)
        except wire.BadMessage as error:
            if not error.id:
                raise Refused(str(error)) from error
            self.send(wire.Verdict(id=error.id, ok=False, reason=str(error)))
            return
        try:
            self._commands.obey(message)
        except Refused as error:
            if not isinstance(message, wire.Request) or not message.id:
                raise
            self.send(wire.Verdict(id=message.id, ok=False, reason=str(error)))

    async def _leave(self, reason: str) -> None:
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await self._socket.send_text(wire.encode(wire.Bye(reason=reason)).decode())
            await self._socket.close(POLICY, reason[:120])


async def state_socket(socket: WebSocket) -> None:
    hub: Hub = socket.app.state.hub
    refusal = make_room(hub, socket.scope["agribot.caller"], time.monotonic())
    if refusal:
        hub.refuse(Who("a page", AskerKind.UNKNOWN), refusal)
        await socket.close(TRY_LATER)
        return
    await socket.accept()
    hub.visits += 1
    await Socket(hub, socket, hub.visits).serve()
