"""The limits one by one: stops, messages, pages, YAML, and work that is kept off the loop."""

from __future__ import annotations

import asyncio
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

pytest.importorskip("starlette")
from starlette.requests import Request

from agribot.core.errors import ConfigError
from agribot.core.facts import TookTooLong
from agribot.core.geo import Datum
from agribot.core.messages import Who
from agribot.ui import small_yaml, wire
from agribot.ui.hand.stick_table import read_table
from agribot.ui.server import about_routes
from agribot.ui.server.access import Caller
from agribot.ui.server.allowance import (
    MAX_BURST,
    MAX_FRAMES_PER_S,
    Allowance,
    FrameAllowance,
)
from agribot.ui.server.answers import Unusable
from agribot.ui.server.channel import Channel
from agribot.ui.server.guesses import FORGET_S, MAX_ADDRESSES, MAX_GUESSES, Guesses
from agribot.ui.server.hub import Hub
from agribot.ui.server.mapviz_config import displays_of
from agribot.ui.server.off_the_loop import run_in_process
from agribot.ui.server.page_slots import MAX_PAGES, MAX_VIEWERS, make_room
from agribot.ui.server.stops import MERGE_S, Stops
from agribot.ui.small_yaml import MAX_BYTES, UnusableYaml, read_yaml
from tests.ui.messages import make_weed
from tests.waiting import PATIENCE_S

ADA = Who("Ada")


def test_the_first_stop_goes_on_at_once_and_a_flood_as_one_more() -> None:
    posted: list[tuple[Who, int]] = []

    async def press() -> None:
        repeated = asyncio.Event()

        def post(who: Who, times: int) -> None:
            posted.append((who, times))
            if times > 1:
                repeated.set()

        button = Stops(post, lambda: 100.0)
        button.press(ADA)
        assert posted == [(ADA, 1)]
        for _ in range(500):
            button.press(Who("flood"))
        assert len(posted) == 1
        await asyncio.wait_for(repeated.wait(), PATIENCE_S)

    asyncio.run(press())
    assert posted == [(ADA, 1), (Who("flood"), 500)]


def test_after_a_stop_is_cleared_the_next_counts_at_once_and_none_from_before() -> None:
    posted: list[Who] = []

    async def press() -> None:
        button = Stops(lambda who, _: posted.append(who), lambda: 100.0)
        button.press(ADA)
        button.press(Who("late"))
        button.clear()
        button.press(Who("Bob"))
        assert posted == [ADA, Who("Bob")]
        await asyncio.sleep(2.0 * MERGE_S)

    asyncio.run(press())
    assert posted == [ADA, Who("Bob")]


def test_messages_are_allowed_in_a_burst_and_then_at_a_rate() -> None:
    allowance = Allowance(100.0)
    assert all(allowance.take(100.0) for _ in range(MAX_BURST))
    assert not allowance.take(100.0)
    assert sum(allowance.take(101.0) for _ in range(2 * MAX_BURST)) == MAX_FRAMES_PER_S


PING, START, EMPTY = b"\x89\x80" + bytes(4), b"\x01\x81" + bytes(5), b"\x00\x80" + bytes(4)
LONG = b"\x81\xfe\xff\xff" + bytes(4 + 0xFFFF)  # a text of 64 kB


@pytest.mark.parametrize("frame", [PING, b"\x8a\x80" + bytes(4), EMPTY, b"\x81\x83" + bytes(7)])
def test_frames_of_every_kind_are_counted_up_to_the_first_above_the_limit(frame: bytes) -> None:
    frames = FrameAllowance(100.0)
    assert frames.find_excess(frame * MAX_BURST, 100.0) is None
    assert frames.find_excess(frame * MAX_FRAMES_PER_S, 101.0) is None
    assert frames.find_excess(frame * 9, 101.0) == len(frame)


def test_frames_are_counted_wherever_the_line_cuts_them() -> None:
    """64 kB count as 65 frames: with the ping before them, seven such pairs are within it."""
    frames, pair = FrameAllowance(100.0), PING + LONG
    assert 7 * 66 < MAX_BURST < 8 * 66
    for at in range(0, 20 * len(pair), 1001):
        piece = (pair * 20)[at : at + 1001]
        end = frames.find_excess(piece, 100.0)
        if end is not None:
            break
    assert at + (end or 0) == 8 * len(pair)


def test_wrong_tokens_of_one_address_are_forgotten_and_never_counted_for_another() -> None:
    guesses = Guesses()
    assert [guesses.is_too_many("a", 0.0) for _ in range(MAX_GUESSES)] == [False] * MAX_GUESSES
    assert guesses.is_too_many("a", FORGET_S - 1.0)
    assert not guesses.is_too_many("b", FORGET_S - 1.0)
    assert not guesses.is_too_many("a", FORGET_S)
    for number in range(2 * MAX_ADDRESSES):
        assert not guesses.is_too_many(f"address {number}", FORGET_S)


class FakePage:
    """A connected page, as far as its place is concerned."""

    def __init__(self, role: str, number: int, heard_s: float) -> None:
        self.role, self.session, self.heard_s = role, f"{role}-{number}/tab", heard_s
        self.is_cut = False

    def cut(self) -> None:
        self.is_cut = True


def crowd(role: str, count: int, heard_s: float = 100.0) -> list[FakePage]:
    return [FakePage(role, number, heard_s + number) for number in range(count)]


def room(pages: list[FakePage], caller: Caller, now_s: float, holder: str = "") -> str:
    hub: Any = SimpleNamespace(sockets=set(pages), seat=SimpleNamespace(holder=holder))
    reason = make_room(cast(Hub, hub), caller, now_s)
    assert len(hub.sockets) == len(pages) - sum(page.is_cut for page in pages)
    return reason


def test_viewers_leave_places_to_operators() -> None:
    viewers = crowd("viewer", MAX_VIEWERS)
    assert room(viewers, Caller(session="v", role="viewer"), 200.0)
    assert not room(viewers, Caller(session="o", role="operator"), 200.0)


def test_an_operator_gets_the_place_of_the_page_that_was_silent_for_longest() -> None:
    pages = crowd("operator", MAX_PAGES)
    asks = Caller(session="new", role="operator")
    assert not room(pages, asks, 300.0, holder=pages[0].session)
    assert [page.is_cut for page in pages] == [False, True] + [False] * (MAX_PAGES - 2)


def test_lively_pages_keep_their_places_but_whoever_has_the_seat_comes_back() -> None:
    pages = crowd("operator", MAX_PAGES, heard_s=1000.0)
    assert room(pages, Caller(session="new", role="operator"), 1000.0)
    assert not any(page.is_cut for page in pages)
    assert not room(pages, Caller(session="ada", role="operator"), 1000.0, holder="ada/tab")
    assert sum(page.is_cut for page in pages) == 1


def test_one_program_with_the_seat_on_all_places_is_refused_another_with_the_reason() -> None:
    pages = [FakePage("operator", 0, 100.0) for _ in range(MAX_PAGES)]
    asks = Caller(session="operator-0", role="operator")
    assert "close one of them" in room(pages, asks, 300.0, holder=pages[0].session)


ALIASES = "".join(f"k{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"k0: &a0 x\n{ALIASES}", "line 1: anchors and aliases"),
        ("teleop:\n  walk: *a", "line 2: anchors and aliases"),
        ("teleop: &a {walk: *a}", "anchors and aliases"),
        ("[" * 500, "deep"),
        ("- " * 500, "deep"),
        ("[" + "1," * 500 + "]", "values"),
        ("#" * (MAX_BYTES + 1), "larger than"),
        ("a: " + "9" * 6000, "digits"),
        ("a: \x00", "zero bytes"),
        ("a: 2001-99-99", "month"),
        ("a: 1\n---\nb: 2", "single document"),
        ("!!bool maybe: 1", "maybe"),
    ],
)
def test_yaml_of_strangers_is_refused_with_the_reason(
    text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(small_yaml, "MAX_NODES", 300)
    with pytest.raises(UnusableYaml, match=words):
        read_yaml(text.encode())
    with pytest.raises(Unusable, match=words):
        displays_of(text.encode())
    table = tmp_path / "teleop.yaml"
    table.write_bytes(text.encode())
    with pytest.raises(ConfigError, match=words):
        read_table(table, 1.0, 0.1)


def test_a_table_without_end_is_not_read_to_its_end() -> None:
    with pytest.raises(ConfigError, match="larger than"):
        read_table(Path("/dev/zero"), 1.0, 0.1)


def test_infinity_in_a_view_is_left_out_and_named() -> None:
    text = "displays: [{type: mapviz_plugins/gps, name: x, config: {buffer_size: .inf}}]"
    found = displays_of(text.encode())
    assert "buffer_size" in found["left_out"][0]["why"]


def test_work_that_takes_too_long_is_ended() -> None:
    async def wait() -> None:
        await run_in_process(time.sleep, 3600.0, timeout_s=0.5, what="view")

    with pytest.raises(Unusable) as refusal:
        asyncio.run(wait())
    assert (refusal.value.status, refusal.value.reason) == (504, TookTooLong("view", 0.5))


def test_the_loop_goes_on_while_a_weed_map_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    channel = Channel("sim")
    channel.weeds = {number: make_weed(number) for number in range(3)}
    origin = SimpleNamespace(datum=wire.DatumPlace(lat_deg=21.0, lon_deg=72.0))
    hub = SimpleNamespace(about=SimpleNamespace(field=origin), channel_of=lambda _: channel)
    scope = {
        "type": "http", "app": SimpleNamespace(state=SimpleNamespace(hub=hub)),
        "agribot.caller": Caller(session="x", role="viewer"),
    }  # fmt: skip
    loop_went_on, write = threading.Event(), about_routes._geojson

    def write_when_loop_went_on(weeds: list[wire.Weed], datum: Datum) -> bytes:
        assert loop_went_on.wait(PATIENCE_S)
        return write(weeds, datum)

    async def ask() -> bytes:
        answer = asyncio.create_task(about_routes.weeds_geojson(Request(scope)))
        await asyncio.sleep(0.05)
        assert not answer.done()
        loop_went_on.set()
        return bytes((await answer).body)

    monkeypatch.setattr(about_routes, "_geojson", write_when_loop_went_on)
    assert asyncio.run(ask()).count(b'"Point"') == 3
