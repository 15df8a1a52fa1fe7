"""Every screen shows the robot's data and changes what it says it changes."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, Route, expect

from agribot.core.geo import Datum, MapFrame
from agribot.ui import wire
from tests import nightly
from tests.ui.page import fake_answers
from tests.ui.page.conftest import (
    SCREENS,
    SHARP,
    OpenPage,
    show,
    take_control,
    until,
    wait_for_toast,
)
from tests.ui.page.fake_robot import DATUM, field
from tests.ui.page.fake_server import FakeServer
from tests.ui.page.test_safety import commands
from tests.waiting import wait_for

BLUE, GREEN = (31, 95, 224), (23, 145, 63)  # of the light theme
NEAR_RGB = 60
A_MOMENT = "new Promise((resolve) => setTimeout(resolve, 100))"  # to show what was answered
UNDO = "[...document.querySelectorAll('.calibration button')].at(-1)"
AXE = Path(__file__).parents[3] / "web" / "node_modules" / "axe-core" / "axe.min.js"
SERIOUS = {"serious", "critical"}
# A dialog of each kind: text and name, list of screens and pages, a question, a line of text.
DIALOGS = {
    "drive": ("Operator None", "Connected 1"),
    "recordings": ("Mark this moment",),
}


# Colours are judged when none of them is on its way to another theme any more.
COME_TO_REST = """document.getAnimations().every(
    each => each.effect?.getComputedTiming().iterations === Infinity
        || each.playState !== 'running')"""


def violations(page: Page, theme: str) -> list[str]:
    """All rules in the light theme; in the others those of colour, all that a theme changes."""
    until(page, COME_TO_REST)
    contrast = ["color-contrast"] + ["color-contrast-enhanced"] * (theme == "sun")
    everything = {"rules": {"region": {"enabled": False}}}
    options = everything if theme == "light" else {"runOnly": {"type": "rule", "values": contrast}}
    found = page.evaluate(f"axe.run(document, {json.dumps(options)})")
    return [
        f"{rule['id']}: {node['html'][:120]}"
        for rule in found["violations"]
        if rule["impact"] in SERIOUS
        for node in rule["nodes"]
    ]


@nightly.one_by_one("theme", ["light", "dark", "sun"], 1)
def test_no_screen_has_a_serious_finding_of_axe(open_page: OpenPage, theme: str) -> None:
    page = open_page(theme=theme)
    page.evaluate(AXE.read_text())
    found: list[str] = []
    for screen in SCREENS:
        show(page, screen)
        until(page, "document.querySelector('.screen').childElementCount > 0")
        found += [f"{screen}: {each}" for each in violations(page, theme)]
        for name in DIALOGS.get(screen, ()):
            page.get_by_role("button", name=name, exact=True).first.click()
            expect(page.get_by_role("dialog")).to_be_visible()
            inside = violations(page, theme)
            found += [f"{name} on {screen}: {each}" for each in inside]
            page.get_by_role("button", name="Close").click()
    assert found == []


def test_the_map_draws_the_field_the_weeds_and_the_track(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page(query="off=scene,camera")
    drawn = "window.__agribot.map?.queryRenderedFeatures({layers: ['%s']}).length"
    until(page, drawn % "rows" + " >= 6")
    until(page, drawn % "waypoints" + " >= 12")
    until(page, drawn % "obstacles-fill" + " >= 1")
    weeds = "new Set(window.__agribot.map.queryRenderedFeatures({layers: ['weeds']})"
    most = 0.9 * len(server.robot.weeds)
    until(page, f"{weeds}.map(f => f.properties.id)).size > {most}")
    until(page, drawn % "trajectory" + " >= 1")
    hidden = "window.__agribot.map.getLayoutProperty('density', 'visibility')"
    assert page.evaluate(hidden) == "none"


@nightly.by_day(
    "test_the_map_draws_the_field_the_weeds_and_the_track",
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests",
)
@pytest.mark.parametrize("sharpness", [SHARP])
def test_the_trace_is_blue_and_runs_through_every_place_and_goals_are_green(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page(query="off=scene,camera")
    until(page, "window.__agribot.counters.traj > 250")
    server.robot.mode = "paused"
    driven = list(server.robot.trajectory)
    until(page, f"window.__agribot.counters.traj >= {len(driven)}")
    frame = MapFrame(Datum(lat_deg=DATUM.lat_deg, lon_deg=DATUM.lon_deg))
    robot_xy, goals = server.robot.pose()[:2], field().waypoints_map_m
    covered = (robot_xy, *goals, (-1.0, 0.0))  # there stands the number of the row
    clear = [xy for xy in driven if min(math.dist(xy, at) for at in covered) > 1.0]
    assert len(clear) > 50
    picture = np.zeros((1, 1, 3), dtype=int)

    def seen(xy: Sequence[float], rgb: tuple[int, int, int]) -> bool:
        """A pixel of this colour there, or next to it."""
        lat_deg, lon_deg, _ = frame.geodetic_from_map(*xy)
        at = page.evaluate(f"window.__agribot.map.project([{lon_deg}, {lat_deg}])")
        x, y = round(at["x"]), round(at["y"])
        near = picture[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3)
        return bool((np.abs(near - rgb).max(axis=1) < NEAR_RGB).any())

    def drawn() -> bool:
        nonlocal picture
        picture = np.asarray(Image.open(io.BytesIO(page.locator(".map").screenshot())))[..., :3]
        picture = picture.astype(int)
        return all(seen(xy, BLUE) for xy in clear[::6]) and all(seen(xy, GREEN) for xy in goals[2:])

    wait_for(drawn, "a blue trace through every place, and green goals")


def test_the_camera_draws_pictures_and_says_how_old_they_are(open_page: OpenPage) -> None:
    page = open_page("camera")
    assert until(page, "window.__agribot.counters.cam") > 0
    expect(page.locator(".picture-label")).to_contain_text("ms")
    red = (
        "(() => { const c = document.querySelector('.mask'); if (!c.width) return 0;"
        "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        "let n = 0; for (let i = 0; i < d.length; i += 4)"
        " if (d[i + 3] && d[i] > 200) n++; return n })()"
    )
    assert until(page, red) > 50
    page.get_by_label("Weed").uncheck()
    wait_for(lambda: page.evaluate(red) == 0, "a mask without weeds")


def test_a_changed_setting_reaches_the_robot(open_page: OpenPage, server: FakeServer) -> None:
    page = open_page("settings")
    speed = page.get_by_label("Speed", exact=True)
    speed.fill("0.6")
    speed.press("Enter")
    wait_for(lambda: "settings" in server.written, "a changed setting")
    assert server.written["settings"] == {"mission.speed_mps": 0.6}


def hold_next(page: Page, url: str) -> list[Route]:
    """Where the next request of it will be, for the test to answer."""
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    page.route(url, hold, times=1)
    return held


def test_a_late_answer_leaves_what_was_typed_meanwhile(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page("settings")
    held = hold_next(page, "**/api/v1/settings")
    speed = page.get_by_label("Speed", exact=True)
    speed.fill("0.6")
    speed.press("Enter")
    wait_for(lambda: page.evaluate("true") and held, "the request that is answered late")
    speed.fill("0.3")
    held[0].continue_()
    wait_for_toast(page, "is now 0.6")
    assert speed.input_value() == "0.3"
    speed.press("Enter")
    wait_for(lambda: server.written["settings"] == {"mission.speed_mps": 0.3}, "the other setting")


def calibrate_compass(server: FakeServer, phase: wire.CalibrationPhase) -> None:
    """Another stage; the page requests its details."""
    server.robot.calibration = wire.CalibrationProgress(
        kind="compass", phase=phase, motion="", share=1.0, reason="", directions=None
    )


def test_calibrations_asked_for_before_an_undo_do_not_come_back_with_a_late_answer(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page("settings")
    take_control(page)
    card = page.locator(".calibration")
    expect(card).to_contain_text("calibration.wheel_radius_m")
    held = hold_next(page, "**/api/v1/calibrations")
    calibrate_compass(server, "failed")
    known = msgspec.structs.replace(fake_answers.CALIBRATIONS, now=server.robot.calibration)
    wait_for(lambda: page.evaluate("true") and held, "the request that is answered late")
    undone = msgspec.structs.replace(known, settings=[], can_undo=False)
    server.answers["calibrations"] = undone
    page.route(
        "**/calibrations/undo", lambda route: route.fulfill(body=msgspec.json.encode(undone))
    )
    card.get_by_role("button", name="Undo the newest").click()
    expect(card).to_contain_text("Nothing was measured")
    with page.expect_response("**/api/v1/calibrations"):
        held[0].fulfill(body=msgspec.json.encode(known))
    page.evaluate(A_MOMENT)
    expect(card).to_contain_text("Nothing was measured")


def test_a_button_of_the_calibrations_stays_the_same_while_nothing_changes(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page("settings")
    take_control(page)
    expect(page.locator(".calibration")).to_contain_text("Undo the newest")
    page.evaluate(f"window.__button = {UNDO}")
    with page.expect_response("**/api/v1/calibrations"):
        calibrate_compass(server, "found")  # but what is asked for knows of none any more
    page.evaluate(A_MOMENT)
    assert page.evaluate(f"window.__button === {UNDO}")


def test_a_recording_is_replayed_and_a_moment_marked(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page("recordings")
    page.get_by_role("button", name="Replay").nth(1).click()
    wait_for(lambda: "replay" in server.written, "a replay")
    assert server.written["replay"] == {"name": "2026-05-03-171200-farm", "speed": 1, "t_s": 0}
    page.get_by_role("button", name="Mark this moment").click()
    page.get_by_label("What happened").fill("stone")
    page.keyboard.press("Enter")
    wait_for(lambda: commands(server, wire.MarkMoment), "a mark")
    assert commands(server, wire.MarkMoment)[0].text == "stone"


def test_a_button_of_a_recording_keeps_the_focus_while_the_list_is_asked_for_again(
    open_page: OpenPage,
) -> None:
    page = open_page("recordings")
    replay = page.get_by_role("button", name="Replay").nth(1)
    replay.focus()
    with page.expect_response("**/api/v1/recordings"):
        pass
    page.evaluate(A_MOMENT)
    expect(replay).to_be_focused()


def test_the_plots_draw_the_chosen_signals(open_page: OpenPage) -> None:
    page = open_page("plots")
    expect(page.locator(".chart")).to_have_count(3)
    page.get_by_label("Battery").check()
    expect(page.locator(".chart")).to_have_count(4)
    height = page.locator(".charts").bounding_box()
    assert height
    assert height["height"] < 800


def test_faults_say_what_to_do(open_page: OpenPage) -> None:
    page = open_page("health")
    expect(page.locator(".check-card.fault")).to_contain_text("Check the cable")
    expect(page.locator(".log")).to_contain_text("Fix fell back to float")
