"""The page's side of the wire contract, answered by a fake robot. Run it to look at the page:

python -m tests.ui.page.fake_server 8900
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

import agribot
from agribot.gis.field_choice import keep_field, list_fields
from agribot.gis.formats.table import read_field_file, write_field_file
from agribot.ui import wire
from agribot.ui.server.mapviz_config import config_of, displays_of
from tests.ui.page import fake_answers
from tests.ui.page.fake_robot import EPOCH, FakeRobot, camera_packets, field

SOURCE = Path(agribot.__file__).parent
# As the real server sends it: what it forbids must not be needed.
POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
    "worker-src 'self' blob:; connect-src 'self' blob: data:; frame-ancestors 'none'"
)
PAGE = SOURCE / "ui" / "page"
STATE_HZ = 30  # as the robot's server sends
PICTURES_HZ = 5
FEW_HZ = 10  # enough for what a page does with a state, at a third of the browser's work


class FakeServer:
    """One robot, any number of pages; `seat` is the socket that holds it."""

    def __init__(self, weeds: int = 400, page: Path = PAGE, state_hz: float = FEW_HZ) -> None:
        self.robot, self.page = FakeRobot(weeds), page
        self._period_s = 1.0 / state_hz
        self.clients: set[WebSocket] = set()
        self.seat: str | None = None
        self.silent = False
        self.address = ""
        self.written: dict[str, Any] = {}
        self.answers: dict[str, Any] = dict(fake_answers.FIXED)
        self.requests: list[str] = []
        self.refused_goal = ""  # why

    def app(self) -> Starlette:
        policy = Middleware(BaseHTTPMiddleware, dispatch=_with_policy)
        return Starlette(routes=self._routes(), lifespan=self._lifespan, middleware=[policy])

    def _routes(self) -> list[BaseRoute]:
        answers = [Route(f"/api/v1/{name}", self._fixed(name)) for name in fake_answers.FIXED]
        return [
            *answers,
            Route("/api/v1/goal/preview", self._preview_goal, methods=["POST"]),
            Route("/api/v1/fields/import", _import_field, methods=["POST"]),
            Route("/api/v1/fields/export", _export_field, methods=["POST"]),
            Route("/api/v1/views/import", _import_view, methods=["POST"]),
            Route("/api/v1/views/export", _export_view, methods=["POST"]),
            Route(
                "/api/v1/{path:path}",
                self._write,
                methods=["GET", "PUT", "POST", "PATCH", "DELETE"],
            ),
            WebSocketRoute("/ws/v1", self._state_socket),
            WebSocketRoute("/ws/cam/main", self._camera_socket),
            Route("/tiles/farm/{z:int}/{x:int}/{y:int}", self._tile),
            Route("/robot/robot.urdf", self._urdf),
            Mount("/robot/meshes", StaticFiles(directory=SOURCE / "description" / "meshes")),
            Mount("/", StaticFiles(directory=self.page, html=True)),
        ]

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> Any:
        ticking = asyncio.create_task(self._tick())
        yield
        ticking.cancel()

    async def _tick(self) -> None:
        receiver = self.robot.receiver
        while True:
            added = self.robot.step(self._period_s)
            if not self.silent:
                first = len(self.robot.trajectory) - len(added)
                trace = wire.TracePiece(epoch=EPOCH, first=first, points_map_m=added)
                state = self.robot.state(time.monotonic() * 1000)
                await self._broadcast([trace, state] if added else [state])
                if receiver is not self.robot.receiver:
                    receiver = self.robot.receiver
                    await self._broadcast([receiver])
            await asyncio.sleep(self._period_s)

    async def _broadcast(self, messages: Sequence[wire.ServerMessage]) -> None:
        for client in list(self.clients):
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                for message in messages:
                    await _send(client, message)

    async def _state_socket(self, socket: WebSocket) -> None:
        await socket.accept()
        who = socket.cookies.get("who", "page")
        self.clients.add(socket)
        session: wire.SessionInfo = self.answers["session"]
        seat, holder, clients = self._seat(who)
        hello = wire.Hello(
            run=session.run, session=who, role=session.role, version=session.version,
            source="sim", seat=seat, holder=holder, clients=clients,
        )  # fmt: skip
        await _send(socket, hello)
        await _send(socket, self.robot.snapshot())
        await _send(socket, self.robot.receiver)
        try:
            while True:
                message = wire.read_page_message(await socket.receive_text())
                await self._receive(socket, who, message)
        except WebSocketDisconnect:
            self.clients.discard(socket)

    def _seat(self, who: str) -> tuple[wire.SeatState, str, int]:
        seat: wire.SeatState = "you" if self.seat == who else "other" if self.seat else "free"
        return seat, self.seat or "", max(1, len(self.clients))

    async def _receive(self, socket: WebSocket, who: str, message: wire.PageMessage) -> None:
        if isinstance(message, wire.Ping):
            mono_ms, wall_ms = time.monotonic() * 1e3, time.time() * 1e3
            pong = wire.Pong(sent_ms=message.sent_ms, mono_ms=mono_ms, wall_ms=wall_ms)
            await _send(socket, pong)
            return
        if isinstance(message, wire.Receipt):
            return
        if isinstance(message, wire.TakeSeat | wire.LeaveSeat):
            self.seat = who if isinstance(message, wire.TakeSeat) else None
            for client in list(self.clients):
                seat, holder, clients = self._seat(client.cookies.get("who", "page"))
                await _send(client, wire.SeatChange(seat=seat, holder=holder, clients=clients))
        verdict = self.robot.obey(message)
        if verdict:
            await _send(socket, verdict)

    async def _camera_socket(self, socket: WebSocket) -> None:
        await socket.accept()
        frame = 0
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                frame += 1
                image, mask = camera_packets(frame, time.time() * 1000)
                await socket.send_bytes(image)
                if socket.query_params.get("mask") == "1":
                    await socket.send_bytes(mask)
                await socket.receive_text()
                await asyncio.sleep(1 / PICTURES_HZ)

    def _fixed(self, name: str) -> Any:
        async def answer(request: Request) -> Response:
            if request.method == "PATCH":
                return await self._write(request)
            return _answer(field() if name == "field" else self.answers[name])

        return answer

    async def _write(self, request: Request) -> Response:
        path = request.path_params.get("path") or request.url.path.removeprefix("/api/v1/")
        self.requests.append(f"{request.method} {path}")
        if request.method == "GET":
            if path in self.written:
                return JSONResponse(self.written[path])
            return _answer(wire.Problem(error=f"There is no {path}."), 404)
        body = await request.body()
        data = json.loads(body) if body else None
        self.written[path] = data
        if path.startswith("panels/"):
            return _answer(wire.PanelReply(text="heard"))
        if path == "plan":
            return _answer(fake_answers.plan())
        if path == "settings":
            return _answer(wire.SettingsReply(applied=data or {}, refused={}))
        return Response(status_code=204)

    async def _preview_goal(self, request: Request) -> Response:
        if self.refused_goal:
            return _answer(wire.Problem(error=self.refused_goal), 409)
        goal = msgspec.json.decode(await request.body(), type=wire.GoalPlace)
        return _answer(fake_answers.way(self.robot.pose()[:2], (goal.x_map_m, goal.y_map_m)))

    async def _tile(self, _: Request) -> Response:
        return Response(fake_answers.TILE, media_type="image/png")

    async def _urdf(self, _: Request) -> Response:
        text = (SOURCE / "description" / "urdf" / "agribot.urdf").read_text()
        return Response(
            text.replace("package://agribot_description/", ""), media_type="application/xml"
        )


async def _send(socket: WebSocket, message: wire.ServerMessage) -> None:
    await socket.send_text(wire.encode(message).decode())


def _answer(value: object, status: int = 200) -> Response:
    return Response(msgspec.json.encode(value), status, media_type="application/json")


async def _import_field(request: Request) -> Response:
    name, field = request.query_params["filename"], request.query_params["field"]
    root = read_field_file(name, await request.body())
    names = {"fields": list_fields(root)} if len(list_fields(root)) > 1 else {}
    return JSONResponse({**(keep_field(root, field, name) if field else root), **names})


async def _export_field(request: Request) -> Response:
    return Response(write_field_file(request.query_params["format"], await request.json()))


async def _import_view(request: Request) -> Response:
    return JSONResponse(displays_of(await request.body()))


async def _export_view(request: Request) -> Response:
    told = await request.json()
    return Response(config_of(told["displays"], told["view"]))


async def _with_policy(request: Request, call_next: RequestResponseEndpoint) -> Response:
    response = await call_next(request)
    response.headers["content-security-policy"] = POLICY
    return response


@contextlib.contextmanager
def serving(server: FakeServer, port: int = 0) -> Any:
    """Serve in a thread; yields the address."""
    config = uvicorn.Config(
        server.app(),
        host="127.0.0.1",
        port=port,
        log_level="error",
        ws="websockets-sansio",
        timeout_graceful_shutdown=1,
    )
    runner = uvicorn.Server(config)
    thread = threading.Thread(target=runner.run, daemon=True)
    thread.start()
    while not runner.started:
        time.sleep(0.02)
    yield f"http://127.0.0.1:{runner.servers[0].sockets[0].getsockname()[1]}"
    runner.should_exit = True
    thread.join()


if __name__ == "__main__":
    weeds = int(sys.argv[2]) if len(sys.argv) > 2 else 400
    server = FakeServer(weeds, state_hz=STATE_HZ)
    with serving(server, int(sys.argv[1])), contextlib.suppress(KeyboardInterrupt):
        threading.Event().wait()
