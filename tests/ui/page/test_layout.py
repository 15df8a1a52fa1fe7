"""Every control can be reached and read on a phone on its side and on small laptops."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from agribot.ui import wire
from tests import nightly
from tests.ui.page.conftest import SCREENS, OpenPage, show, take_control, until
from tests.ui.page.fake_server import FakeServer
from tests.ui.page.test_controls import WORKABLE

SIZES = [(844, 390), (667, 375), (1366, 650), (1100, 700)]
# What cannot be brought into view, is covered where one would press it, or has its words cut.
OUT_OF_REACH = f"""(part) => {{
  const found = []
  for (const each of {WORKABLE}.filter(each => each.closest(part))) {{
    each.scrollIntoView({{block: 'center', inline: 'nearest'}})
    const box = each.getBoundingClientRect()
    const [x, y] = [box.left + box.width / 2, box.top + box.height / 2]
    const inside = box.left >= 0 && box.right <= innerWidth + 1 && y > 0 && y < innerHeight
    const hit = inside && document.elementFromPoint(x, y)
    const reached = hit && (each.contains(hit) || hit.contains(each)
      || hit.closest('label')?.contains(each))
    const cut = each.matches('button, a') && each.scrollWidth > each.clientWidth + 1
    if (!reached || cut) found.push(each.outerHTML.slice(0, 120))
  }}
  return found
}}"""
# Lines of the implement's marks that reach beyond their box, over what stands beside it.
MARKS_OUTSIDE = """() => {
  const line = document.querySelector('dd.implement')
  const words = document.createRange()
  words.selectNodeContents(line)
  const box = line.getBoundingClientRect()
  return [...words.getClientRects()].filter(each =>
    each.left < box.left - 0.5 || each.right > box.right + 0.5).length
}"""
# Cards beside the map that lie over another.
COVERING = """() => {
  const cards = [...document.querySelectorAll('.screen-drive .side > *')]
  const boxes = cards.map(each => each.getBoundingClientRect())
  return cards.filter((_, index) => boxes.some((box, other) => other > index
    && box.left < boxes[index].right - 1 && box.right > boxes[index].left + 1
    && box.top < boxes[index].bottom - 1 && box.bottom > boxes[index].top + 1)
  ).map(each => each.className)
}"""
# What of the line at the top lies over something else of it, below STOP or beyond the display.
COLLISIONS = """() => {
  const parts = [...document.querySelectorAll('.statusbar :is(.chip, .mode, .theme-button), #stop')]
    .map(each => [each, each.getBoundingClientRect()]).filter(([, box]) => box.width)
  const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1
    && a.top < b.bottom - 1 && b.top < a.bottom - 1
  return parts.filter(([each, box]) => box.right > innerWidth
    || parts.some(([other, its]) => other !== each && meet(box, its))
  ).map(([each]) => each.textContent)
}"""
# The link and the age of a slow line need more room than those of a quick one.
COLLISIONS_OF_A_SLOW_LINE = f"""() => {{
  const [link, age] = [...document.querySelectorAll('.chips .chip-value')]
  link.textContent = '123 ms'
  age.textContent = '10.2 s'
  return ({COLLISIONS})()
}}"""
SCROLLBARS = """[...document.querySelectorAll('.rail')].filter(each =>
    each.scrollHeight > each.clientHeight + 1 || each.scrollWidth > each.clientWidth + 1).length"""

# Width and height of a phone, and what it takes of the page's edges.
UPRIGHT = (390, 844, {"top": 59, "bottom": 34})
ON_ITS_SIDE = (844, 390, {"left": 59, "right": 59, "bottom": 21})
# What of the page can be pressed or read reaches into those edges.
UNDER_THE_NOTCH = """(edges) => {
  const {top = 0, left = 0, right = 0, bottom = 0} = edges
  return [...document.querySelectorAll('#stop, .statusbar *, .rail .tab, .dialog button, .toast')]
    .map(each => [each, each.getBoundingClientRect()]).filter(([, box]) => box.width && box.height)
    .filter(([, box]) => box.top < top || box.left < left
      || box.right > innerWidth - right || box.bottom > innerHeight - bottom)
    .map(([each]) => each.outerHTML.slice(0, 120))
}"""


@pytest.fixture
def page_size() -> tuple[int, int]:
    return SIZES[0]


def check(page: Page, where: str, part: str = "body") -> None:
    assert page.evaluate(OUT_OF_REACH, part) == [], where
    assert page.evaluate(SCROLLBARS) == 0, where


@pytest.mark.parametrize(
    ("width", "height"),
    [
        SIZES[0],
        *(
            pytest.param(*size, marks=nightly.by_day("test_every_control_is_reached_and_read"))
            for size in SIZES[1:]
        ),
    ],
)
def test_every_control_is_reached_and_read(open_page: OpenPage, width: int, height: int) -> None:
    page = open_page()
    page.set_viewport_size({"width": width, "height": height})
    take_control(page)
    for screen in SCREENS:
        show(page, screen)
        until(page, "document.querySelector('.screen').childElementCount > 0")
        check(page, f"{screen} at {width}×{height}")


@pytest.mark.parametrize(
    ("width", "height"),
    [
        (844, 390),
        pytest.param(1100, 700, marks=nightly.by_day("test_every_button_of_the_map_is_reached")),
    ],
)
def test_every_button_of_the_map_is_reached(
    open_page: OpenPage, server: FakeServer, width: int, height: int
) -> None:
    server.robot.mode = "paused"  # the map is not drawn anew for a robot that stands
    page = open_page(query="off=scene,camera")
    page.set_viewport_size({"width": width, "height": height})
    until(page, "window.__agribot.map?.loaded()")
    check(page, f"the map at {width}×{height}")
    toggle = page.get_by_role("button", name="Map tools")
    if toggle.is_visible():
        toggle.click()
    assert page.locator(".map-button:visible:not(.tools-toggle)").count() == 14
    check(page, f"the map's tools at {width}×{height}")
    page.get_by_role("button", name="Layers and views").click()
    check(page, f"the layers at {width}×{height}", ".map-panel")


def test_the_marks_of_a_broad_boom_stay_in_their_box_on_any_screen(
    open_page: OpenPage, server: FakeServer
) -> None:
    marks = "○●○" * 9
    server.robot.implement = [wire.ImplementLine(name="Nozzles", text=marks)]
    page = open_page()
    until(page, f"document.querySelector('dd.implement')?.textContent.includes('{marks}')")
    for width, height in (*SIZES, (1280, 800), (1920, 1080), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        until(page, f"innerWidth === {width}")
        assert page.evaluate(MARKS_OUTSIDE) == 0, f"{width}×{height}"


def test_the_line_at_the_top_has_room_for_all_of_it_whatever_the_name_of_the_operator(
    open_page: OpenPage, server: FakeServer
) -> None:
    server.seat = "Wilhelmina Featherstonehaugh-Montgomery"
    page = open_page()
    expect(page.locator(".operator")).to_have_attribute("title", f"Operator: {server.seat}")
    for width, height in (*SIZES, (640, 320), (360, 640), (600, 800), (768, 1024), (1280, 720)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate(COLLISIONS) == [], f"{width}×{height}"
        assert page.evaluate(COLLISIONS_OF_A_SLOW_LINE) == [], f"{width}×{height}, slow"


def test_no_card_beside_the_map_lies_over_another_on_any_screen(open_page: OpenPage) -> None:
    page = open_page()
    show(page, "drive")
    for width, height in (*SIZES, (1280, 800), (390, 844), (768, 1024), (800, 1100), (1000, 1400)):
        page.set_viewport_size({"width": width, "height": height})
        until(page, "document.querySelectorAll('.screen-drive .side > :not([hidden])').length == 4")
        assert page.evaluate(COVERING) == [], f"{width}×{height}"


@pytest.mark.parametrize(
    ("width", "height", "edges"),
    [
        UPRIGHT,
        pytest.param(
            *ON_ITS_SIDE,
            marks=nightly.by_day("test_nothing_lies_under_a_notch_or_the_bars_of_a_phone"),
        ),
    ],
)
def test_nothing_lies_under_a_notch_or_the_bars_of_a_phone(
    open_page: OpenPage, width: int, height: int, edges: dict[str, int]
) -> None:
    page = open_page()
    page.set_viewport_size({"width": width, "height": height})
    line = page.context.new_cdp_session(page)
    line.send("Emulation.setSafeAreaInsetsOverride", {"insets": edges})
    for screen in SCREENS:
        show(page, screen)
        assert page.evaluate(UNDER_THE_NOTCH, edges) == [], screen
    assert page.evaluate(COLLISIONS) == []
    page.locator(".operator").click()
    expect(page.get_by_role("dialog")).to_be_visible()
    assert page.evaluate(UNDER_THE_NOTCH, edges) == []
