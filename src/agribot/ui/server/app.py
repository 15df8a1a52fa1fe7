"""The web application: routes, and the one door that every request comes through."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send

from agribot.ui import wire
from agribot.ui.server.access import Access, Caller, Refusal, make_who
from agribot.ui.server.answers import Unusable, read_body, refuse_request
from agribot.ui.server.camera import Camera, camera_socket
from agribot.ui.server.connection_slots import Slot
from agribot.ui.server.hub import Hub
from agribot.ui.server.languages import language_of
from agribot.ui.server.page_files import page_file
from agribot.ui.server.request_bodies import RequestBodies
from agribot.ui.server.routes import api_routes
from agribot.ui.server.sockets import state_socket

SAFE_HEADERS = [
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (
        b"content-security-policy",
        b"default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
        b"worker-src 'self' blob:; connect-src 'self' blob: data:; frame-ancestors 'none'",
    ),
]
INDEX = "index.html"
LOGIN = "/api/v1/login"
FOR_EVER = "public, max-age=31536000, immutable"
NOT_BUILT = """<!doctype html><html lang="en"><title>AGRIBOT</title>
<h1>The robot answers, but its page is not built</h1>
<p>Build it once with <code>cd web &amp;&amp; npm ci &amp;&amp; npm run build</code>, then load
this page again. The interface for programs works without it.</p></html>"""


class RequestGate:
    """Judges every request before anything else sees it; `agribot.caller` goes into its scope."""

    def __init__(self, app: ASGIApp, hub: Hub) -> None:
        self._app, self._hub = app, hub

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        verdict = self._hub.access.check(
            scope["type"], scope.get("method", "GET"), scope["path"], Headers(scope=scope)
        )
        if isinstance(verdict, Refusal):
            client = scope.get("client") or ("unknown",)
            self._hub.refuse(
                make_who(str(client[0]), None), f"{scope['path'][:80]}: {verdict.reason}"
            )
            await _turn_away(verdict, scope, receive, send)
            return
        scope["agribot.caller"] = verdict
        is_page = scope["type"] == "http"
        if verdict.session or not is_page:
            _slot(scope).identify(verdict.role)
        if is_page:
            send = _with_safe_headers(send, *self._renewal(scope["path"], verdict.cookie))
        await self._app(scope, receive, send)

    def _renewal(self, path: str, cookie: str) -> list[tuple[bytes, bytes]]:
        """Renew a session in use, by answers that no cache keeps and that set no other cookie."""
        if not cookie or not path.startswith("/api/") or path == LOGIN:
            return []
        renewed = _with_cookie(Response(), self._hub.access, cookie)
        return [(b"set-cookie", renewed.headers["set-cookie"].encode("latin-1"))]


def _slot(scope: Scope) -> Slot:
    slot: Slot = scope["state"]["slot"]
    return slot


async def _turn_away(refusal: Refusal, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 4403, "reason": refusal.reason[:120]})
        return
    language = language_of(Request(scope))
    answer = refuse_request(refusal.status, refusal.why, language)
    await answer(scope, receive, _with_safe_headers(send))


def _with_safe_headers(send: Send, *more: tuple[bytes, bytes]) -> Send:
    async def sending(message: Any) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", []), *SAFE_HEADERS, *more]
        await send(message)

    return sending


def build_app(hub: Hub, lifespan: Any) -> ASGIApp:
    routes = [
        WebSocketRoute("/ws/v1", state_socket),
        WebSocketRoute("/ws/cam/main", camera_socket),
        Route(LOGIN, log_in, methods=["POST"]),
        *api_routes(),
        Route("/", front_page),
        Route("/{path:path}", bundled_file),
    ]
    app = Starlette(routes=routes, lifespan=lifespan)
    app.state.hub = hub
    app.state.camera = Camera(hub)
    return RequestGate(RequestBodies(app), hub)


async def log_in(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    try:
        wanted = await read_body(request, wire.Login)
    except Unusable:
        return refuse_request(400, 'send {"token": "…"}')
    session = _session_for(request, wanted.token)
    if isinstance(session, Response):
        return session
    return _with_cookie(Response(status_code=204), hub.access, session)


def _session_for(request: Request, token: str) -> str | Response:
    hub: Hub = request.app.state.hub
    address = request.client.host if request.client else ""
    session = hub.access.login(token, address)
    if isinstance(session, Refusal):
        hub.refuse(make_who(address or "unknown", None), session.reason)
        return refuse_request(session.status, session.why, language_of(request))
    return session


async def front_page(request: Request) -> Response:
    """Serve the page; a token in the address becomes a cookie and leaves the address."""
    hub: Hub = request.app.state.hub
    caller: Caller = request.scope["agribot.caller"]
    token = request.query_params.get("token")
    if token is not None:
        session = _session_for(request, token)
        if isinstance(session, Response):
            return session
        return _with_cookie(RedirectResponse("/", 303), hub.access, session)
    folder = Path(hub.about.page_dir)
    answer = (
        page_file(request, folder, INDEX, "no-cache")
        if (folder / INDEX).is_file()
        else HTMLResponse(NOT_BUILT)
    )
    visit = "" if caller.session else hub.access.visit()
    return _with_cookie(answer, hub.access, visit) if visit else answer


async def bundled_file(request: Request) -> Response:
    """Serve a file of the bundle; those under assets carry their content's hash in the name."""
    hub: Hub = request.app.state.hub
    path = request.path_params["path"]
    life = FOR_EVER if path.startswith("assets/") else "no-cache"
    return page_file(request, Path(hub.about.page_dir), path, life)


def _with_cookie(answer: Response, access: Access, session: str) -> Response:
    answer.set_cookie(
        access.cookie, session, httponly=True, samesite="strict", path="/",
        secure=access.is_encrypted,
    )  # fmt: skip
    return answer
