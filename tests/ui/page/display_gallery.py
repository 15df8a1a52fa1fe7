"""Each display of the map in a picture of its own, with a topic of a real network."""

from __future__ import annotations

import io
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Locator, Page

from agribot.core.geo import Datum, MapFrame
from agribot.gis.raster_import import import_geo
from agribot.ui import wire
from agribot.ui.about import About, RosPlaces
from tests.ros.live import free_port, program
from tests.ros.messages.gallery_scene import (
    CENTRE,
    ROBOT,
    Shown,
    make_frames,
    make_gallery,
    make_route_position,
)
from tests.ros.publications import Publication, write_for_ros2
from tests.ros.ros1_system import Ros1
from tests.ros.scene_talker import start_talker
from tests.ui import conftest, messages
from tests.ui.page.conftest import SHARP, hold_map_still, new_context, until
from tests.ui.page.drawn_ground import write_pyramid
from tests.waiting import wait_for

NETWORKS = {"ros1": "ROS 1", "ros2": "ROS 2", "dds": "ROS 2 on DDS"}
SIZE_PX = (480, 320)
ZOOM = 21.0
FIELD = Datum(lat_deg=21.161289, lon_deg=72.787022)
HINT_PX = 6  # below what a tool says
MAP = "window.__agribot.map"
TRACK_M = (8.0, 6.0)  # how far a whole lap reaches to the east and the north
LEAST_PLACES = 20  # of the 24 of a lap
LEAST_CHANGED = 60  # pixels of a display in its picture
TO_SEE = 40  # levels of a colour


class Robot(conftest.Robot):
    """A robot that stands on the farm, whose page looks for topics at `places`."""

    places = RosPlaces()

    def _about(self, port: int) -> About:
        return msgspec.structs.replace(super()._about(port), ros=self.places)


@contextmanager
def standing_robot(folder: Path, places: RosPlaces) -> Iterator[Robot]:
    robot, is_over = Robot(folder), threading.Event()
    robot.places = places
    robot.answers[wire.ListPanels] = []
    robot.answers[wire.PreviewGoal] = WAY
    robot.start()
    ticking = threading.Thread(target=say_states, args=(robot, is_over))
    ticking.start()
    try:
        yield robot
    finally:
        is_over.set()
        ticking.join()
        robot.server.close()


def say_states(robot: Robot, is_over: threading.Event) -> None:
    """Keep the page's state fresh, for it turns grey otherwise."""
    number = 0
    while not is_over.wait(0.2):
        number += 1
        state = messages.make_state(number, "paused")
        robot.say(
            msgspec.structs.replace(
                state, pose=ROBOT, pos_std_m=0.02, yaw_std_rad=0.02, tilt_rad=(0.0, 0.0)
            )
        )


@contextmanager
def talker(network: str, folder: Path) -> Iterator[RosPlaces]:
    """A program of this network that publishes the gallery; gives where the page finds it."""
    others = [
        Publication("/tf_static", [make_frames()], 0.0),
        Publication("/route_position", [make_route_position()], 0.0),
    ]
    shown = [one for one in make_gallery(FIELD) if one.messages]
    said = [*others, *(Publication(one.topic, one.messages, one.rate_hz) for one in shown)]
    domain = 140 + os.getpid() % 20
    nowhere = RosPlaces(
        master=f"http://127.0.0.1:{free_port()}",
        router=f"tcp/127.0.0.1:{free_port()}",
        domain=domain,
    )
    if network == "ros1":
        ros = Ros1(folder)
        try:
            start_talker(ros, said)
            yield msgspec.structs.replace(nowhere, master=ros.uri)
        finally:
            ros.close()
        return
    scene = folder / "scene.jsonl"
    write_for_ros2(scene, said)
    router = [nowhere.router] if network == "ros2" else []
    command = ("-m", "tests.ros.ros2_talker", str(scene), str(domain), *router)
    with program(sys.executable, *command):
        yield nowhere


class Gallery:
    """A page on a robot beside a talker of `network`."""

    def __init__(self, browser: Browser, network: str, folder: Path) -> None:
        self.network, self._parts = network, ExitStack()
        places = self._parts.enter_context(talker(network, folder))
        self.robot = self._parts.enter_context(standing_robot(folder, places))
        context = new_context(
            browser, viewport={"width": 1120, "height": 640}, device_scale_factor=SHARP, locale="en"
        )
        self._parts.callback(context.close)
        self.page = context.new_page()
        self.titles: dict[str, str] = {}  # by display, as the dialog has them
        self._open()
        self.blank = self.photograph()

    def _open(self) -> None:
        self.page.goto(f"http://127.0.0.1:{self.robot.port}/?off=scene,camera#/drive")
        until(self.page, f"window.__agribot?.ready && {MAP}?.isStyleLoaded()")
        hold_map_still(self.page)
        look_at(self.page, CENTRE)

    def close(self) -> None:
        self._parts.close()

    def photograph(self) -> Image.Image:
        """The map without a short message over it."""
        until(self.page, "!document.querySelector('.toast')")
        until(self.page, f"{MAP}.loaded() && !{MAP}.isMoving()")
        return Image.open(io.BytesIO(self.page.locator(".map").screenshot())).convert("RGB")

    def show(self, shown: Shown) -> Image.Image:
        """Add a display in the dialog, wait until it is drawn, and remove it."""
        with layers_open(self.page):
            self._add(shown)
        if len(shown.messages) > 1:
            wait_for(self._is_whole, f"a lap of {shown.display}")
        if shown.part:
            wait_for(partial(self._has, shown.part), f"the {shown.part} of {shown.display}")
        is_moving = len(shown.messages) > 1
        found = wait_for(partial(self._photograph_changed, is_moving), f"the {shown.display}")
        with layers_open(self.page):
            self.page.get_by_role("button", name=f"Change {shown.display}").click()
            self.page.get_by_role("button", name="Remove", exact=True).click()
        return cut_middle(found)

    def show_map(self, display: str, side_m: float) -> Image.Image:
        """Import a picture of the ground, which the page shows from then on."""
        home = Path(os.environ["AGRIBOT_HOME"])
        for other in (home / "maps").glob("*.mbtiles"):
            other.unlink()
        file = write_pyramid(home / "pictures" / display, MapFrame(FIELD), side_m, CENTRE)
        import_geo(file, home / "maps" / f"{display}.mbtiles", lambda _done, _of: None)
        self.page.goto("about:blank")
        self._open()
        with layers_open(self.page):
            dialog = self._choose(display)
            dialog.locator("select").nth(1).select_option(display)
            dialog.get_by_role("button", name="Add", exact=True).click()
        return cut_middle(wait_for(partial(self._photograph_changed, False), display))

    def use(self, tool: str) -> Image.Image:
        """Draw with a tool; nothing is sent."""
        button = self.page.get_by_role("button", name=tool)
        button.click()
        if tool == "Drive to a place":
            self._drag(TAPS[tool])
        else:
            for place in TAPS[tool]:
                self.page.mouse.click(*self._find_px(place))
        found = wait_for(partial(self._photograph_changed, False), tool)
        hint = self._find_hint()
        button.click()
        return cut_above(found, hint)

    def _find_hint(self) -> float:
        """Find the lower edge of what a tool says, in pixels of the map."""
        says = self.page.locator(".map-hint:visible, .map-proposal:visible").last
        hint = says.bounding_box()
        box = self.page.locator(".map").bounding_box()
        assert box is not None
        return hint["y"] + hint["height"] - box["y"] if hint is not None else 0.0

    def _drag(self, places: Sequence[tuple[float, float]]) -> None:
        start, end = map(self._find_px, places)
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(*end)
        self.page.mouse.up()

    def _find_px(self, place_m: tuple[float, float]) -> tuple[float, float]:
        lat_deg, lon_deg, _ = MapFrame(FIELD).geodetic_from_map(*place_m)
        at = self.page.evaluate(f"(({MAP}.project([{lon_deg}, {lat_deg}])))")
        box = self.page.locator(".map").bounding_box()
        assert box is not None
        return box["x"] + at["x"], box["y"] + at["y"]

    def _choose(self, display: str) -> Locator:
        """Open the dialog with a kind of display."""
        self.page.get_by_role("button", name="Add display").click()
        dialog = self.page.get_by_role("dialog")
        kinds = dialog.locator("select").first
        kinds.select_option(display)
        self.titles[display] = kinds.locator("option:checked").inner_text()
        return dialog

    def _add(self, shown: Shown) -> None:
        dialog = self._choose(shown.display)
        if shown.topic:
            topic = f"{self.network}:{shown.topic}"
            group = f'optgroup[label="{NETWORKS[self.network]}"]'
            option = dialog.locator(f'{group} option[value="{topic}"]')
            option.wait_for(state="attached")
            dialog.locator("select").nth(1).select_option(topic)
        dialog.get_by_label("Name", exact=True).fill(shown.display)
        for name, value in shown.options.items():
            set_option(dialog.get_by_label(name, exact=False).first, value)
        dialog.get_by_role("button", name="Add", exact=True).click()

    def _photograph_changed(self, is_moving: bool) -> Image.Image | None:
        """A picture in which the display is; one that does not move is twice the same."""
        before, found = self.photograph(), self.photograph()
        middles = [cut_middle(each) for each in (self.blank, before, found)]
        is_still = count_changed(middles[1], middles[2]) < LEAST_CHANGED
        is_there = count_changed(middles[0], middles[2]) >= LEAST_CHANGED
        return found if is_there and (is_moving or is_still) else None

    def _has(self, part: str) -> bool:
        """Whether displays draw something in their layers of this name."""
        layers = (
            f"{MAP}.getStyle().layers.map(l => l.id).filter(id => /^display-.*{part}$/.test(id))"
        )
        return bool(self.page.evaluate(f"{MAP}.queryRenderedFeatures({{layers: {layers}}}).length"))

    def _is_whole(self) -> bool:
        """Whether all of a lap is drawn."""
        *reach, count = self.page.evaluate(REACH)
        is_wide = [metres > least for metres, least in zip(to_metres(reach), TRACK_M, strict=True)]
        return all(is_wide) and count >= LEAST_PLACES


# To the goal that is shown.
WAY = wire.GoalPreview(
    points_map_m=[(3.5, 5.0), (3.5, 11.0), (1.0, 11.6), (-0.6, 9.6), (0.0, 8.0)],
    length_m=12.8,
    time_s=32.0,
)
# What each tool is shown, m in the map.
TAPS: dict[str, list[tuple[float, float]]] = {
    "Measure": [(-1.5, 4.5), (-1.5, 9.5), (8.0, 9.5)],
    "Read position": [(6.0, 8.0)],
    "Plan a route": [(3.5, 10.5), (8.0, 10.5), (8.0, 5.0)],
    "Drive to a place": [(0.0, 8.0), (1.5, 9.5)],
    "Publish a point": [(7.5, 6.0)],
    "Draw a polygon": [(0.0, 3.5), (7.5, 4.5), (6.5, 10.0), (-0.5, 9.0), (0.0, 3.5)],
}
# West, south, east and north of what displays draw, and the number of its places.
REACH = """() => {
  const map = window.__agribot.map, all = []
  const places = new Set()
  const layers = map.getStyle().layers.map(layer => layer.id).filter(id => /^display-/.test(id))
  const add = (at) => typeof at[0] === 'number' ? all.push(at) : at.forEach(add)
  map.queryRenderedFeatures({layers})
    .forEach(({geometry: {type, coordinates}}) => {
      add(coordinates)
      const own = type === 'LineString' ? coordinates : [coordinates.flat(2).slice(0, 2)]
      own.forEach(at => places.add(at.map(degrees => degrees.toFixed(6)).join()))
    })
  if (!all.length) return [0, 0, 0, 0, 0]
  const of = (axis) => all.map(at => at[axis])
  return [Math.min(...of(0)), Math.min(...of(1)), Math.max(...of(0)), Math.max(...of(1)),
    places.size]
}"""


def to_metres(reach: Sequence[float]) -> tuple[float, float]:
    west, south, east, north = reach
    frame = MapFrame(FIELD)
    (x0, y0, _), (x1, y1, _) = (
        frame.map_from_geodetic(lat, lon, 0.0) for lat, lon in ((south, west), (north, east))
    )
    return x1 - x0, y1 - y0


def set_option(control: Locator, value: str) -> None:
    if control.evaluate("each => each.tagName") == "SELECT":
        control.select_option(value)
    else:
        control.fill(value)


@contextmanager
def layers_open(page: Page) -> Iterator[None]:
    button = page.get_by_role("button", name="Layers and views")
    button.click()
    yield
    button.click()


def look_at(page: Page, place_m: tuple[float, float]) -> None:
    lat_deg, lon_deg, _ = MapFrame(FIELD).geodetic_from_map(*place_m)
    page.evaluate(f"{MAP}.jumpTo({{center: [{lon_deg}, {lat_deg}], zoom: {ZOOM}}})")


def cut_middle(whole: Image.Image) -> Image.Image:
    left, top = ((have - want) // 2 for have, want in zip(whole.size, SIZE_PX, strict=True))
    return whole.crop((left, top, left + SIZE_PX[0], top + SIZE_PX[1]))


def cut_above(whole: Image.Image, bottom_px: float) -> Image.Image:
    """Cut all of the map's width above `bottom_px`, in the shape of the other pictures."""
    bottom = min(round(bottom_px) + HINT_PX, whole.height)
    return whole.crop((0, bottom - whole.width * SIZE_PX[1] // SIZE_PX[0], whole.width, bottom))


def count_changed(before: Image.Image, after: Image.Image) -> int:
    """Count the pixels that look different."""
    apart = np.asarray(before, dtype=int) - np.asarray(after, dtype=int)
    return int((np.abs(apart).max(axis=-1) > TO_SEE).sum())
