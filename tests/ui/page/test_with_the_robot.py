"""The page on the real server and the simulated robot: what an operator does, and what comes of it.

One robot serves all tests of this file; each brings it into the state that it needs. Those on its
recording end it, and so stand last.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect
from playwright.sync_api import TimeoutError as NotThere

from agribot.core.messages import WHEEL_NAMES, TickRecord
from agribot.record.replay import read_ticks
from tests import nightly
from tests.ui.page.conftest import (
    LEFT_SHOULDER,
    PLUG_IN,
    SCREENS,
    UNPLUG,
    WITHOUT_GL,
    drag_pad,
    hold,
    new_context,
    show,
    take_control,
    until,
    wait_for_toast,
)
from tests.ui.page.robots import Robot, robot_with_page
from tests.ui.page.test_calibration import calibrate, stop_calibrating
from tests.ui.page.test_receiver_card import card_of, fact
from tests.waiting import wait_for

SETTINGS = ["--set", "perception.enabled=false", "--set", "seed=1"]
WHEEL_RADIUS_M = 0.15
STANDING_MPS = 0.03
STANDS_WITHIN_S = 0.5
HANG = "() => { const end = performance.now() + 1500; while (performance.now() < end); }"
LET_GO = "test_the_wheels_stand_soon_after_the_last_request_of_a_hand"
STATE = "window.__agribot.state()"
WAYS = ("cut link", "release", "blur", "hung tab", "gamepad gone")
BEFORE_THE_START = re.compile(r"Before the start: all \d+ good")
IS_STILL = f"Math.abs({STATE}.v_mps) < 0.02"
BY_HAND = f"{STATE}.mode === 'teleop'"


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    out_dir = tmp_path_factory.mktemp("runs") / "run"
    with robot_with_page("farm", out_dir, SETTINGS) as robot:
        yield robot


@pytest.fixture(scope="module")
def context(browser: Browser) -> Iterator[BrowserContext]:
    context = new_context(browser, viewport={"width": 1280, "height": 800}, locale="en")
    yield context
    context.close()


@pytest.fixture(scope="module")
def asked(context: BrowserContext) -> list[str]:
    """Every address that a page of this file asks for."""
    urls: list[str] = []
    context.on("request", lambda request: urls.append(request.url))
    return urls


@pytest.fixture(scope="module")
def page(context: BrowserContext, robot: Robot, asked: list[str]) -> Page:
    page = context.new_page()
    page.goto(f"{robot.address}/?{WITHOUT_GL}#/drive")
    until(page, "window.__agribot?.ready")
    return page


def in_charge(page: Page, screen: str = "drive") -> None:
    """The page has the seat, and no stop holds the robot."""
    if "You" not in page.locator(".operator").inner_text():
        show(page, "drive")  # not every screen has a button that takes it
        take_control(page)
    if page.evaluate(f"{STATE}.stop"):
        page.get_by_role("button", name="Release stop").click()
        until(page, f"!{STATE}.stop")
    show(page, screen)


def on_its_mission(page: Page) -> None:
    """It drives, also where it pauses a moment late because a page had left it."""
    in_charge(page)
    resume = page.locator("[data-action=resume]")

    def drives() -> bool:
        if page.evaluate(f"{STATE}.mode") == "paused":
            with contextlib.suppress(NotThere):  # it has gone on meanwhile
                resume.click(timeout=1000)
        return bool(page.evaluate(f"{STATE}.mode === 'mission' && {STATE}.v_mps > 0.1"))

    wait_for(drives, "the robot to be on its mission")


def test_the_robot_drives_its_mission_and_the_page_shows_it(page: Page) -> None:
    until(page, f"{STATE}.mode === 'mission' && {STATE}.v_mps > 0.1")
    expect(page.locator(".mode")).to_have_text("On mission")
    expect(page.locator(".facts")).to_contain_text("– of 6 (0 done)")
    east_m = page.evaluate(f"{STATE}.pose[0]")
    until(page, f"Math.hypot({STATE}.pose[0] - {east_m}, {STATE}.pose[1]) > 0")
    assert page.evaluate(f"{STATE}.pos_std_m") < 0.1
    expect(page.locator(".gate-line").get_by_role("status")).to_have_text("Driving")
    expect(page.locator(".start-list")).to_contain_text(BEFORE_THE_START)
    expect(page.locator(".sensors li")).to_have_count(5)
    expect(page.locator(".sensors .doubt")).to_have_count(0)


def test_a_paused_mission_stands_and_goes_on_where_it_was(page: Page) -> None:
    on_its_mission(page)
    page.locator("[data-action=pause]").click()
    until(page, f"{STATE}.mode === 'paused' && {IS_STILL}")
    driven_m = page.evaluate(f"{STATE}.mission.s_m")
    page.locator("[data-action=resume]").click()
    until(page, f"{STATE}.mode === 'mission' && {STATE}.mission.s_m > {driven_m} + 0.2")


@pytest.mark.parametrize("by", ["button", "space"])
def test_a_stop_holds_the_robot_until_it_is_released_and_resumed(page: Page, by: str) -> None:
    on_its_mission(page)
    if by == "button":
        page.locator("#stop").click()
    else:
        page.keyboard.press("Space")
    until(page, f"{STATE}.mode === 'stopped' && {IS_STILL}")
    expect(page.locator(".banner.bad", has_text="Stopped")).to_be_visible()
    page.get_by_role("button", name="Release stop").click()
    until(page, f"{STATE}.mode === 'paused'")
    assert page.evaluate(IS_STILL)


def test_a_reload_keeps_the_screen_and_the_seat(page: Page) -> None:
    in_charge(page, "health")
    page.reload()
    until(page, "window.__agribot?.ready && window.__agribot.screen === 'health'")
    expect(page.locator(".operator")).to_contain_text("You")


def test_a_changed_speed_slows_the_mission(page: Page) -> None:
    on_its_mission(page)
    show(page, "settings")
    speed = page.get_by_label("Speed", exact=True)
    speed.fill("0.2")
    speed.press("Enter")
    until(page, f"{STATE}.signals.at(-1)?.[3] > 0 && {STATE}.signals.at(-1)?.[3] <= 0.21")
    speed.fill("0.4")
    speed.press("Enter")
    until(page, f"{STATE}.signals.at(-1)?.[3] > 0.3")


def test_the_simulated_receiver_is_shown_as_such_with_what_it_gives(page: Page) -> None:
    show(page, "health")
    card = card_of(page)
    expect(card.get_by_text("Simulated")).to_be_visible()
    expect(card.get_by_role("status")).to_have_text("RTK fixed")
    expect(fact(page, "Last fix")).to_contain_text("per second")
    expect(fact(page, "Satellites")).to_have_text("not reported in the simulation")
    expect(card.locator(".sky")).to_be_hidden()


def test_stop_ends_a_calibration_at_once(page: Page) -> None:
    on_its_mission(page)
    page.locator("[data-action=pause]").click()
    until(page, f"{STATE}.mode === 'paused' && {IS_STILL}")
    show(page, "settings")
    calibrate(page, "Motors", f"{STATE}.signals.at(-1)?.[3] > 0.2")
    stop_calibrating(page)


def test_the_page_has_the_listed_screens_in_their_order(page: Page) -> None:
    shown = page.locator("nav a").evaluate_all("links => links.map((a) => a.hash.slice(2))")
    assert shown[: len(SCREENS)] == SCREENS


@pytest.mark.parametrize(
    "query",
    [
        pytest.param(WITHOUT_GL, id="figures"),
        pytest.param(
            "",
            id="map and scene",
            marks=nightly.by_day(
                "test_no_request_leaves_the_robot",
                "tests/ui/page/test_drawing.py::test_nothing_was_kept_or_asked_elsewhere_meanwhile",
            ),
        ),
    ],
)
def test_no_request_leaves_the_robot(
    context: BrowserContext, robot: Robot, asked: list[str], query: str
) -> None:
    with context.new_page() as whole:
        whole.goto(f"{robot.address}/?{query}#/drive")
        drawn = "true" if query else "window.__agribot.map?.loaded()"
        until(whole, f"window.__agribot?.ready && {drawn}")
        for screen in SCREENS:
            show(whole, screen)
    foreign = [url for url in asked if not url.startswith((robot.address, "data:", "blob:"))]
    assert len(asked) > 10
    assert foreign == []


class HandDriven(dict[str, float]):
    """When, in simulated time, the hand was put on the pad for each way of taking it off."""


@pytest.fixture(scope="module")
def hand_driven(page: Page, context: BrowserContext, request: pytest.FixtureRequest) -> HandDriven:
    """Drives by hand on the pad and takes the hand off it in each way that a test looks at."""
    began = HandDriven()
    on_its_mission(page)
    ids = " ".join(item.nodeid for item in request.session.items)
    for let_go in (way for way in WAYS if f"{LET_GO}[{way}]" in ids):
        in_charge(page, "teleop")
        began[let_go] = page.evaluate(f"{STATE}.t_s")
        press = push_gamepad if let_go == "gamepad gone" else drag_pad
        hold(page, drives_by_hand(page), press)
        _take_hand_off(page, context, let_go)
        until(page, IS_STILL)
        page.mouse.up()
        show(page, "drive")
    return began


def push_gamepad(page: Page) -> None:
    found = page.get_by_text("Gamepad: Test pad")
    page.evaluate(UNPLUG)
    expect(found).to_be_hidden()
    page.evaluate(PLUG_IN + "window.__pad.axes[1] = -1;" + LEFT_SHOULDER % "false")
    expect(found).to_be_visible()
    page.evaluate(LEFT_SHOULDER % "true")


def drives_by_hand(page: Page) -> Callable[[], object]:
    """Whether it still does a second after it began; a mission's last motion is over by then."""
    began_s: list[float] = []

    def drives() -> object:
        if not began_s:
            began_s.extend(page.evaluate(f"{BY_HAND} ? [{STATE}.t_s] : []"))
            return False
        return page.evaluate(f"{BY_HAND} && {STATE}.t_s > {began_s[0]} + 1 && {STATE}.v_mps > 0.1")

    return drives


def _take_hand_off(page: Page, context: BrowserContext, how: str) -> None:
    if how == "release":
        page.mouse.up()
    elif how == "gamepad gone":
        page.evaluate(UNPLUG)
    elif how == "blur":
        page.evaluate("window.dispatchEvent(new Event('blur'))")
    elif how == "hung tab":
        page.evaluate(HANG)
    else:
        context.set_offline(True)
        expect(page.locator(".banner.bad", has_text="old")).to_be_visible()
        context.set_offline(False)
        expect(page.locator(".banner.bad", has_text="old")).to_be_hidden()


@pytest.fixture(scope="module")
def ended(hand_driven: HandDriven, robot: Robot) -> Path:
    """The recording of all that, of a robot that was interrupted as by Ctrl-C."""
    assert robot.end() == 130
    return robot.out_dir / "run.mcap"


@pytest.fixture(scope="module")
def ticks(ended: Path) -> list[TickRecord]:
    return list(read_ticks(ended))


def wheel_mps(tick: TickRecord) -> float:
    speeds = (
        [abs(speed) for speed in tick.batch.wheels[-1].speed_radps] if tick.batch.wheels else []
    )
    return WHEEL_RADIUS_M * sum(speeds) / len(WHEEL_NAMES)


@nightly.one_by_one("let_go", WAYS, 1)
def test_the_wheels_stand_soon_after_the_last_request_of_a_hand(
    ticks: list[TickRecord], hand_driven: HandDriven, let_go: str
) -> None:
    later_s = [t_s for t_s in hand_driven.values() if t_s > hand_driven[let_go]]
    end_s = min(later_s, default=ticks[-1].batch.t_s)
    driven = [tick for tick in ticks if hand_driven[let_go] <= tick.batch.t_s < end_s]
    asked_s = [t.batch.t_s for t in driven for hand in t.batch.hand if hand.v_mps]
    by_hand = [tick for tick in driven if tick.batch.t_s >= asked_s[0]]
    moving_s = [t.batch.t_s for t in by_hand if wheel_mps(t) > STANDING_MPS]
    assert max(wheel_mps(tick) for tick in by_hand) > 0.1
    assert moving_s[-1] - asked_s[-1] <= STANDS_WITHIN_S


@nightly.by_day(
    "tests/ui/page/test_line.py"
    "::test_a_recording_takes_the_place_of_the_robot_on_the_page_and_gives_it_back",
    "tests/ui/test_commands_of_the_page.py::test_a_recording_is_shown_without_a_robot",
)
def test_a_replay_says_so_and_commands_nothing(context: BrowserContext, ended: Path) -> None:
    with robot_with_page(str(ended), ended.parent) as player, context.new_page() as page:
        page.goto(f"{player.address}/?{WITHOUT_GL}#/drive")
        until(page, f"window.__agribot?.ready && {STATE}.mode === 'replay'")
        expect(page.locator(".banner", has_text="Replay")).to_be_visible()
        expect(page.locator(".mode")).to_have_text("Replay")
        page.get_by_role("button", name="Take control").first.click()
        wait_for_toast(page, "recording")
        expect(page.locator("[data-action]:visible")).to_have_count(0)
        show(page, "recordings")
        expect(page.get_by_label("Time in the recording")).to_be_visible()
        later_s = page.evaluate(f"{STATE}.t_s")
        until(page, f"{STATE}.t_s > {later_s}")
        assert player.end() == 0
