"""The page on the real server and the simulated robot with its camera: what is seen is shown.

One robot serves all tests of this file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from statistics import median

import pytest
from playwright.sync_api import Browser, Page, expect

from agribot.lab.dataset.check import check
from agribot.lab.dataset.layouts import find_layout
from tests import nightly
from tests.ui.page.conftest import WITHOUT_GL, shared_page, show, until, wait_for_toast
from tests.ui.page.robots import Robot, robot_with_page
from tests.ui.page.test_with_the_robot import in_charge, on_its_mission
from tests.waiting import wait_for

SETTINGS = ["--set", "perception.camera_rate_hz=2", "--set", "seed=1"]

# How green a weed's picture is, 2 G - R - B, in its middle and in its corners.
GREENS = """() => {
  const picture = document.querySelector('.weed-picture img')
  if (!picture?.naturalWidth) return [null, null]
  const canvas = document.createElement('canvas')
  const side = canvas.width = canvas.height = picture.naturalWidth
  const pen = canvas.getContext('2d')
  pen.drawImage(picture, 0, 0)
  const part = Math.round(side / 5)
  const green = (x, y) => {
    const {data} = pen.getImageData(x, y, part, part)
    let sum = 0
    for (let i = 0; i < data.length; i += 4) sum += 2 * data[i + 1] - data[i] - data[i + 2]
    return sum / (data.length / 4)
  }
  const end = side - part, middle = Math.round(side / 2 - part / 2)
  const corners = [green(0, 0), green(end, 0), green(0, end), green(end, end)].sort((a, b) => a - b)
  return [green(middle, middle), (corners[1] + corners[2]) / 2]
}"""
WEED_GREEN = 20.0


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    out_dir = tmp_path_factory.mktemp("runs") / "run"
    with robot_with_page("farm", out_dir, SETTINGS) as robot:
        yield robot


@pytest.fixture(scope="module")
def page(browser: Browser, robot: Robot) -> Iterator[Page]:
    with shared_page(browser, f"{robot.address}/?{WITHOUT_GL}#/drive") as page:
        yield page


@nightly.by_day(
    "tests/ui/test_streams.py::test_a_page_that_comes_late_has_the_whole_trace_and_all_weeds",
    "tests/ui/page/test_screens.py::test_the_map_draws_the_field_the_weeds_and_the_track",
)
def test_plants_are_mapped_as_the_robot_passes_them(page: Page) -> None:
    on_its_mission(page)
    until(page, "window.__agribot.counters.weeds >= 3")
    show(page, "weeds")
    expect(page.locator("main")).to_contain_text(re.compile(r"[1-9]\d* of [1-9]\d* plants"))


@nightly.by_day(
    "tests/ui/test_plant_pictures.py::test_the_plant_stands_in_the_middle_of_its_picture",
    "tests/ui/test_plant_pictures.py"
    "::test_a_browser_gets_the_picture_of_a_weed_and_when_it_was_taken",
    "tests/ui/page/test_weed_details.py::test_the_card_of_a_plant_follows_what_becomes_of_it",
)
def test_a_weed_is_shown_as_the_camera_saw_it(page: Page) -> None:
    on_its_mission(page)
    show(page, "weeds")
    page.get_by_label("Crop", exact=True).uncheck()
    picture = page.get_by_role("img", name=re.compile(r"Weed \d+ in the camera"))
    expect(page.locator(".count")).to_contain_text(re.compile(r"^[1-9]\d* of"))

    looks: dict[str, list[float]] = {}

    def has_looked_at_some() -> bool:
        page.get_by_role("button", name="Plant before").click()
        page.locator(".weed-picture figcaption").wait_for()
        if picture.count():
            wait_for(lambda: page.evaluate(GREENS)[0] is not None, "the picture itself")
            looks[picture.get_attribute("alt") or ""] = page.evaluate(GREENS)
        return len(looks) >= 3 and picture.count() > 0

    wait_for(has_looked_at_some, "pictures of three weeds")
    middles, corners = zip(*looks.values(), strict=True)
    assert median(middles) > WEED_GREEN > median(corners), looks
    details = page.locator(".details").first
    for fact in ("Weed", "Picture from", "Confidence", "East, north"):
        expect(details).to_contain_text(fact)


@nightly.by_day(
    "tests/ui/test_saved_frames.py::test_kept_frames_are_a_set_that_passes_the_check",
    "tests/ui/test_saved_frames.py::test_only_the_seat_keeps_frames_and_is_told_where",
)
def test_the_operator_keeps_a_frame_that_teaches_networks(page: Page, robot: Robot) -> None:
    in_charge(page)
    show(page, "camera")
    page.get_by_role("button", name="Keep for training").click()
    folder = robot.out_dir.parent / "frames"
    wait_for_toast(page, "Kept images/", "frames there: 1.", str(folder))
    found = check(find_layout(folder), lambda _: None)
    assert (found.ok, found.pairs, found.sizes) == (True, 1, {"640x480": 1})
