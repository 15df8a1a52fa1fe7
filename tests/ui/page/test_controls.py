"""Every control does what it says, and every figure is where it belongs."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence

import msgspec
import pytest
from playwright.sync_api import Locator, Page, expect

from agribot.core.messages import PlantClass
from agribot.ui import wire
from tests import nightly
from tests.ui.page.conftest import (
    SCREENS,
    WITHOUT_GL,
    OpenPage,
    hold,
    show,
    take_control,
    until,
)
from tests.ui.page.fake_robot import GNSS
from tests.ui.page.fake_server import FakeServer
from tests.ui.page.test_safety import armed, commands
from tests.waiting import wait_for

MAP_ONLY = "off=scene,camera"
# What can be worked with on a screen, in the order of the page; hidden and disabled ones left out.
WORKABLE = """[...document.querySelectorAll('a[href], button, input, select, textarea, [tabindex]')]
    .filter(each => each.tabIndex >= 0 && !each.disabled && each.checkVisibility({
        visibilityProperty: true}) && !each.closest('[inert]'))"""
TAB_LIMIT = 120
CHANGES = 10  # of a screen that is still being filled


def chip(page: Page, label: str) -> Locator:
    return page.locator(".chip", has_text=label).locator(".chip-value")


def test_the_status_bar_tells_link_age_position_battery_stop_operator_and_viewers(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page()
    told: dict[str, str | re.Pattern[str]] = {
        "Link": re.compile(r"^\d+ ms$"),
        "Age": re.compile(r"^\d+\.\d s$"),
        "GNSS": "RTK 1.4 cm",
        "Battery": "87 %",
        "Stop": "Clear",
        "Operator": "None",
        "Connected": "1",
    }
    for label, said in told.items():
        expect(chip(page, label)).to_have_text(said)
    expect(page.locator(".mode")).to_have_text("On mission")
    server.robot.stop = "pressed elsewhere"
    expect(chip(page, "Stop")).to_have_text("Pressed")
    take_control(page)
    expect(chip(page, "Operator")).to_have_text("You")


def test_the_status_bar_says_in_red_that_there_is_no_fix_any_more_and_the_next_fix_again(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page()
    gnss = page.locator(".chip", has_text="GNSS")
    for state in (None, msgspec.structs.replace(GNSS, quality=0)):
        expect(gnss.locator(".chip-value")).to_have_text("RTK 1.4 cm")
        expect(gnss).not_to_have_attribute("data-tone", "bad")
        server.robot.gnss = state
        expect(gnss.locator(".chip-value")).to_have_text("No fix")
        expect(gnss).to_have_attribute("data-tone", "bad")
        server.robot.gnss = GNSS
    expect(gnss.locator(".chip-value")).to_have_text("RTK 1.4 cm")


def not_reached(page: Page) -> list[str] | None:
    """What the Tab key leaves out; None where the screen changed while it was pressed."""
    wanted: int = page.evaluate(f"{WORKABLE}.map((each, i) => each.dataset.tab = i).length")
    page.evaluate("document.activeElement?.blur(); window.scrollTo(0, 0)")
    page.evaluate("getSelection().removeAllRanges(); document.body.focus()")
    reached = set()
    for _ in range(TAB_LIMIT):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement?.dataset.tab ?? null"))
        if len(reached - {None}) == wanted:
            break
    missing = sorted(set(map(str, range(wanted))) - reached)
    where = "document.querySelector(`[data-tab='${%s}']`)?.outerHTML.slice(0, 90)"
    named = [page.evaluate(where % index) for index in missing]
    now = page.evaluate(f"{WORKABLE}.map(each => each.dataset.tab ?? '')")
    page.evaluate("document.querySelectorAll('[data-tab]').forEach(e => delete e.dataset.tab)")
    return named if now == [str(index) for index in range(wanted)] else None


@pytest.mark.parametrize(
    ("width", "screens"),
    [
        pytest.param(390, ["drive", "settings"], id="phone, two screens"),
        *(
            pytest.param(
                width,
                SCREENS,
                id=f"{width}",
                marks=nightly.by_day(
                    "test_everything_that_can_be_worked_is_reached_by_the_tab_key"
                ),
            )
            for width in (1280, 390)
        ),
    ],
)
def test_everything_that_can_be_worked_is_reached_by_the_tab_key(
    open_page: OpenPage, width: int, screens: Sequence[str]
) -> None:
    page = open_page("settings")
    page.set_viewport_size({"width": width, "height": 800})
    take_control(page)
    for screen in screens:
        show(page, screen)
        until(page, "document.querySelector('.screen').childElementCount > 0")
        for _ in range(CHANGES):
            left_out = not_reached(page)
            if left_out is not None:
                break
        assert left_out == [], screen


def test_escape_closes_a_dialog_wherever_the_focus_is(open_page: OpenPage) -> None:
    page = open_page()
    operator = page.locator(".operator")
    operator.click()
    page.get_by_text("The robot has no operator.").click()  # leaves the focus nowhere
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    expect(operator).to_be_focused()


def test_the_mission_skips_goes_home_and_begins_once_more_only_when_asked_twice(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = open_page()
    take_control(page)
    page.locator("[data-action=skip_row]").click()
    page.locator("[data-action=return_home]").click()
    page.get_by_role("dialog").get_by_role("button", name="Return home").click()
    wait_for(lambda: len(commands(server, wire.ControlMission)) == 2, "both commands")
    server.robot.mode = "done"
    page.locator("[data-action=start]").click()
    asked = page.get_by_role("dialog", name="Start again?")
    expect(asked).to_contain_text(re.compile(r"once more, from where it stands: 6 rows\."))
    asked.get_by_role("button", name="Cancel").click()
    assert len(commands(server, wire.ControlMission)) == 2
    page.locator("[data-action=start]").click()
    asked.get_by_role("button", name="Start again").click()
    wait_for(lambda: len(commands(server, wire.ControlMission)) == 3, "the start")
    sent = [command.action for command in commands(server, wire.ControlMission)]
    assert sent == ["skip_row", "return_home", "start"]


@nightly.one_by_one("percent", [50, 20, 80, 100], 1)
def test_the_chosen_speed_limit_is_sent_and_kept(
    open_page: OpenPage, server: FakeServer, percent: int
) -> None:
    page = armed(open_page, server)
    page.get_by_role("button", name=f"{percent} %", exact=True).click()
    wait_for(lambda: commands(server, wire.ScaleSpeed), "the limit")
    wait_for(
        lambda: commands(server, wire.ScaleSpeed)[-1].ratio == pytest.approx(percent / 100),
        "its value",
    )
    hold(page, lambda: commands(server, wire.DriveByHand))
    page.mouse.up()
    page.reload()
    chosen = page.locator(".segment[aria-pressed=true]")
    expect(chosen).to_have_text(f"{percent} %")


def test_the_camera_freezes_fades_its_overlay_and_saves_what_it_shows(open_page: OpenPage) -> None:
    page = open_page("camera")
    label = page.locator(".picture-label")
    expect(label).to_contain_text(re.compile(r"^\d+ fps · \d+ ms · \d+×\d+"))
    page.get_by_label("Opacity").fill("0.2")
    expect(page.locator(".mask")).to_have_css("opacity", "0.2")
    freeze = page.get_by_role("button", name="Freeze")
    freeze.click()
    expect(label).to_contain_text("Frozen")
    pixels = "document.querySelector('.picture canvas').toDataURL()"
    held = page.evaluate(pixels)
    come = page.evaluate("window.__agribot.counters.cam")
    until(page, f"window.__agribot.counters.cam > {come} + 5")
    assert page.evaluate(pixels) == held
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save picture").click()
    assert saved.value.path().read_bytes().startswith(b"\x89PNG")
    freeze.click()
    wait_for(lambda: page.evaluate(pixels) != held, "moving pictures")


def test_the_plots_pause_and_save_the_window_that_they_show(open_page: OpenPage) -> None:
    page = open_page("plots")
    for name in ("Cross track", "Heading error"):
        page.get_by_label(name).uncheck()
    page.get_by_label("Battery").check()
    page.get_by_label("Window").select_option("10")
    page.get_by_role("button", name="Pause").click()

    def rows() -> list[list[str]]:
        with page.expect_download() as saved:
            page.get_by_role("button", name="CSV").click()
        return list(csv.reader(io.StringIO(saved.value.path().read_text())))

    first = rows()
    assert first[0] == ["t_s", "speed [m/s]", "battery [V]"]
    t_s = [float(row[0]) for row in first[1:]]
    assert t_s == sorted(t_s)
    assert 0.0 < t_s[-1] - t_s[0] <= 10.1
    assert {float(row[2]) for row in first[1:]} == {24.6}
    sent = page.evaluate("window.__agribot.state().t_s")
    until(page, f"window.__agribot.state().t_s > {sent} + 1")
    assert rows() == first, "a paused plot stands still"


@nightly.by_day(
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests"
)
def test_the_plants_are_counted_as_the_filter_leaves_them(
    open_page: OpenPage, server: FakeServer
) -> None:
    server.robot.t_s = 200.0
    page = open_page("weeds", MAP_ONLY)
    weeds = server.robot.weeds
    rendered = "window.__agribot.map.queryRenderedFeatures({layers: ['weeds']})"
    drawn = f"[...new Set({rendered}.map(f => f.properties.plant))].join()"

    def counted(which: list[wire.Weed]) -> None:
        expect(page.locator(".count")).to_have_text(f"{len(which)} of {len(weeds)} plants")

    counted(weeds)
    page.get_by_label("Crop", exact=True).uncheck()
    only = [weed for weed in weeds if weed.plant == PlantClass.WEED]
    assert 0 < len(only) < len(weeds)
    counted(only)
    until(page, f"{drawn} === '0'")
    page.get_by_label("Confidence at least").fill("0.8")
    sure = [weed for weed in only if weed.confidence >= 0.8]
    assert 0 < len(sure) < len(only)
    counted(sure)
    page.get_by_label("Not treated").uncheck()
    counted([weed for weed in sure if weed.treated_s is not None])
    page.get_by_label("Not treated").check()
    server.silent = True  # the time stands still
    expect(page.locator(".banner.bad", has_text="old")).to_be_visible()
    page.get_by_label("Seen").select_option("60")
    recent = page.evaluate("window.__agribot.state().t_s") - 60.0
    counted([weed for weed in sure if weed.last_seen_s >= recent])
    server.robot.t_s += 1000.0
    server.silent = False
    counted([])  # the minute goes on with the time
    until(page, f"{drawn} === ''")


def test_the_list_of_recordings_tells_room_result_and_files(open_page: OpenPage) -> None:
    page = open_page("recordings")
    expect(page.locator("main")).to_contain_text("81.3 GB free on the disk")
    rows = page.locator(".recordings tbody tr")
    expect(rows).to_have_count(3)
    expect(rows.nth(0)).to_contain_text("Recording")
    expect(rows.nth(0).get_by_role("button", name="Replay")).to_be_disabled()
    expect(rows.nth(1)).to_contain_text("Done")
    link = rows.nth(1).get_by_role("link", name="Recording")
    assert link.get_attribute("href") == "/api/v1/recordings/2026-05-03-171200-farm/run.mcap"
    assert rows.nth(1).get_by_role("link").count() == 1
    rows.nth(1).get_by_text("1 more").click()
    expect(rows.nth(1).get_by_role("link", name="report.json")).to_be_visible()


def test_a_replay_is_moved_by_its_slider_and_speed(open_page: OpenPage, server: FakeServer) -> None:
    page = open_page("recordings", WITHOUT_GL)
    server.robot.replay = wire.ReplayProgress(
        name="first", t_s=3.0, start_s=1.0, end_s=61.0, speed=1.0
    )
    expect(page.locator(".replay-bar output")).to_have_text("0:02 / 1:00")
    assert page.locator("select[aria-label=Speed] option").all_inner_texts() == [
        "0.1×", "0.5×", "1×", "2×", "5×", "10×",
    ]  # fmt: skip
    page.get_by_label("Speed", exact=True).select_option("10")
    wait_for(lambda: server.written.get("replay", {}).get("speed") == 10, "ten times the speed")
    page.get_by_label("Time in the recording").fill("30")
    wait_for(lambda: server.written["replay"]["t_s"] == 30, "another time")
    page.locator(".replay-bar").get_by_role("button", name="Pause").click()
    wait_for(lambda: server.written["replay"]["speed"] == 0, "a pause")
    page.get_by_role("button", name="Back to live").click()
    wait_for(lambda: server.written["replay"]["name"] is None, "the robot again")
