"""A place shown on the map is proposed first; only what is confirmed is sent."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from playwright.sync_api import Browser, CDPSession, Page, expect

from agribot.ui import wire
from tests.ui.page.conftest import OpenPage, new_context, take_control, until
from tests.ui.page.fake_server import FakeServer
from tests.ui.page.test_safety import commands
from tests.waiting import wait_for

MAP_ONLY = "off=scene,camera"
GOAL, POSE, POINT = "Drive to a place", "Correct the robot’s pose", "Publish a point"
Point = tuple[float, float]


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
    [(GOAL, "Drive here", wire.GoTo), (POSE, "Correct the pose", wire.CorrectPose)],
)
def test_a_goal_and_a_pose_are_sent_when_they_are_confirmed_and_not_before(
    open_page: OpenPage,
    server: FakeServer,
    title: str,
    yes: str,
    kind: type[wire.GoTo] | type[wire.CorrectPose],
) -> None:
    page = open_page(query=MAP_ONLY)
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
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page(query=MAP_ONLY)
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
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page(query=MAP_ONLY)
    page.get_by_role("button", name=GOAL).click()
    server.robot.mode = "paused"
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
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page(query=MAP_ONLY)
    middle_of_map(page)
    assert page.evaluate("window.__agribot.goal()") is None
    server.robot.leg = "to the goal"
    assert until(page, "window.__agribot.goal()") == list(server.robot.path[-1])
