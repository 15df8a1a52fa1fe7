"""Calibrations: what there is, start, cancel, accept, undo; the robot's program does them."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from agribot.core.facts import NoRobotShown
from agribot.ui import wire
from agribot.ui.server.answers import (
    Unusable,
    ask_robot,
    json_answer,
    need_operator,
    need_seat,
    read_body,
    who_asks,
)
from agribot.ui.server.hub import Hub


async def calibrations(request: Request) -> Response:
    return await _calibrate(request, "look")


async def start(request: Request) -> Response:
    need_seat(request)
    wanted = await read_body(request, wire.CalibrationStart)
    return await _calibrate(request, "start", wanted.kind)


async def cancel(request: Request) -> Response:
    """Needs no seat: what it does is to stop."""
    need_operator(request)
    return await _calibrate(request, "cancel")


async def accept(request: Request) -> Response:
    need_seat(request)
    return await _calibrate(request, "accept")


async def undo(request: Request) -> Response:
    need_seat(request)
    return await _calibrate(request, "undo")


async def _calibrate(request: Request, action: wire.CalibrationAction, name: str = "") -> Response:
    """Ask the wizard of the robot.

    Raises: Unusable: no robot is there, or it refuses.
    """
    hub: Hub = request.app.state.hub
    if not hub.has_robot:
        raise Unusable(409, NoRobotShown())
    question = wire.Calibrate(action=action, name=name, by=who_asks(request).name)
    return json_answer(await ask_robot(request, question, wire.Calibrations))


ROUTES = (
    ("GET", "/api/v1/calibrations", calibrations),
    ("POST", "/api/v1/calibrations/start", start),
    ("POST", "/api/v1/calibrations/cancel", cancel),
    ("POST", "/api/v1/calibrations/accept", accept),
    ("POST", "/api/v1/calibrations/undo", undo),
)
