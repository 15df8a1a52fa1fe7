"""The page before the robot has answered for the first time, and before anybody has logged in."""

from __future__ import annotations

from pathlib import Path

import msgspec
from playwright.sync_api import BrowserContext, Page, Route, expect

from agribot.ui import wire
from tests.ui.page.conftest import WITHOUT_GL, until
from tests.ui.page.fake_server import FakeServer
from tests.ui.page.test_other_run import EVERYWHERE, served
from tests.ui.page.test_safety import STOP_FREE, commands
from tests.waiting import wait_for

SESSION = "**/api/v1/session"


def opened(context: BrowserContext, address: str) -> Page:
    page = context.new_page()
    page.goto(f"{address}/?{WITHOUT_GL}")
    return page


def test_stop_is_there_and_reaches_the_robot_before_its_first_answer(
    context: BrowserContext, server: FakeServer
) -> None:
    context.route(SESSION, lambda _: None)  # the line swallowed the question
    page = opened(context, server.address)
    expect(page.locator("#stop")).to_be_visible()
    assert page.evaluate(STOP_FREE)
    page.keyboard.press("Space")
    wait_for(lambda: commands(server, wire.PressStop), "a stop command")
    expect(page.locator(".banner.bad", has_text="Stopped")).to_be_visible()


def test_a_stop_without_any_line_says_that_it_is_not_confirmed_and_is_sent_on_the_first_one(
    context: BrowserContext, server: FakeServer
) -> None:
    away = [True]
    context.route(SESSION, lambda route: route.abort() if away else route.continue_())
    context.route_web_socket(
        "**/ws/v1*", lambda line: None if away else line.connect_to_server() and None
    )
    page = opened(context, server.address)
    page.locator("#stop").click()
    unconfirmed = page.locator(".banner.bad", has_text="STOP is not confirmed")
    expect(unconfirmed).to_contain_text("Press the red button on the robot.")
    assert not commands(server, wire.PressStop)
    away.clear()
    expect(page.locator(".banner.bad", has_text="Stopped")).to_be_visible()
    expect(unconfirmed).to_be_hidden()
    assert commands(server, wire.PressStop)
    until(page, "window.__agribot?.ready")


def test_a_page_that_only_listens_renews_its_login(
    context: BrowserContext, server: FakeServer
) -> None:
    asked: list[str] = []
    context.on("request", lambda request: asked.append(request.url))
    context.clock.install()
    page = opened(context, server.address)
    until(page, "window.__agribot?.ready")
    asked.clear()
    page.clock.fast_forward("02:00:00")
    wait_for(lambda: any(url.endswith("/api/v1/session") for url in asked), "another question")


def test_a_stop_of_a_page_that_has_a_recording_alone_waits_for_no_robot(
    context: BrowserContext, server: FakeServer
) -> None:
    held: list[Route] = []
    context.route(SESSION, lambda route: held.append(route))  # noqa: PLW0108 - it is inspected
    server.silent = True  # a recording that is shown says nothing of a stop
    page = opened(context, server.address)
    page.locator("#stop").click()
    unconfirmed = page.locator(".banner.bad", has_text="STOP is not confirmed")
    expect(unconfirmed).to_be_visible()
    session = server.answers["session"]
    server.answers["session"] = msgspec.structs.replace(session, source="replay")
    for route in held:
        route.continue_()
    expect(page.locator(".rail")).to_be_visible()
    expect(unconfirmed).to_be_hidden()


def test_who_has_not_logged_in_sees_no_stop_that_stops_nothing_and_is_turned_away_once(
    context: BrowserContext, tmp_path: Path
) -> None:
    tried: list[str] = []
    with served(tmp_path, 3, EVERYWHERE) as robot:
        page = context.new_page()
        page.on("websocket", lambda line: tried.append(line.url))
        page.goto(f"http://127.0.0.1:{robot.port}/?{WITHOUT_GL}")
        token = page.get_by_label("Access token")
        expect(token).to_be_visible()
        expect(page.locator("#stop")).to_be_hidden()
        expect(page.locator(".banner.bad").first).to_be_hidden()
        before = len(tried)
        token.fill("wrong")
        page.get_by_role("button", name="Open").press("Space")
        expect(page.get_by_role("alert").last).to_contain_text("not valid")
        assert len(tried) == before
        token.fill(robot.address.operator_token)
        page.get_by_role("button", name="Open").click()
        until(page, "window.__agribot?.ready")
        expect(page.locator("#stop")).to_be_visible()
        page.locator("#stop").click()
        robot.wait_for_request("stop")
