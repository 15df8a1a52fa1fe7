"""A browser, and a page on a robot that does what the tests need."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Error, Page, expect, sync_playwright
from playwright.sync_api import TimeoutError as NotThere

from agribot.ui import wire
from tests import machine
from tests.outcomes import HAS_FAILED
from tests.ui.page.fake_server import PAGE, FakeServer, serving
from tests.waiting import PATIENCE_S, wait_for

# WebGL by a program in place of a graphics card. With it Chromium would draw the whole page as
# well, over and over, for most of a core; so that is left to its plain painter.
GL_ARGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
]
expect.set_options(timeout=1000 * PATIENCE_S)
WITHOUT_GL = "off=map,scene"
# Pixels that are drawn for one of the page's, along each side: half of them take two fifths of the
# time that a program needs for a frame of the map.
COARSE, SHARP = 0.5, 1.0
ANSWERS_WITHIN_S = 20.0  # a page that has not hung
SCREENS = [*wire.SCREENS]
# A gamepad as the browser gives one; tests press and push what they like.
PLUG_IN = """
  window.__pad = {id: 'Test pad (standard)', connected: true, mapping: 'standard',
    axes: [0, 0, 0, 0], buttons: Array.from({length: 17}, () => ({pressed: false, value: 0}))}
  navigator.getGamepads = () => [window.__pad]
"""
UNPLUG = "navigator.getGamepads = () => [null]"
# Of a page whose test failed.
FACTS = """() => {
  const {state, field, map, counters, screen} = window.__agribot ?? {}
  const node = document.querySelector('.map'), canvas = map?.getCanvas()
  return {
    screen, counters, state: state?.(), has_field: Boolean(field?.()),
    map: map && {moving: map.isMoving(), center: map.getCenter(), zoom: map.getZoom(),
      bearing: map.getBearing(), node: [node?.clientWidth, node?.clientHeight],
      canvas: [canvas.clientWidth, canvas.clientHeight]},
    chosen: [...document.querySelectorAll('select')].map((select) => select.value),
    text: document.body.innerText.slice(0, 2000),
  }
}"""
WHY_NOT = ".why-not:not(:empty)"  # the reason why the pad does not drive
LEFT_SHOULDER = "window.__pad.buttons[4].pressed = %s"

# All that the page has said in messages that vanish.
KEEP_TOASTS = """
  window.__toasts = []
  const keep = (node) => node.classList?.contains('toast') && window.__toasts.push(node.textContent)
  new MutationObserver((changes) => changes.forEach((change) => change.addedNodes.forEach(keep)))
    .observe(document, { childList: true, subtree: true })
"""


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    chromium = machine.require("chromium-headless-shell")
    if not (PAGE / "index.html").is_file():
        pytest.fail("The page is not built: run `pip install -e .` or `npm run build` in web/.")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=GL_ARGS)
        yield browser
        browser.close()


@pytest.fixture
def server() -> Iterator[FakeServer]:
    fake = FakeServer()
    with serving(fake) as fake.address:
        yield fake


def new_context(browser: Browser, **options: Any) -> BrowserContext:
    """Its pages wait as long as all else does, not for Playwright's half a minute.

    They are drawn coarsely, but for tests that look at single pixels, and the map jumps to where
    it would glide. No colour is looked at half-way to another.
    """
    usual = {"device_scale_factor": COARSE, "reduced_motion": "reduce"}
    context = browser.new_context(**{**usual, **options})
    context.set_default_timeout(1000 * PATIENCE_S)
    context.add_init_script(KEEP_TOASTS)
    return context


@pytest.fixture
def sharpness() -> float:
    """For a test that looks at single pixels to override."""
    return COARSE


@pytest.fixture
def page_size() -> tuple[int, int]:
    """In pixels; a small map is drawn in less time."""
    return 1280, 800


@pytest.fixture
def context(
    browser: Browser, sharpness: float, page_size: tuple[int, int], request: pytest.FixtureRequest
) -> Iterator[BrowserContext]:
    context = new_context(
        browser,
        viewport={"width": page_size[0], "height": page_size[1]},
        device_scale_factor=sharpness,
        locale="en",
    )
    said: list[str] = []
    context.on("console", lambda line: said.append(f"{line.type}: {line.text}"))
    context.on("weberror", lambda error: said.append(f"error: {error.error}"))
    yield context
    if request.node.stash.get(HAS_FAILED, False):
        told = [*map(describe, context.pages), *said]
        request.node.add_report_section("teardown", "pages", "\n".join(told))
    context.close()


def describe(page: Page) -> str:
    """What a page shows and knows, to find out why its test failed."""
    try:
        page.locator("body").wait_for(timeout=1000 * ANSWERS_WITHIN_S)  # evaluate waits for ever
        return f"{page.url}: {page.evaluate(FACTS)}"
    except Error as error:
        return f"{page.url}: {error}"


OpenPage = Callable[..., Page]


@pytest.fixture
def open_page(context: BrowserContext, server: FakeServer) -> OpenPage:
    """Opens a screen and waits until the robot's data are there."""

    def go(screen: str = "drive", query: str = WITHOUT_GL, theme: str = "light") -> Page:
        context.add_init_script(f"localStorage.setItem('theme', '{theme}')")
        page = context.new_page()
        page.goto(f"{server.address}/?{query}#/{screen}")
        until(page, "window.__agribot?.ready")
        return page

    return go


@contextmanager
def shared_page(
    browser: Browser, address: str, size: tuple[int, int] = (1280, 800)
) -> Iterator[Page]:
    """Open a page that serves all tests of a file, once the robot's data are there."""
    width, height = size
    context = new_context(browser, viewport={"width": width, "height": height}, locale="en")
    page = context.new_page()
    page.goto(address)
    until(page, "window.__agribot?.ready")
    yield page
    context.close()


def until(page: Page, expression: str, patience_s: float = PATIENCE_S) -> Any:
    """The first true value of an expression; polled from here, for the page forbids eval."""

    def ask() -> Any:
        try:
            return page.evaluate(expression)
        except Error as error:
            if "context was destroyed" not in str(error):
                raise
            return None  # the page is being loaded anew

    return wait_for(ask, expression, patience_s)


def wait_for_toast(page: Page, *texts: str) -> None:
    """Wait until the page has said all of it in one of its short messages.

    They vanish after some seconds, which a slow machine may sleep through.
    """
    until(
        page, f"window.__toasts.some((said) => {list(texts)}.every((text) => said.includes(text)))"
    )


def hold_map_still(page: Page) -> None:
    """From now on the map neither follows the robot nor keeps the whole field in view."""
    page.get_by_role("button", name="Follow the robot").click()
    page.get_by_role("button", name="Zoom in").click()
    until(page, "!window.__agribot.map.isMoving()")


def show(page: Page, screen: str) -> None:
    page.evaluate(f"location.hash = '#/{screen}'")
    until(page, f"window.__agribot.screen === '{screen}'")


def take_control(page: Page) -> None:
    page.get_by_role("button", name="Take control").first.click()
    expect(page.locator(".operator")).to_contain_text("You")


def take_seat(page: Page) -> None:
    """Take control at the top of the page, which arms nothing."""
    page.locator(".operator").click()
    page.get_by_role("dialog").get_by_role("button", name="Take control").click()
    expect(page.locator(".operator")).to_contain_text("You")


def hand_over(page: Page) -> None:
    """Leave the seat, where the page has it."""
    operator = page.locator(".operator")
    if "You" in operator.inner_text():
        operator.click()
        page.get_by_role("dialog").get_by_role("button", name="Hand over").click()
        expect(operator).not_to_contain_text("You")


def drag_pad(page: Page) -> None:
    box = page.locator(".pad").bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 60)


def let_go_of_pad(page: Page) -> None:
    page.mouse.up()


def arm(page: Page) -> None:
    """However often it takes: a page whose data grew old is not armed until new ones come."""
    ask = page.get_by_role("dialog", name="Interrupt the mission?")
    waits = page.locator(WHY_NOT)

    def is_armed() -> bool:
        if page.locator(".pad.armed").is_visible():
            return True
        with contextlib.suppress(NotThere):
            if ask.is_visible():
                ask.get_by_role("button", name="Drive by hand").click(timeout=2000)
            elif not waits.count():
                page.locator(".arm", has_text="Drive by hand").click(timeout=2000)
        return False

    wait_for(is_armed, "a pad that drives")


def hold(
    page: Page,
    drives: Callable[[], object],
    press: Callable[[Page], None] = drag_pad,
    let_go: Callable[[Page], None] = let_go_of_pad,
) -> None:
    """Press until it drives; again where the page let go of a slow line, as its hint says."""

    def is_over() -> object:
        return drives() or page.locator(WHY_NOT).count()

    def has_driven() -> bool:
        arm(page)
        press(page)
        wait_for(is_over, "a drive by hand, or the reason why not")
        if drives():
            return True
        let_go(page)
        return False

    wait_for(has_driven, "the drive by hand")
