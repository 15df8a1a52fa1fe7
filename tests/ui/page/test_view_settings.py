"""What the map stays on, how large its pictures are, and where on earth it begins."""

from __future__ import annotations

import io
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from agribot.ui import wire
from tests import nightly
from tests.ui.page import display_messages as messages
from tests.ui.page.conftest import SHARP, OpenPage, until
from tests.ui.page.fake_robot import DATUM
from tests.ui.page.fake_server import FakeServer
from tests.ui.page.test_safety import commands
from tests.waiting import wait_for

pytestmark = nightly.by_day(
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests",
    "tests/ui/page/test_safety.py::test_stop_works_above_a_dialog_without_the_seat",
)

MAP = "window.__agribot.map"
ON_FIRST_ROW_M, ON_SECOND_ROW_M = 6.0, 20.0  # along the path: eastwards, then back

# A banner comes, goes, and is here once more for a moment between two frames, which an observer
# of sizes does not see.
BANNER = """() => new Promise((resolve) => {
  const map = document.querySelector('.map'), place = map.parentElement
  const has = (banner) => { place.style.marginBottom = banner ? '48px' : '0' }
  const atPlace = [() => has(true), () => has(false)]
  const atMap = [() => {}, () => {}, () => {
    has(true)
    for (const end = performance.now() + 80; performance.now() < end;);
    setTimeout(() => { has(false); resolve() })
  }]
  const watch = (node, steps) => {
    const seen = new ResizeObserver(() => steps.length ? steps.shift()() : seen.disconnect())
    seen.observe(node)
  }
  watch(place, atPlace)
  watch(map, atMap)
})"""


def opened(open_page: OpenPage, server: FakeServer) -> Page:
    server.robot.mode = "paused"
    page = open_page(query="off=scene,camera")
    until(page, f"{MAP}?.getLayer('rows')")
    page.get_by_role("button", name="Layers and views").click()
    return page


def put(page: Page, server: FakeServer, along_m: float) -> tuple[float, float]:
    """The robot there, when the page knows it; its longitude and latitude."""
    server.robot.s_m = along_m
    x_m, y_m, _ = server.robot.pose()
    until(page, f"Math.abs(window.__agribot.state().pose[0] - {x_m}) < 1e-3")
    lat_deg, lon_deg = messages.lat_lon(x_m, y_m)
    return lon_deg, lat_deg


def from_middle_px(page: Page, place: tuple[float, float]) -> float:
    at = page.evaluate(f"{MAP}.project([{place[0]}, {place[1]}])")
    canvas = page.evaluate(f"(c => [c.clientWidth, c.clientHeight])({MAP}.getCanvas())")
    return math.hypot(at["x"] - canvas[0] / 2, at["y"] - canvas[1] / 2)


def wait_middle(page: Page, place: tuple[float, float]) -> None:
    wait_for(lambda: from_middle_px(page, place) < 1.0, "the robot in the middle")


def wait_up(page: Page, compass_deg: float) -> None:
    off = f"(({MAP}.getBearing() - {compass_deg} + 900) % 360) - 180"
    until(page, f"Math.abs({off}) < 0.5")


def drag_map(page: Page) -> None:
    box = page.locator(".map canvas").first.bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 3, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 40, steps=4)
    page.mouse.up()


def test_the_map_stays_on_the_robot_and_turns_with_it_until_somebody_moves_the_map(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = opened(open_page, server)
    target = page.get_by_label("Target frame")
    expect(target).to_have_value("near")
    target.select_option("position")
    wait_middle(page, put(page, server, ON_FIRST_ROW_M))
    wait_middle(page, put(page, server, ON_SECOND_ROW_M))
    wait_up(page, 0.0)
    target.select_option("heading")
    wait_up(page, math.degrees(math.pi / 2 - server.robot.pose()[2]))
    place = put(page, server, ON_FIRST_ROW_M)
    wait_up(page, 90.0)
    page.get_by_role("button", name="Turn by 90°").click()
    wait_up(page, 180.0)
    wait_middle(page, place)
    drag_map(page)
    expect(target).to_have_value("map")
    put(page, server, ON_SECOND_ROW_M)
    assert from_middle_px(page, place) > 40.0
    page.get_by_role("button", name="Follow the robot").click()
    expect(target).to_have_value("heading")


def test_the_map_goes_after_a_robot_that_moved_while_the_map_did_and_says_no_more(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = opened(open_page, server)
    page.get_by_label("Target frame").select_option("position")
    wait_middle(page, put(page, server, ON_FIRST_ROW_M))
    slowly = "duration: 600000, essential: true"
    page.evaluate(f"{MAP}.easeTo({{ zoom: {MAP}.getZoom() - 1, {slowly} }})")
    place = put(page, server, ON_SECOND_ROW_M)
    server.silent = True
    assert page.evaluate(f"{MAP}.isMoving()") and from_middle_px(page, place) > 40.0
    page.evaluate(f"{MAP}.stop()")
    wait_middle(page, place)


def test_the_map_fills_its_place_and_stays_on_the_robot_where_banners_come_and_go(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = opened(open_page, server)
    page.get_by_label("Target frame").select_option("position")
    page.evaluate(BANNER)
    wait_middle(page, put(page, server, ON_FIRST_ROW_M))
    box = page.locator(".map").bounding_box()
    assert box and page.evaluate(f"{MAP}.getCanvas().clientHeight") == box["height"]


def test_stop_works_while_the_map_shows_all_the_earth_and_cannot_have_the_robot_in_its_middle(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = opened(open_page, server)
    page.get_by_label("Target frame").select_option("position")
    page.evaluate(f"setTimeout(() => {MAP}.jumpTo({{ zoom: 0 }}))")
    page.locator("#stop").click()
    wait_for(lambda: commands(server, wire.PressStop), "a stop command")
    assert page.evaluate(f"{MAP}.getZoom()") < 1.0


def test_target_and_size_of_pictures_are_kept_with_the_view(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = opened(open_page, server)
    target, size = page.get_by_label("Target frame"), page.get_by_label("Pictures and videos")
    target.select_option("heading")
    size.select_option("720p")
    page.get_by_role("button", name="Save view").click()
    page.get_by_label("Name of the view").fill("Mine")
    page.keyboard.press("Enter")
    saved = wait_for(lambda: server.written.get("views/Mine"), "the saved view")
    assert (saved["target"], saved["turn"], saved["capture"]) == ("heading", 0, "720p")
    target.select_option("map")
    size.select_option("window")
    server.answers["views"] = ["Mine"]
    page.get_by_role("button", name="Open view").click()
    page.get_by_role("dialog").get_by_role("button", name="Mine").click()
    expect(target).to_have_value("heading")
    expect(size).to_have_value("720p")
    wait_middle(page, put(page, server, ON_FIRST_ROW_M))
    wait_up(page, 90.0)
    page.reload()
    until(page, f"window.__agribot?.ready && {MAP}?.getLayer('rows')")
    page.get_by_role("button", name="Layers and views").click()
    expect(page.get_by_label("Target frame")).to_have_value("heading")


@pytest.mark.parametrize("sharpness", [SHARP])  # compared with the screen pixel by pixel
def test_pictures_have_the_size_that_was_chosen_and_show_the_middle_of_the_map_undistorted(
    open_page: OpenPage, server: FakeServer
) -> None:
    page = opened(open_page, server)
    page.get_by_label("Target frame").select_option("map")
    for choice, (width, height) in {"480p": (640, 480), "720p": (1280, 720)}.items():
        page.get_by_label("Pictures and videos").select_option(choice)
        with page.expect_download() as file:
            page.get_by_role("button", name="Save a picture of the map").click()
        picture = Image.open(file.value.path()).convert("RGB")
        assert picture.size == (width, height)
        page.add_style_tag(content=".map-controls, .maplibregl-control-container { opacity: 0 }")
        screen = Image.open(io.BytesIO(page.locator(".map").screenshot())).convert("RGB")
        scale = max(width / screen.width, height / screen.height)
        large = screen.resize((round(screen.width * scale), round(screen.height * scale)))
        left, top = (large.width - width) // 2, (large.height - height) // 2
        middle = large.crop((left, top, left + width, top + height))
        off = np.abs(np.asarray(picture, dtype=float) - np.asarray(middle, dtype=float))
        assert np.median(off) < 3.0
        assert off.mean() < 8.0


def test_a_video_keeps_the_size_with_which_it_began(
    open_page: OpenPage, server: FakeServer, tmp_path: Path
) -> None:
    page = opened(open_page, server)
    size = page.get_by_label("Pictures and videos")
    size.select_option("480p")
    page.get_by_role("button", name="Record a video of the map").click()
    page.evaluate(f"window.__drawn = 0; {MAP}.on('render', () => window.__drawn++)")
    until(page, "window.__drawn > 4")
    size.select_option("720p")
    until(page, "window.__drawn > 9")
    with page.expect_download() as file:
        page.get_by_role("button", name="Record a video of the map").click()
    film = tmp_path / "map.webm"
    file.value.save_as(film)
    video = cv2.VideoCapture(str(film))
    shapes = set()
    while True:
        is_read, frame = video.read()
        if not is_read:
            break
        shapes.add(frame.shape)
    video.release()
    assert shapes == {(480, 640, 3)}


def test_the_origin_of_the_map_is_told(open_page: OpenPage, server: FakeServer) -> None:
    page = opened(open_page, server)
    place = f"Origin {DATUM.lat_deg:.7f}, {DATUM.lon_deg:.7f} · home"
    expect(page.get_by_role("group", name="Layers")).to_contain_text(place)
