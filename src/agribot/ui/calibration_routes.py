"""Calibrations: what there is, start, cancel, accept, undo; the robot's program does them."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from agribot.ui.answers import (
    Unusable,
    asked_of_robot,
    json_answer,
    json_body,
    name_of,
    need_operator,
    need_seat,
)
from agribot.ui.hub import Hub


async def calibrations(request: Request) -> Response:
    return await _asked(request, "look")


async def start(request: Request) -> Response:
    need_seat(request)
    kind = str((await json_body(request)).get("kind", ""))
    return await _asked(request, "start", kind)


async def cancel(request: Request) -> Response:
    """Needs no seat: what it does is to stop."""
    need_operator(request)
    return await _asked(request, "cancel")


async def accept(request: Request) -> Response:
    need_seat(request)
    return await _asked(request, "accept")


async def undo(request: Request) -> Response:
    need_seat(request)
    return await _asked(request, "undo")


async def _asked(request: Request, what: str, kind: str = "") -> Response:
    """Raises: Unusable: no robot is there, or it refuses."""
    hub: Hub = request.app.state.hub
    if not hub.has_robot:
        raise Unusable(409, "no robot runs here; nothing can be calibrated")
    values = {"do": what, "kind": kind, "by": name_of(request)}
    return json_answer(await asked_of_robot(request, "calibration", values))


ROUTES = (
    ("GET", "/api/v1/calibrations", calibrations),
    ("POST", "/api/v1/calibrations/start", start),
    ("POST", "/api/v1/calibrations/cancel", cancel),
    ("POST", "/api/v1/calibrations/accept", accept),
    ("POST", "/api/v1/calibrations/undo", undo),
)
