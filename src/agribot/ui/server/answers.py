"""Answers that many routes give: an error in one sentence, a file from inside one folder."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from agribot.core.fact_text import render
from agribot.core.facts import Fact, NoAnswer, SeatNeeded, ViewerOnly
from agribot.core.messages import Who
from agribot.ui import wire
from agribot.ui.server.access import Caller, make_who
from agribot.ui.server.channel import Channel
from agribot.ui.server.hub import ANSWER_S, Hub, NotWanted
from agribot.ui.server.languages import language_of

T = TypeVar("T")
NO_STORE = {"cache-control": "no-store"}


class Unusable(Exception):
    """The request cannot be used: `status` and one sentence, or a fact, for who sent it."""

    def __init__(self, status: int, reason: str | Fact) -> None:
        super().__init__(render(reason) if isinstance(reason, Fact) else reason)
        self.status, self.reason = status, reason

    def __reduce__(self) -> tuple[type[Unusable], tuple[int, str | Fact]]:
        return Unusable, (self.status, self.reason)

    def answer(self, request: Request) -> Response:
        return refuse_request(self.status, self.reason, language_of(request))


def json_answer(value: object, status: int = 200) -> Response:
    data = msgspec.json.encode(value)
    return Response(data, status, media_type="application/json", headers=NO_STORE)


def refuse_request(status: int, reason: str | Fact, language: str = "en") -> Response:
    text = render(reason, language) if isinstance(reason, Fact) else reason
    return json_answer(wire.Problem(error=text), status)


def served_file(folder: Path, name: str, download: str | None = None) -> Response:
    """Find a file somewhere below `folder`, never one outside it, whatever the name says."""
    path = inside(folder, name)
    if path is None or not path.is_file():
        return refuse_request(404, f"no file '{name[:80]}' here")
    return FileResponse(path, filename=download)


def inside(folder: Path, name: str) -> Path | None:
    """`folder / name` with links followed, or None when that leads out of the folder."""
    if "\0" in name:
        return None
    root = folder.resolve()
    try:
        path = (root / name).resolve()
    except (OSError, RuntimeError):
        return None
    return path if path.is_relative_to(root) and path != root else None


async def read_body(request: Request, type: type[T], status: int = 400) -> T:
    """Read the body of a request.

    Raises: Unusable: no JSON, or (with `status`) not of this type.
    """
    data = await request.body() or b"{}"
    try:
        return msgspec.json.decode(data, type=type)
    except msgspec.ValidationError as error:
        raise Unusable(status, f"the request is not usable: {error}; correct it") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise Unusable(400, f"not JSON: {error}; send JSON") from error
    except RecursionError as error:
        raise Unusable(400, "JSON is nested too deeply to be read; send less") from error


def need_seat(request: Request) -> None:
    """Refuse a caller who does not have the seat.

    Raises: Unusable: the caller may look on, but another one has the seat, or none.
    """
    hub: Hub = request.app.state.hub
    caller: Caller = request.scope["agribot.caller"]
    need_operator(request)
    session, _, _ = hub.seat.holder.partition("/")
    if not caller.session or session != caller.session:
        raise Unusable(409, SeatNeeded())


def need_operator(request: Request) -> None:
    """Refuse a caller who is no operator.

    Raises: Unusable: a viewer changes nothing.
    """
    caller: Caller = request.scope["agribot.caller"]
    if caller.role != "operator":
        raise Unusable(403, ViewerOnly())


def is_robot_shown(request: Request) -> bool:
    """Whether the caller's pages look at a robot that runs, not at a recording or a description."""
    hub: Hub = request.app.state.hub
    return channel_of(request) is hub.live and hub.has_robot


async def ask_robot(request: Request, question: wire.Question, type: type[T]) -> T:
    """Ask the robot's program.

    Raises: Unusable: it does not answer, cannot, or says why it does not want to.
    """
    hub: Hub = request.app.state.hub
    try:
        return await hub.ask(question, type)
    except TimeoutError as error:
        raise Unusable(504, NoAnswer(ANSWER_S)) from error
    except LookupError as error:
        raise Unusable(502, hub.explain(error)) from error
    except NotWanted as error:
        raise Unusable(409, error.fact) from error


def channel_of(request: Request) -> Channel:
    """Find what the caller's pages look at: the robot, or a recording that is replayed."""
    hub: Hub = request.app.state.hub
    caller: Caller = request.scope["agribot.caller"]
    return hub.channel_of(caller.session)


def who_asks(request: Request) -> Who:
    """Find who the caller is, by the name of its open page."""
    hub: Hub = request.app.state.hub
    caller: Caller = request.scope["agribot.caller"]
    for socket in hub.sockets:
        if caller.session and socket.session.startswith(f"{caller.session}/"):
            return make_who(socket.name, caller.role)
    return make_who(str(caller.role), caller.role)
