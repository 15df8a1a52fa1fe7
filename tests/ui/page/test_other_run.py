"""The robot's program ends and another one begins at the address of a page that is open."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
from playwright.sync_api import BrowserContext, Page, expect

from agribot.ui import wire
from agribot.ui.address import Address
from tests import nightly
from tests.ui.conftest import Robot
from tests.ui.page.conftest import WITHOUT_GL, take_control, until
from tests.ui.page.fake_robot import FakeRobot

EVERYWHERE = "0.0.0.0"
SAVE = "fetch('/api/v1/settings', {method: 'PATCH', body: '{}'}).then((answer) => answer.status)"


@contextmanager
def served(home: Path, track: int, host: str = "127.0.0.1", port: int = 0) -> Iterator[Robot]:
    """A robot with this many points driven."""
    robot = Robot(home, Address(host=host, port=port))
    robot.answers[wire.ListPanels] = []
    robot.start()
    tell(robot, track)
    try:
        yield robot
    finally:
        robot.server.close()


def tell(robot: Robot, track: int) -> None:
    robot.say(wire.TracePiece(points_map_m=[(float(i), 5.0) for i in range(track)]))
    state = FakeRobot().state(time.monotonic() * 1e3)
    robot.say(msgspec.structs.replace(state, mode="paused"))


def opened(context: BrowserContext, robot: Robot, query: str = "") -> Page:
    context.request.get(f"http://127.0.0.1:{robot.port}/?{query}")  # the link with the token
    page = context.new_page()
    page.goto(f"http://127.0.0.1:{robot.port}/?{WITHOUT_GL}#/drive")
    until(page, "window.__agribot?.ready")
    page.evaluate("window.isOld = true")
    return page


@nightly.by_day(
    "tests/ui/page/test_other_run.py"
    "::test_a_stop_that_was_pressed_meanwhile_reaches_the_next_run_before_the_page_is_loaded_anew"
)
def test_a_page_of_a_run_that_ended_is_loaded_anew_for_the_next_one_and_may_command_it(
    context: BrowserContext, tmp_path: Path
) -> None:
    with served(tmp_path / "first", track=70) as first:
        page = opened(context, first)
        until(page, "window.__agribot.counters.traj === 70")
    with served(tmp_path / "next", track=3, port=first.port):
        until(page, "!window.isOld && window.__agribot?.ready")
        until(page, "window.__agribot.counters.traj === 3")
        take_control(page)
        assert page.evaluate(SAVE) == 200


def test_a_stop_that_was_pressed_meanwhile_reaches_the_next_run_before_the_page_is_loaded_anew(
    context: BrowserContext, tmp_path: Path
) -> None:
    with served(tmp_path / "first", track=70) as first:
        page = opened(context, first)
    expect(page.locator(".banner.bad").first).to_be_visible()
    page.locator("#stop").click()
    with served(tmp_path / "next", track=3, port=first.port) as robot:
        robot.wait_for_request("stop")
        until(page, "!window.isOld && window.__agribot?.ready")
        until(page, "window.__agribot.counters.traj === 3")
        take_control(page)
        assert page.evaluate(SAVE) == 200


@nightly.by_day(
    "tests/ui/page/test_first_answer.py"
    "::test_who_has_not_logged_in_sees_no_stop_that_stops_nothing_and_is_turned_away_once",
    "tests/ui/test_restart.py"
    "::test_pages_know_the_run_again_behind_another_server_and_another_run_from_it",
)
def test_a_page_on_the_network_asks_for_the_token_of_the_next_run(
    context: BrowserContext, tmp_path: Path
) -> None:
    with served(tmp_path / "first", 70, EVERYWHERE) as first:
        page = opened(context, first, f"token={first.address.operator_token}")
    with served(tmp_path / "next", 3, EVERYWHERE, first.port) as robot:
        page.get_by_label("Access token").fill(robot.address.operator_token)
        page.get_by_role("button", name="Open").click()
        until(page, "window.__agribot?.ready && window.__agribot.counters.traj === 3")


@nightly.one_by_one("host", [EVERYWHERE, "127.0.0.1"], 1)
def test_a_page_stays_as_it_is_when_the_server_of_its_run_is_started_again(
    context: BrowserContext, tmp_path: Path, host: str
) -> None:
    with served(tmp_path, 70, host) as robot:
        page = opened(context, robot, f"token={robot.address.operator_token}")
        pid = robot.server.process.pid
        assert pid is not None
        robot.orders.clear()
        os.kill(pid, signal.SIGKILL)
        robot.wait_for(wire.Ready)
        tell(robot, 71)
        until(page, "window.__agribot.counters.traj === 71")
        take_control(page)
        assert page.evaluate(SAVE) == 200
        assert page.evaluate("window.isOld")
