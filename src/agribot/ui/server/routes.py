"""`/api/v1`: everything slow that a page asks for, and the robot's files."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from agribot.core.errors import AgribotError
from agribot.ui.server import (
    about_routes,
    calibration_routes,
    field_routes,
    frame_routes,
    goal_routes,
    graph_routes,
    health_routes,
    layer_routes,
    map_routes,
    run_routes,
    topic_routes,
)
from agribot.ui.server.answers import Unusable, refuse_request

PARTS = (
    about_routes,
    run_routes,
    field_routes,
    frame_routes,
    goal_routes,
    map_routes,
    health_routes,
    calibration_routes,
    graph_routes,
    layer_routes,
    topic_routes,
)
Endpoint = Callable[[Request], Awaitable[Response]]


def api_routes() -> list[Route]:
    return [
        Route(path, _polite(endpoint), methods=[method])
        for part in PARTS
        for method, path, endpoint in part.ROUTES
    ]


def _polite(endpoint: Endpoint) -> Endpoint:
    """Turn what a person can act on into an answer of one sentence."""

    async def answering(request: Request) -> Response:
        try:
            return await endpoint(request)
        except Unusable as error:
            return error.answer(request)
        except AgribotError as error:
            return refuse_request(422, str(error))
        except RecursionError:
            return refuse_request(400, "this is nested too deeply to be worked with")

    return answering
