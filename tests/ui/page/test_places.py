"""A place shown on the map is proposed first; only what is confirmed is sent.

One page with its map serves all tests.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest
from playwright.sync_api import Browser, CDPSession, FloatRect, Page, expect

from agribot.ui import wire
from tests import nightly
from tests.ui.page.conftest import hand_over, new_context, shared_page, take_control, until
from tests.ui.page.fake_server import FakeServer, serving
from tests.ui.page.test_safety import commands
from tests.waiting import wait_for

MAP_ONLY = "off=scene,camera"
GOAL, POSE, POINT = "Drive to a place", "Correct the robot’s pose", "Publish a point"
Point = tuple[float, float]


@pytest.fixture(scope="module")
def shared_server() -> Iterator[FakeServer]:
    fake = FakeServer(weeds=20)
    with serving(fake) as fake.address:
        yield fake


@pytest.fixture(scope="module")
def open_once(browser: Browser, shared_server: FakeServer) -> Iterator[Page]:
    with shared_page(browser, f"{shared_server.address}/?{MAP_ONLY}#/drive", (900, 600)) as page:
        yield page


@pytest.fixture
def server(shared_server: FakeServer) -> FakeServer:
    """Nothing was commanded yet; the robot stands, so that its map is not drawn over and over."""
    shared_server.robot.commands.clear()
    shared_server.robot.mode, shared_server.robot.leg = "paused", "row 3"
    shared_server.refused_goal = ""
    return shared_server


@pytest.fixture
def page(open_once: Page, server: FakeServer) -> Iterator[Page]:
    """Without a proposal, a tool and the seat."""
    yield open_once
    for cancel in open_once.locator(".map-proposal:visible").get_by_text("Cancel").all():
        cancel.click()
    for tool in open_once.locator(".map-button[aria-pressed=true]").all():
        if tool.get_attribute("aria-label") in {GOAL, POSE}:
            tool.click()
    hand_over(open_once)


def middle_of_map(page: Page) -> Point:
    until(page, "window.__agribot.map?.loaded()")
    box = page.locator(".map").bounding_box()
    assert box
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drag_north(page: Page) -> None:
    x, y = middle_of_map(page)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 80, steps=3)
    page.mouse.up()


@pytest.mark.parametrize(
    ("title", "yes", "kind"),
    [
        (GOAL, "Drive here", wire.GoTo),
        (POSE, "Correct the pose", wire.CorrectPose),
    ],
)
def test_a_goal_and_a_pose_are_sent_when_they_are_confirmed_and_not_before(
    page: Page,
    server: FakeServer,
    title: str,
    yes: str,
    kind: type[wire.GoTo] | type[wire.CorrectPose],
) -> None:
    take_control(page)
    tool = page.get_by_role("button", name=title)
    tool.click()
    proposal = page.get_by_role("group", name="Proposal")
    drag_north(page)
    expect(proposal).to_contain_text("0° from north")
    proposal.get_by_role("button", name="Cancel").click()
    expect(proposal).to_be_hidden()
    expect(tool).to_have_attribute("aria-pressed", "false")
    tool.click()
    drag_north(page)
    if kind is wire.GoTo:
        expect(proposal).to_contain_text("of way, at least")
    assert commands(server, kind) == []
    proposal.get_by_role("button", name=yes).click()
    wait_for(lambda: commands(server, kind), "what was confirmed")
    expect(proposal).to_be_hidden()
    expect(tool).to_have_attribute("aria-pressed", "false")
    drag_north(page)  # the tool is put away: this moves the map
    assert len(commands(server, kind)) == 1
    north_rad = 1.5708
    assert commands(server, kind)[0].yaw_map_rad == pytest.approx(north_rad, abs=0.02)


def test_a_place_that_the_robot_cannot_reach_or_nobody_may_send_it_to_is_not_sent(
    page: Page, server: FakeServer
) -> None:
    page.get_by_role("button", name=GOAL).click()
    page.mouse.click(*middle_of_map(page))
    proposal = page.get_by_role("group", name="Proposal")
    expect(proposal).to_contain_text("Take control first")
    yes = proposal.get_by_role("button", name="Drive here")
    expect(yes).to_be_disabled()
    take_control(page)
    expect(yes).to_be_enabled()
    server.refused_goal = "crop stands there"
    page.mouse.click(*middle_of_map(page))
    expect(proposal).to_contain_text("crop stands there")
    expect(yes).to_be_disabled()
    assert commands(server, wire.GoTo) == []


def test_a_robot_that_drives_on_is_asked_again_for_its_way_to_a_place(
    page: Page, server: FakeServer
) -> None:
    page.get_by_role("button", name=GOAL).click()
    page.mouse.click(*middle_of_map(page))
    proposal = page.get_by_role("group", name="Proposal")
    expect(proposal).to_contain_text("of way, at least")
    before = proposal.inner_text()
    server.refused_goal = "crop stands there"
    server.robot.s_m += 0.5
    stood_n = server.robot.n
    wait_for(lambda: server.robot.n > stood_n + 30, "a second of ticks")
    assert proposal.inner_text() == before
    server.robot.s_m += 1.0
    expect(proposal).to_contain_text("crop stands there")
    server.refused_goal = ""
    server.robot.s_m += 1.1
    expect(proposal).to_contain_text("of way, at least")
    assert proposal.inner_text() != before


def touch(fingers: CDPSession, kind: str, points: Sequence[Point]) -> None:
    touches = [{"x": x, "y": y, "id": id} for id, (x, y) in enumerate(points)]
    fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})


@nightly.by_day("test_a_goal_and_a_pose_are_sent_when_they_are_confirmed_and_not_before")
def test_two_fingers_move_the_map_and_a_double_tap_zooms_and_neither_sends_anything(
    browser: Browser, server: FakeServer
) -> None:
    with new_context(
        browser, viewport={"width": 1024, "height": 768}, has_touch=True, locale="en"
    ) as context:
        page = context.new_page()
        page.goto(f"{server.address}/?{MAP_ONLY}#/drive")
        until(page, "window.__agribot?.ready")
        take_control(page)
        fingers = context.new_cdp_session(page)
        x, y = middle_of_map(page)
        proposal = page.get_by_role("group", name="Proposal")
        for title in (GOAL, POSE, POINT):
            page.get_by_role("button", name=title).click()
            zoom = page.evaluate("window.__agribot.map.getZoom()")
            touch(fingers, "touchStart", [(x - 20, y)])
            touch(fingers, "touchStart", [(x - 20, y), (x + 20, y)])
            for spread in (30, 45, 60):
                touch(fingers, "touchMove", [(x - spread, y), (x + spread, y)])
            touch(fingers, "touchEnd", [(x - 60, y)])
            touch(fingers, "touchEnd", [])
            until(page, f"Math.abs(window.__agribot.map.getZoom() - {zoom}) > 0.3")
            expect(proposal).to_be_hidden()
            page.get_by_role("button", name=title).click()
        page.get_by_role("button", name=POINT).click()
        page.mouse.dblclick(x, y)
        sent_n = server.robot.n
        wait_for(lambda: server.robot.n > sent_n + 45, "one and a half seconds of ticks")
        page.get_by_role("button", name=GOAL).click()
        touch(fingers, "touchStart", [(x, y)])
        touch(fingers, "touchEnd", [])
        expect(proposal).to_be_visible()
        for kind in (wire.GoTo, wire.CorrectPose, wire.PointOut):
            assert commands(server, kind) == []


def test_the_place_that_the_robot_drives_to_is_told_by_its_path(
    page: Page, server: FakeServer
) -> None:
    server.robot.mode = "mission"
    for leg in ("stops first", "row 3"):  # a goal of this page's own is past
        server.robot.leg = leg
        until(page, f"window.__agribot.state().mission.leg === '{leg}'")
    assert page.evaluate("window.__agribot.goal()") is None
    server.robot.leg = "to the goal"
    assert until(page, "window.__agribot.goal()") == list(server.robot.path[-1])


@nightly.by_day("test_a_goal_and_a_pose_are_sent_when_they_are_confirmed_and_not_before")
def test_a_message_does_not_lie_over_what_is_to_be_confirmed(
    page: Page, server: FakeServer
) -> None:
    """The reason against a goal could not be read below it."""
    page.set_viewport_size({"width": 1366, "height": 650})
    server.refused_goal = "The goal lies beyond the fence"
    page.get_by_role("button", name=GOAL).click()
    page.mouse.click(*middle_of_map(page))
    expect(page.locator(".map-proposal .problem")).to_contain_text("beyond the fence")
    page.evaluate(
        "document.querySelector('.toasts').innerHTML = '<div class=toast>Pose corrected</div>'"
    )
    proposal = page.locator(".map-proposal").bounding_box()
    assert proposal
    message = page.locator(".toast")
    wait_for(lambda: lies_above(message.bounding_box(), proposal["y"]), "a message above", 60.0)
    page.get_by_role("group", name="Proposal").get_by_text("Cancel").click()
    wait_for(lambda: not lies_above(message.bounding_box(), proposal["y"]), "its usual place", 60.0)
    page.evaluate("document.querySelector('.toasts').replaceChildren()")
    page.set_viewport_size({"width": 900, "height": 600})


def lies_above(box: FloatRect | None, top_px: float) -> bool:
    return box is not None and box["y"] + box["height"] <= top_px
