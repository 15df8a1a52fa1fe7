"""Topics of a real ROS 1 on the map: chosen in the dialog, drawn in place, pale when they stop."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import msgspec
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from agribot.ui import wire
from agribot.ui.about import About, RosPlaces
from tests import machine, nightly
from tests.ros.messages.shown_scene import LASER, make_scene
from tests.ros.ros1_system import Ros1
from tests.ros.scene_talker import start_talker
from tests.ui import conftest, messages
from tests.ui.page.conftest import SHARP, new_context, until
from tests.waiting import wait_for

pytestmark = nightly.by_day(
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests",
    "tests/ui/test_topic_feeds.py::test_a_topic_comes_once_in_the_map_by_its_frame",
    "tests/ui/test_topic_feeds.py::test_a_topic_that_stops_is_stale_and_one_that_spoke_once_is_not",
)
MAP = "window.__agribot.map"


class Robot(conftest.Robot):
    """A robot whose page looks for topics at a master of the test."""

    master = ""

    def _about(self, port: int) -> About:
        return msgspec.structs.replace(super()._about(port), ros=RosPlaces(master=self.master))


@pytest.fixture
def ros(tmp_path: Path) -> Iterator[Ros1]:
    machine.require("roscore")
    found = Ros1(tmp_path)
    yield found
    found.close()


@pytest.fixture
def robot(ros: Ros1, tmp_path: Path) -> Iterator[Robot]:
    found = Robot(tmp_path)
    found.master = ros.uri
    found.answers[wire.ListPanels] = []
    found.start()
    is_over = threading.Event()
    ticking = threading.Thread(target=say_states, args=(found, is_over))
    ticking.start()
    yield found
    is_over.set()
    ticking.join()
    found.server.close()


def say_states(robot: Robot, is_over: threading.Event) -> None:
    """Keep the page's state fresh, for it turns grey otherwise."""
    number = 0
    while not is_over.wait(0.2):
        number += 1
        robot.say(messages.make_state(number))


def add(page: Page, display: str, topic: str) -> None:
    page.get_by_role("button", name="Add display").click()
    dialog = page.get_by_role("dialog")
    dialog.locator("select").first.select_option(display)
    option = dialog.locator(f'optgroup[label="ROS 1"] option[value="ros1:{topic}"]')
    option.wait_for(state="attached")
    dialog.locator("select").nth(1).select_option(f"ros1:{topic}")
    dialog.get_by_role("button", name="Add", exact=True).click()


def count_shapes(page: Page, number: int, part: str) -> int:
    layers = f"{{layers: ['display-{number}-{part}']}}"
    found: int = page.evaluate(f"{MAP}.queryRenderedFeatures({layers}).length")
    return found


def test_displays_take_topics_of_ros_are_drawn_and_grow_pale_when_they_stop(
    browser: Browser, robot: Robot, ros: Ros1
) -> None:
    talker = start_talker(ros)
    size = {"width": 1280, "height": 900}
    context = new_context(browser, viewport=size, device_scale_factor=SHARP, locale="en")
    page = context.new_page()
    page.goto(f"http://127.0.0.1:{robot.port}/?off=scene,camera#/drive")
    until(page, f"window.__agribot?.ready && {MAP}?.isStyleLoaded()")
    page.get_by_role("button", name="Layers and views").click()
    wanted = [(said.display, said.topic) for said in make_scene() if said.display]
    numbers = {display: number for number, (display, _) in enumerate(wanted, 1)}
    for display, topic in wanted:
        add(page, display, topic)
    left_out = page.locator(".layer-note", has_text="1,000,000 points thinned to 20,000")
    expect(left_out).to_be_visible()
    page.get_by_role("button", name="Layers and views").click()
    datum = page.evaluate("window.__agribot.field().datum")
    centre = f"[{datum['lon_deg'] + LASER[0] / 104_000}, {datum['lat_deg'] + 1.0 / 111_000}]"
    page.evaluate(f"{MAP}.jumpTo({{center: {centre}, zoom: 20}})")
    for display, part in (("laserscan", "point"), ("pointcloud2", "point"), ("marker", "fill")):
        number = numbers[display]
        wait_for(partial(count_shapes, page, number, part), f"shapes of {display}")
    for display in ("occupancy_grid", "textured_marker"):
        until(page, f"Boolean({MAP}.getSource('display-{numbers[display]}'))")
    wait_for(lambda: is_disparity_shown(page), "the colours of the disparity")
    expect(page.locator(".map-conditions")).to_contain_text("frame 'moon' is not known")
    ros.stop(talker)
    expect(page.locator(".map-conditions .stale").first).to_contain_text("no message for")
    page.reload()
    until(page, f"window.__agribot?.ready && {MAP}?.isStyleLoaded()")
    expect(page.locator(".map-conditions")).to_contain_text("Laser scan: no message")
    context.close()


def is_disparity_shown(page: Page) -> bool:
    """Whether the picture at the top runs from blue to red."""
    box = page.locator(".map").bounding_box()
    assert box is not None
    picture = Image.open(io.BytesIO(page.locator(".map").screenshot())).convert("RGB")
    middle = picture.width // 2
    left, right = (picture.getpixel((middle + x, 160)) for x in (-115, 115))
    assert isinstance(left, tuple)
    assert isinstance(right, tuple)
    return left[2] > 150 > left[0] and right[0] > 150 > right[2]
