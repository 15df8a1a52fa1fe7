"""A browser that changes its mind while a recording is read is shown what it chose last."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest
from starlette.requests import Request

from agribot.ui import wire
from agribot.ui.server import run_routes
from agribot.ui.server.access import Caller, Role
from agribot.ui.server.answers import Unusable
from agribot.ui.server.hub import Hub
from agribot.ui.server.replay import Replay
from agribot.ui.server.replays import MAX_REPLAYS
from tests.ui.conftest import Robot


class Shelf:
    """Recordings that take until `let_go` to be read."""

    def __init__(self) -> None:
        self.begun: dict[str, threading.Event] = {}
        self._read: dict[str, threading.Event] = {}

    def read(self, _: Hub, name: str) -> Any:
        self._event(self.begun, name).set()
        self._event(self._read, name).wait()
        progress = wire.ReplayProgress(name=name, t_s=0.0, start_s=0.0, end_s=9.0, speed=1.0)
        return SimpleNamespace(name=name, speed=1.0, progress=progress)

    def let_go(self, name: str) -> None:
        self._event(self._read, name).set()

    async def is_read(self, name: str) -> None:
        await asyncio.to_thread(self._event(self.begun, name).wait)

    def _event(self, events: dict[str, threading.Event], name: str) -> threading.Event:
        return events.setdefault(name, threading.Event())


@pytest.fixture
def shelf(monkeypatch: pytest.MonkeyPatch) -> Shelf:
    shelf = Shelf()
    monkeypatch.setattr(run_routes, "_open", shelf.read)
    return shelf


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Hub]:
    robot = Robot(tmp_path)
    yield Hub(robot._about(robot.port), lambda _: None)
    robot.server.close()


def choose(
    hub: Hub, name: str | None, browser: str = "ann", role: Role = "operator"
) -> asyncio.Task[Any]:
    async def body() -> bytes:
        return msgspec.json.encode({"name": name})

    caller = Caller(session=browser, role=role)
    scope = {"agribot.caller": caller}
    request = SimpleNamespace(app=SimpleNamespace(state=SimpleNamespace(hub=hub)), scope=scope)
    request.body = body

    async def answer() -> Any:
        answer = await run_routes.replay(cast(Request, request))
        return msgspec.json.decode(answer.body, type=wire.Shown)

    return asyncio.create_task(answer())


def shown(hub: Hub, browser: str = "ann") -> str | None:
    replay: Replay | None = hub.replays.find(browser)
    return None if replay is None else replay.name


def test_back_to_live_counts_though_a_recording_is_still_being_read(hub: Hub, shelf: Shelf) -> None:
    async def work() -> None:
        reading = choose(hub, "long")
        await shelf.is_read("long")
        assert (await choose(hub, None)).source == hub.live.source
        shelf.let_go("long")
        assert (await reading).source == hub.live.source
        assert shown(hub) is None

    asyncio.run(work())


def test_of_two_quick_choices_the_last_one_is_shown(hub: Hub, shelf: Shelf) -> None:
    async def work() -> None:
        first = choose(hub, "first")
        await shelf.is_read("first")
        second = choose(hub, "second")
        await shelf.is_read("second")
        shelf.let_go("second")
        assert (await second).replay.name == "second"
        shelf.let_go("first")
        assert (await first).replay.name == "second"
        assert shown(hub) == "second"

    asyncio.run(work())


def test_what_one_browser_chooses_does_not_end_the_wait_of_another(hub: Hub, shelf: Shelf) -> None:
    async def work() -> None:
        reading = choose(hub, "long")
        await shelf.is_read("long")
        await choose(hub, None, "ben")
        shelf.let_go("long")
        assert (await reading).replay.name == "long"
        assert (shown(hub), shown(hub, "ben")) == ("long", None)
        assert not hub.choices

    asyncio.run(work())


class FakePage:
    def __init__(self, hub: Hub, browser: str) -> None:
        self.session, self.channel = f"{browser}/tab", hub.live
        self.said: list[str] = []

    def follow(self, channel: Any) -> None:
        self.channel = channel

    def send(self, message: Any) -> None:
        self.said.append(message.reason)


def test_replays_of_viewers_give_way_to_each_other_and_never_end_an_operators(
    hub: Hub, shelf: Shelf
) -> None:
    async def work() -> None:
        shelf.let_go("mine")
        shelf.let_go("theirs")
        await choose(hub, "mine", "ann")
        for number in range(2 * MAX_REPLAYS):
            await choose(hub, "theirs", f"guest-{number}", "viewer")
        shown_to_guests = [shown(hub, f"guest-{number}") for number in range(2 * MAX_REPLAYS)]
        assert shown(hub, "ann") == "mine"
        assert shown_to_guests == [None] * (MAX_REPLAYS + 1) + ["theirs"] * (MAX_REPLAYS - 1)

    asyncio.run(work())


def test_a_viewer_is_refused_a_replay_that_would_end_an_operators_before_it_is_read(
    hub: Hub, shelf: Shelf
) -> None:
    async def work() -> None:
        shelf.let_go("mine")
        for number in range(MAX_REPLAYS):
            await choose(hub, "mine", f"operator-{number}")
        with pytest.raises(Unusable, match="4 recordings are shown to operators"):
            await choose(hub, "theirs", "guest", "viewer")
        assert "theirs" not in shelf.begun
        assert all(shown(hub, f"operator-{number}") for number in range(MAX_REPLAYS))

    asyncio.run(work())


def test_an_operator_whose_replay_gives_way_to_another_operators_is_told(
    hub: Hub, shelf: Shelf
) -> None:
    async def work() -> None:
        shelf.let_go("mine")
        pages = [FakePage(hub, f"operator-{number}") for number in range(MAX_REPLAYS + 1)]
        hub.sockets.update(pages)
        for number in range(MAX_REPLAYS + 1):
            await choose(hub, "mine", f"operator-{number}")
        assert [page.channel is hub.live for page in pages] == [True] + [False] * MAX_REPLAYS
        assert "gave way to that of another" in pages[0].said[0]
        assert not any(page.said for page in pages[1:])

    asyncio.run(work())
