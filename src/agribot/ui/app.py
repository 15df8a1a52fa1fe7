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

from agribot.ui.access import Access, Caller, Refusal
from agribot.ui.answers import refused, served_file
from agribot.ui.camera import Camera, camera_socket
from agribot.ui.hub import Hub
from agribot.ui.routes import api_routes
from agribot.ui.sockets import state_socket

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
NOT_BUILT = """<!doctype html><html lang="en"><title>AGRIBOT</title>
<h1>The robot answers, but its page is not built</h1>
<p>Build it once with <code>cd web &amp;&amp; npm ci &amp;&amp; npm run build</code>, then load
this page again. The interface for programs works without it.</p></html>"""


class Door:
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
            self._hub.refuse(str(client[0]), f"{scope['path'][:80]}: {verdict.reason}")
            await _turn_away(verdict, scope, receive, send)
            return
        scope["agribot.caller"] = verdict
        is_page = scope["type"] == "http"
        await self._app(scope, receive, _with_safe_headers(send) if is_page else send)


async def _turn_away(refusal: Refusal, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 4403, "reason": refusal.reason[:120]})
        return
    await refused(refusal.status, refusal.reason)(scope, receive, _with_safe_headers(send))


def _with_safe_headers(send: Send) -> Send:
    async def sending(message: Any) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", []), *SAFE_HEADERS]
        await send(message)

    return sending


def build_app(hub: Hub, lifespan: Any) -> ASGIApp:
    routes = [
        WebSocketRoute("/ws/v1", state_socket),
        WebSocketRoute("/ws/cam/main", camera_socket),
        Route("/api/v1/login", log_in, methods=["POST"]),
        *api_routes(),
        Route("/", front_page),
        Route("/{path:path}", page_file),
    ]
    app = Starlette(routes=routes, lifespan=lifespan)
    app.state.hub = hub
    app.state.camera = Camera(hub)
    return Door(app, hub)


async def log_in(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    try:
        token = str((await request.json())["token"])
    except (ValueError, KeyError, TypeError):
        return refused(400, 'send {"token": "…"}')
    caller: Caller = request.scope["agribot.caller"]
    session = hub.access.login(token, caller.session)
    if isinstance(session, Refusal):
        hub.refuse(request.client.host if request.client else "unknown", session.reason)
        return refused(session.status, session.reason)
    return _with_cookie(Response(status_code=204), hub.access, session)


async def front_page(request: Request) -> Response:
    """The page; a token in the address becomes a cookie and leaves the address."""
    hub: Hub = request.app.state.hub
    caller: Caller = request.scope["agribot.caller"]
    token = request.query_params.get("token")
    if token is not None:
        session = hub.access.login(token, caller.session)
        if isinstance(session, Refusal):
            return refused(session.status, session.reason)
        return _with_cookie(RedirectResponse("/", 303), hub.access, session)
    index = Path(hub.about.page_dir) / "index.html"
    answer: Response = (
        Response(index.read_bytes(), media_type="text/html", headers={"cache-control": "no-cache"})
        if index.is_file()
        else HTMLResponse(NOT_BUILT)
    )
    return answer if caller.session else _with_cookie(answer, hub.access, hub.access.visit())


async def page_file(request: Request) -> Response:
    """A file of the bundle; those under assets carry their content's hash in the name."""
    hub: Hub = request.app.state.hub
    path = request.path_params["path"]
    answer = served_file(Path(hub.about.page_dir), path)
    if path.startswith("assets/") and answer.status_code == 200:
        answer.headers["cache-control"] = "public, max-age=31536000, immutable"
    return answer


def _with_cookie(answer: Response, access: Access, session: str) -> Response:
    answer.set_cookie(
        access.cookie, session, httponly=True, samesite="strict", path="/",
        secure=access.is_encrypted,
    )  # fmt: skip
    return answer
