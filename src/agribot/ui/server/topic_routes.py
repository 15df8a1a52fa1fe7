"""Topics that displays of the map look at: what there is, and what is new of those on show."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from agribot.ui import wire
from agribot.ui.server.answers import Unusable, channel_of, json_answer, read_body
from agribot.ui.server.hub import Hub
from agribot.ui.server.off_the_loop import run_in_thread
from agribot.ui.server.replay import Replay
from agribot.ui.server.topic_sources import TopicSources

MOST_WISHES = 64


async def list_topics(request: Request) -> Response:
    sources = find_sources(request)
    return json_answer(await run_in_thread(sources.list_all, _find_replay(request)))


async def read_topics(request: Request) -> Response:
    wishes = (await read_body(request, wire.TopicWishes)).topics
    if len(wishes) > MOST_WISHES:
        raise Unusable(422, f"{len(wishes)} topics; ask for at most {MOST_WISHES} at a time")
    sources = find_sources(request)
    return json_answer(await run_in_thread(sources.read, wishes, _find_replay(request)))


def find_sources(request: Request) -> TopicSources:
    hub: Hub = request.app.state.hub
    return hub.find_topics()


def _find_replay(request: Request) -> Replay | None:
    channel = channel_of(request)
    return channel if isinstance(channel, Replay) else None


ROUTES = (
    ("GET", "/api/v1/ros/topics", list_topics),
    ("POST", "/api/v1/ros/topics/read", read_topics),
)
