"""STOP, driving by hand, and what the operator must not overlook."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar
from urllib.parse import parse_qs, urlparse

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from agribot.ui import wire
from tests import nightly
from tests.ui.page.conftest import (
    LEFT_SHOULDER,
    PLUG_IN,
    SCREENS,
    UNPLUG,
    WITHOUT_GL,
    OpenPage,
    arm,
    drag_pad,
    hold,
    show,
    take_control,
    take_seat,
    until,
)
from tests.ui.page.fake_server import FakeServer
from tests.waiting import wait_for

SIZES = [(320, 568), (1024, 600), (390, 844), (820, 1180), (1920, 1080)]  # the first by day
STOP_FREE = """() => {
  const box = document.getElementById('stop').getBoundingClientRect()
  const inside = box.left >= 0 && box.top >= 0
    && box.right <= innerWidth && box.bottom <= innerHeight
  const points = [[.08, .15], [.92, .15], [.5, .5], [.08, .85], [.92, .85]]
  const onTop = points.every(([x, y]) => document.elementFromPoint(
    box.left + x * box.width, box.top + y * box.height)?.closest('#stop'))
  return inside && onTop && box.width >= 110 && box.height >= 48
}"""
# The button's box and the width of what is seen of the page, once it follows that.
STOP_IN_SIGHT = """() => {
  const box = document.getElementById('stop').getBoundingClientRect()
  const {offsetLeft, offsetTop, width, scale} = visualViewport
  const at = [box.left - offsetLeft, box.top - offsetTop, box.right - offsetLeft,
    box.bottom - offsetTop, width].map(each => each * scale)
  return Math.abs(box.width * scale - 148) < 1 && at
}"""
GREY = "grayscale(1) opacity(0.55)"


M = TypeVar("M", bound=wire.Message)


def commands(server: FakeServer, kind: type[M]) -> list[M]:
    return [message for message in server.robot.commands if isinstance(message, kind)]


@contextmanager
def a_dialog(page: Page) -> Iterator[None]:
    """The dialog that every screen has: the operator's seat, at the top."""
    page.locator(".operator").click()
    expect(page.get_by_role("dialog")).to_be_visible()
    yield
    page.get_by_role("button", name="Close").click()
    expect(page.get_by_role("dialog")).to_have_count(0)


@pytest.mark.parametrize(
    ("width", "height"),
    [
        SIZES[0],
        *(
            pytest.param(
                *size, marks=nightly.by_day("test_stop_is_whole_and_uncovered_on_every_screen")
            )
            for size in SIZES[1:]
        ),
    ],
)
def test_stop_is_whole_and_uncovered_on_every_screen(
    open_page: OpenPage, width: int, height: int
) -> None:
    page = open_page()
    page.set_viewport_size({"width": width, "height": height})
    for screen in SCREENS:
        show(page, screen)
        assert page.evaluate(STOP_FREE), f"{screen} at {width}×{height}"
        assert not page.evaluate(
            "document.documentElement.scrollWidth > innerWidth || "
            "document.querySelector('.statusbar').scrollWidth > innerWidth"
        ), f"{screen} is wider than {width}"
        with a_dialog(page):
            assert page.evaluate(STOP_FREE), f"a dialog on {screen} at {width}×{height}"


def test_stop_works_above_a_dialog_without_the_seat(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page()
    page.set_viewport_size({"width": 320, "height": 568})
    page.locator(".operator").click()
    expect(page.get_by_role("dialog")).to_be_visible()
    assert page.evaluate(STOP_FREE)
    page.locator("#stop").click()
    wait_for(lambda: commands(server, wire.PressStop), "a stop command")
    expect(page.locator(".banner.bad", has_text="Stopped")).to_be_visible()


def test_stop_reaches_the_robot_while_the_page_still_waits_for_what_it_is_to_show(
    context: BrowserContext, server: FakeServer
) -> None:
    page = context.new_page()
    page.route("**/api/v1/panels", lambda _: None)  # the line swallowed the question
    page.goto(f"{server.address}/?{WITHOUT_GL}")
    page.locator("#stop").click()
    wait_for(lambda: commands(server, wire.PressStop), "a stop command")
    expect(page.locator(".banner.bad", has_text="Stopped")).to_be_visible()


def test_stop_stays_in_view_and_as_large_on_a_page_that_is_pinched(open_page: OpenPage) -> None:
    page = open_page("health")
    line = page.context.new_cdp_session(page)
    for factor in (2.5, 0.2):
        pinch = {"x": 60, "y": 300, "scaleFactor": factor, "gestureSourceType": "mouse"}
        line.send("Input.synthesizePinchGesture", pinch)
        assert page.evaluate("visualViewport.scale") == pytest.approx(max(1.0, factor), rel=1e-3)
        left, top, right, bottom, width = until(page, STOP_IN_SIGHT)
        assert (right - left, bottom - top) == pytest.approx((148, 56), abs=1)
        assert (top, width - right) == pytest.approx((8, 12), abs=1)


def test_space_stops_everywhere_but_in_a_text_field(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page("settings")
    page.get_by_role("button", name="Dark").focus()
    page.keyboard.press("Space")
    wait_for(lambda: len(commands(server, wire.PressStop)) == 1, "a stop from a focused button")
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    page.locator(".operator").click()
    name = page.get_by_label("Name shown to the others")
    name.fill("Ann")
    name.press("Space")
    expect(name).to_have_value("Ann ")
    assert len(commands(server, wire.PressStop)) == 1


def test_releasing_the_stop_needs_the_seat(open_page: OpenPage, server: FakeServer) -> None:
    page = open_page()
    page.locator("#stop").click()
    release = page.get_by_role("button", name="Release stop")
    expect(page.locator(".banner.bad", has_text="Stopped")).to_be_visible()
    expect(release).to_be_hidden()
    take_control(page)
    release.click()
    expect(page.locator(".mode")).to_have_text("Paused")
    assert len(commands(server, wire.ClearStop)) == 1


def test_the_pad_commands_nothing_before_it_is_armed(
    open_page: OpenPage, server: FakeServer
) -> None:
    server.robot.mode = "paused"
    page = open_page("teleop")
    why_not = page.locator(".why-not")
    place = page.locator(".pad").bounding_box()
    drag_pad(page)
    expect(why_not).to_have_text("Take control first.")
    page.mouse.up()
    expect(why_not).to_have_text("")
    page.keyboard.press("w")
    take_seat(page)
    drag_pad(page)
    expect(why_not).to_have_text('Press "Drive by hand" first.')
    assert page.locator(".pad").bounding_box() == place, "the pad moved under a finger"
    page.mouse.up()
    sent = server.robot.n
    wait_for(lambda: server.robot.n > sent + 6, "six more ticks")
    assert commands(server, wire.DriveByHand) == []


def test_one_press_takes_control_and_arms_the_pad(open_page: OpenPage, server: FakeServer) -> None:
    server.robot.mode = "paused"
    page = open_page("teleop")
    page.get_by_role("button", name="Take control to drive").click()
    expect(page.locator(".pad.armed")).to_be_visible()


def armed(open_page: OpenPage, server: FakeServer) -> Page:
    server.robot.mode = "paused"
    page = open_page("teleop")
    take_control(page)
    arm(page)
    return page


def drives_within(server: FakeServer, limits_mps: list[float]) -> int:
    low, high = limits_mps
    return sum(low < drive.v_mps < high for drive in commands(server, wire.DriveByHand))


def turning(server: FakeServer) -> list[wire.DriveByHand]:
    """The drives that go ahead and turn."""
    return [
        drive
        for drive in commands(server, wire.DriveByHand)
        if drive.v_mps and drive.yaw_rate_radps
    ]


def ends_with_zero(server: FakeServer) -> bool:
    drives = commands(server, wire.DriveByHand)
    return bool(drives) and drives[-1].v_mps == 0 and drives[-1].yaw_rate_radps == 0


@pytest.mark.parametrize("let_go", ["release", "blur", "hidden", "leave"])
def test_whatever_takes_the_hand_off_the_pad_stops_the_robot(
    open_page: OpenPage, server: FakeServer, let_go: str
) -> None:
    page = armed(open_page, server)
    hold(page, lambda: drives_within(server, [0.1, 2.0]) >= 3)
    if let_go == "release":
        page.mouse.up()
    elif let_go == "blur":
        page.evaluate("window.dispatchEvent(new Event('blur'))")
    elif let_go == "hidden":
        page.evaluate(
            "Object.defineProperty(document, 'hidden', {value: true});"
            "document.dispatchEvent(new Event('visibilitychange'))"
        )
    else:
        show(page, "health")
    wait_for(lambda: ends_with_zero(server), "a zero at the end")


def test_keys_drive_while_held_and_steer(open_page: OpenPage, server: FakeServer) -> None:
    page = armed(open_page, server)

    def press(page: Page) -> None:
        page.keyboard.down("w")
        page.keyboard.down("a")

    def let_go(page: Page) -> None:
        page.keyboard.up("a")
        page.keyboard.up("w")

    hold(page, lambda: turning(server), press, let_go)
    drive = turning(server)[-1]
    assert drive.v_mps > 0
    assert drive.yaw_rate_radps > 0
    let_go(page)
    wait_for(lambda: ends_with_zero(server), "a zero at the end")
    stamps_ms = [drive.mono_ms or 0.0 for drive in commands(server, wire.DriveByHand)]
    assert stamps_ms == sorted(set(stamps_ms)), "each is stamped with the robot's clock"


def hold_ahead(page: Page, server: FakeServer) -> None:
    """Hold the key that drives ahead until the robot gets the command."""
    hold(
        page,
        lambda: drives_within(server, [0.1, 2.0]),
        lambda page: page.keyboard.down("w"),
        lambda page: page.keyboard.up("w"),
    )


def test_a_key_that_brings_another_program_lets_go_of_all_keys(
    open_page: OpenPage, server: FakeServer
) -> None:
    """On a Mac, a page does not hear what is let go while Command is held."""
    page = armed(open_page, server)
    hold_ahead(page, server)
    page.keyboard.down("Meta")
    wait_for(lambda: ends_with_zero(server), "a zero at the end")


def test_a_hand_that_held_on_through_a_stop_drives_only_after_a_new_press(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = armed(open_page, server)
    hold_ahead(page, server)
    page.keyboard.press("Space")
    wait_for(lambda: ends_with_zero(server), "a zero at the stop")
    page.get_by_role("button", name="Release stop").click()
    wait_for(lambda: commands(server, wire.ClearStop), "the stop to be cleared")
    sent = server.robot.n
    wait_for(lambda: server.robot.n > sent + 6, "six more ticks")
    assert ends_with_zero(server)


def test_a_gamepad_drives_only_while_its_shoulder_button_is_held(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = armed(open_page, server)
    page.evaluate(PLUG_IN)
    expect(page.get_by_text("Gamepad: Test pad")).to_be_visible()
    page.evaluate("window.__pad.axes[1] = -1; window.__pad.axes[2] = -1")
    sent = server.robot.n
    wait_for(lambda: server.robot.n > sent + 6, "six more ticks")
    assert commands(server, wire.DriveByHand) == []

    def press(page: Page) -> None:
        page.evaluate(LEFT_SHOULDER % "true")

    def let_go(page: Page) -> None:
        page.evaluate(LEFT_SHOULDER % "false")

    hold(page, lambda: turning(server), press, let_go)
    drive = turning(server)[-1]
    assert drive.v_mps == pytest.approx(1.0)
    assert drive.yaw_rate_radps == pytest.approx(1.2)
    let_go(page)
    wait_for(lambda: ends_with_zero(server), "a zero when the button is let go")
    hold(page, lambda: not ends_with_zero(server), press, let_go)
    page.evaluate(UNPLUG)
    wait_for(lambda: ends_with_zero(server), "a zero when the gamepad is gone")


def test_a_gamepad_of_another_layout_drives_only_after_its_axes_were_assigned(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = armed(open_page, server)
    page.evaluate(
        PLUG_IN + "Object.assign(window.__pad, {mapping: '', axes: [0, 0, -1, 0, 0, -1]})"
    )
    expect(page.get_by_text("its layout is not known; assign its axes to drive")).to_be_visible()
    page.evaluate("window.__pad.axes[1] = -1;" + LEFT_SHOULDER % "true")
    sent = server.robot.n
    wait_for(lambda: server.robot.n > sent + 6, "six more ticks")
    assert commands(server, wire.DriveByHand) == []
    page.evaluate("window.__pad.axes[1] = 0;" + LEFT_SHOULDER % "false")
    page.get_by_role("button", name="Assign its axes").click()
    for axis, words in ((1, "drives forward"), (4, "turns to the left")):
        expect(page.get_by_text(words)).to_be_visible()
        page.evaluate(f"window.__pad.axes[{axis}] = -1")
        expect(page.get_by_text("Now let it go")).to_be_visible()
        page.evaluate(f"window.__pad.axes[{axis}] = 0")
    expect(page.get_by_text("has to be held while driving")).to_be_visible()
    page.evaluate(LEFT_SHOULDER % "true")
    expect(page.get_by_text("Gamepad: Test pad")).to_be_visible()
    page.evaluate(LEFT_SHOULDER % "false")

    def press(page: Page) -> None:
        page.evaluate("window.__pad.axes[1] = window.__pad.axes[4] = -1;" + LEFT_SHOULDER % "true")

    def let_go(page: Page) -> None:
        page.evaluate(LEFT_SHOULDER % "false")

    hold(page, lambda: turning(server), press, let_go)
    assert turning(server)[-1].yaw_rate_radps == pytest.approx(1.2)


def test_a_gamepad_held_while_arming_must_be_let_go_first(
    open_page: OpenPage, server: FakeServer
) -> None:
    server.robot.mode = "paused"
    page = open_page("teleop")
    take_seat(page)
    page.evaluate(PLUG_IN + "window.__pad.axes[1] = -1;" + LEFT_SHOULDER % "true")
    expect(page.get_by_text("Gamepad: Test pad")).to_be_visible()
    page.get_by_role("button", name="Drive by hand", exact=True).click()
    expect(page.locator(".pad.armed")).to_be_visible()
    expect(page.locator(".why-not")).to_have_text("Let go and hold again to drive.")
    sent = server.robot.n
    wait_for(lambda: server.robot.n > sent + 6, "six more ticks")
    assert commands(server, wire.DriveByHand) == []


def test_driving_by_hand_asks_before_it_interrupts_a_mission(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page("teleop")
    take_control(page)
    expect(page.get_by_role("dialog", name="Interrupt the mission?")).to_be_visible()
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".pad.armed")).to_have_count(0)


def test_old_data_are_grey_below_a_red_banner(open_page: OpenPage, server: FakeServer) -> None:
    page = open_page()
    expect(page.locator("#main")).not_to_have_class("main is-stale")
    ground = page.locator(".map-host").bounding_box()
    server.silent = True
    expect(page.locator(".banner.bad", has_text="old")).to_be_visible()
    assert page.locator(".map-host").bounding_box() == ground, "the map moved under a finger"
    expect(page.locator("#main")).to_have_class("main is-stale")
    for each in (page.locator(".mode"), *page.locator(".chip", has_text="Battery").all()):
        expect(each).to_have_css("filter", GREY)
    server.silent = False
    expect(page.locator("#main")).to_have_class("main")
    expect(page.locator(".mode")).to_have_css("filter", "none")


def test_a_reload_keeps_the_screen_the_seat_and_the_whole_track(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page("weeds")
    show(page, "drive")
    take_control(page)
    show(page, "health")
    page.reload()
    until(page, "window.__agribot?.ready && window.__agribot.screen === 'health'")
    expect(page.locator(".operator")).to_contain_text("You")
    driven = len(server.robot.trajectory)
    until(page, f"window.__agribot.counters.traj >= {driven}")


def test_a_tab_made_from_another_is_another_operator_and_a_reload_is_the_same(
    open_page: OpenPage, context: BrowserContext
) -> None:
    lines: list[str] = []
    context.on("page", lambda page: page.on("websocket", lambda line: lines.append(line.url)))
    page = open_page()
    with context.expect_page() as opened:
        page.evaluate("void open(location.href)")  # begins with a copy of the tab's storage
    until(opened.value, "window.__agribot?.ready")
    page.reload()
    until(page, "window.__agribot?.ready")
    tabs = [parse_qs(urlparse(line).query)["tab"][0] for line in lines if "/ws/v1" in line]
    assert tabs[0] != tabs[1]
    assert tabs[0] == tabs[2]


def test_the_mission_buttons_send_what_they_say(open_page: OpenPage, server: FakeServer) -> None:
    page = open_page()
    expect(page.locator("[data-action=pause]")).to_be_hidden()
    take_control(page)
    for action in ("pause", "resume"):
        page.locator(f"[data-action={action}]").click()
    page.locator("[data-action=cancel]").click()
    page.get_by_role("dialog").get_by_role("button", name="End mission").click()
    wait_for(lambda: len(commands(server, wire.ControlMission)) == 3, "three mission commands")
    sent = [command.action for command in commands(server, wire.ControlMission)]
    assert sent == ["pause", "resume", "cancel"]
    expect(page.locator(".mode")).to_have_text("Done")
