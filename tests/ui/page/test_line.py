"""A line that is held, and a recording in the robot's place: what the page then shows and does."""

from __future__ import annotations

import itertools
import re
import shutil
import time
from pathlib import Path
from urllib.parse import urlparse

import msgspec
import numpy as np
import pytest
from playwright.sync_api import BrowserContext, Page, expect

from agribot.core import config
from agribot.record.recorder import RunRecorder
from agribot.ui import wire
from agribot.ui.robot_side.feed import pack_pixels
from tests.record import record_samples as samples
from tests.ui.conftest import Robot
from tests.ui.messages import make_weed
from tests.ui.page.conftest import WITHOUT_GL, arm, drag_pad, show, take_control, until
from tests.ui.page.fake_robot import FakeRobot
from tests.ui.page.fake_server import FakeServer
from tests.ui.slow_line import SlowLine
from tests.waiting import wait_for

SHOWN = """[window.__agribot.counters.traj, window.__agribot.counters.weeds,
    window.__agribot.field()?.rows.length].join()"""


def open_through(line: SlowLine, context: BrowserContext, screen: str) -> Page:
    page = context.new_page()
    page.goto(f"http://127.0.0.1:{line.port}/?{WITHOUT_GL}#/{screen}")
    until(page, "window.__agribot?.ready")
    return page


def test_a_line_that_falls_silent_is_red_lets_go_of_the_hand_and_leaves_no_stop_unsaid(
    context: BrowserContext, server: FakeServer
) -> None:
    server.robot.mode = "paused"
    with SlowLine(int(urlparse(server.address).port or 0)) as line:
        page = open_through(line, context, "teleop")
        take_control(page)
        arm(page)
        drag_pad(page)
        link = page.locator(".chip", has_text="Link")
        unconfirmed = page.locator(".banner.bad", has_text="STOP is not confirmed")
        with line.held():
            expect(page.locator(".banner.bad", has_text="No answer from the robot")).to_be_visible()
            expect(link).to_have_attribute("data-tone", "bad")
            expect(page.locator(".pad.armed")).to_have_count(0)
            page.mouse.up()
            page.locator("#stop").click()
            expect(unconfirmed).to_be_visible()
            expect(page.locator(".banner.bad", has_text="No link to the robot")).to_be_visible()
        expect(page.locator(".banner.bad", has_text="Stopped")).to_be_visible()
        expect(unconfirmed).to_be_hidden()
        expect(link).to_have_attribute("data-tone", "good")


def test_the_age_is_that_on_the_robot_where_states_are_late_on_their_way(
    context: BrowserContext, server: FakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = context.new_page()
    page.goto(f"{server.address}/?{WITHOUT_GL}#/drive")
    until(page, "window.__agribot?.ready")
    expect(page.locator("#main")).to_have_class("main")
    made = FakeRobot.state

    def late(robot: FakeRobot, mono_ms: float) -> wire.State:
        return made(robot, mono_ms - 23_000.0)

    monkeypatch.setattr(FakeRobot, "state", late)
    seconds = re.compile(r"What you see is 2\d")
    expect(page.locator(".banner.bad", has_text=seconds)).to_be_visible()
    age = page.locator(".chip", has_text="Age")
    expect(age.locator(".chip-value")).to_have_text(re.compile(r"^2\d\.\d s$"))
    expect(age).to_have_attribute("data-tone", "bad")


def test_a_recording_takes_the_place_of_the_robot_on_the_page_and_gives_it_back(
    context: BrowserContext, robot: Robot, recorded: Path
) -> None:
    robot.answers[wire.ListPanels] = []
    shutil.copytree(recorded, robot.home / "runs" / "recorded")
    robot.say(wire.WeedChanges(set=[make_weed(id) for id in range(3)]))
    robot.say(wire.TracePiece(points_map_m=[(float(i), 5.0) for i in range(700)]))

    def live(tick: int, mode: wire.Mode, stop: str) -> None:
        made = FakeRobot().state(time.monotonic() * 1e3)
        robot.say(msgspec.structs.replace(made, tick=tick, mode=mode, stop=stop))

    live(1, "mission", "")
    page = context.new_page()
    page.goto(f"http://127.0.0.1:{robot.port}/?{WITHOUT_GL}#/recordings")
    until(page, "window.__agribot?.ready")
    until(page, f"{SHOWN} === '700,3,6'")
    for turn in range(2):
        page.get_by_role("button", name="Replay").first.click()
        until(page, "window.__agribot.state()?.replay?.name === 'recorded'")
        until(page, f"{SHOWN}.endsWith(',0,0')")
        assert 0 < page.evaluate("window.__agribot.counters.traj") < 700
        expect(page.locator(".banner.note")).to_contain_text("Replay of recorded")
        if turn == 0:
            page.locator("#stop").click()
            robot.wait_for_request("stop")
            expect(page.locator(".banner.bad", has_text="not confirmed")).to_be_visible()
            live(2, "stopped", "stopped by operator 1")
            expect(page.locator(".banner.bad", has_text="The robot itself is held")).to_be_visible()
            expect(page.locator(".banner.bad", has_text="not confirmed")).to_be_hidden()
        page.get_by_role("button", name="Back to live").click()
        until(page, f"{SHOWN} === '700,3,6'")
        expect(page.locator(".banner.note")).to_be_hidden()
    show(page, "drive")
    wait_for(lambda: page.evaluate("!window.__agribot.state().replay"), "the robot's own state")


INKED = """(canvas) => {
  const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height)
  return data.some((value) => value > 0)
}"""


def test_no_picture_of_the_robot_stays_on_the_screen_when_a_recording_is_shown(
    context: BrowserContext, robot: Robot, recorded: Path
) -> None:
    robot.answers[wire.ListPanels] = []
    shutil.copytree(recorded, robot.home / "runs" / "without-pictures")
    page = context.new_page()
    robot.say(FakeRobot().state(time.monotonic() * 1e3))
    page.goto(f"http://127.0.0.1:{robot.port}/?{WITHOUT_GL}#/camera")
    until(page, "window.__agribot?.ready")
    image, mask = page.locator("canvas").first, page.locator("canvas.mask")
    numbers = itertools.count(1)

    def is_shown() -> bool:
        number = next(numbers)
        pixels = np.full((48, 64, 3), 120, np.uint8)
        robot.server.camera_link.send_bytes(
            pack_pixels(1, number, 5.0, np.zeros((48, 64), np.uint8))
        )
        robot.server.camera_link.send_bytes(pack_pixels(0, number, 5.0, pixels))
        return bool(image.evaluate(INKED) and mask.evaluate(INKED))

    wait_for(is_shown, "a picture of the robot with its mask")
    choose = "(name) => fetch('/api/v1/replay', {method: 'POST', body: JSON.stringify({name})})"
    page.evaluate(choose, "without-pictures")
    expect(page.locator(".banner.note")).to_contain_text("Replay of without-pictures")
    assert not image.evaluate(INKED) and not mask.evaluate(INKED)
    expect(page.locator(".picture-label")).to_have_text("no picture")
    page.evaluate(choose, None)
    wait_for(is_shown, "the robot's picture after the recording")


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """Of a robot on a field without rows, without weeds, and with another track."""
    run = tmp_path / "recorded"
    run.mkdir()
    recorder = RunRecorder(run / "run.mcap", config.load("farm"), samples.robot(), samples.URDF)
    for record in samples.ticks(150):
        recorder(record)
    recorder.close()
    return run
