"""Every kind of display of the map draws what its message says: mapviz's plugins, one by one.

One page shows them all; each test looks at the place of its own.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from agribot.ui import wire
from tests import nightly
from tests.ui.page import display_messages as messages
from tests.ui.page import fake_answers
from tests.ui.page.conftest import SHARP, hold_map_still, new_context, take_control, until
from tests.ui.page.fake_server import FakeServer, serving
from tests.ui.page.test_safety import STOP_FREE, commands
from tests.ui.page.test_screens import AXE, violations
from tests.waiting import wait_for

pytestmark = nightly.by_day(
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests",
    "tests/ui/page/test_places.py"
    "::test_a_goal_and_a_pose_are_sent_when_they_are_confirmed_and_not_before",
)

TILES = {"url": "/tiles/farm/{z}/{x}/{y}", "minzoom": 0, "maxzoom": 22, "attribution": ""}
NEAR_RGB = 40
MAP = "window.__agribot.map"


@pytest.fixture(scope="module")
def server() -> Iterator[FakeServer]:
    fake = FakeServer(weeds=0)
    fake.robot.mode = "paused"
    fake.answers["panels"] = messages.panels()
    west, south = reversed(messages.lat_lon(-6.0, -30.0))
    east, north = reversed(messages.lat_lon(-4.0, -4.0))
    east_2, north_2 = reversed(messages.lat_lon(32.0, -22.0))
    fake.answers["maps"] = [
        {**TILES, "name": "aerial", "bounds": [west, south, east, north]},
        {**TILES, "name": "pyramid", "bounds": [east, south, east_2, north_2]},
    ]
    for kind, (message, _) in messages.MESSAGES.items():
        fake.written[f"panels/layer-{kind}"] = message
    with serving(fake) as fake.address:
        yield fake


@pytest.fixture(scope="module")
def page(browser: Browser, server: FakeServer) -> Iterator[Page]:
    context = new_context(
        browser, viewport={"width": 1280, "height": 900}, device_scale_factor=SHARP, locale="en"
    )
    page = context.new_page()
    page.goto(f"{server.address}/?off=scene,camera#/drive")
    until(page, f"window.__agribot?.ready && {MAP}?.getLayer('layer-tf_frame-fill')")
    take_control(page)
    lat_deg, lon_deg = messages.lat_lon(12.0, -9.0)
    hold_map_still(page)
    page.evaluate(f"{MAP}.jumpTo({{center: [{lon_deg}, {lat_deg}], zoom: 20.5}})")
    yield page
    context.close()


def pixel_of(page: Page, x_m: float, y_m: float) -> tuple[float, float]:
    """Where a place lies, in pixels of the map."""
    lat_deg, lon_deg = messages.lat_lon(x_m, y_m)
    at = page.evaluate(f"(({MAP}.project([{lon_deg}, {lat_deg}])))")
    return at["x"], at["y"]


def drawn(page: Page, kind: str, x_m: float, y_m: float, reach_px: int = 6) -> list[dict[str, Any]]:
    """The looks of a display's shapes that touch a place."""
    x, y = pixel_of(page, x_m, y_m)
    box = [[x - reach_px, y - reach_px], [x + reach_px, y + reach_px]]
    names = [f"layer-{kind}-{part}" for part in ("fill", "line", "point", "label")]
    found = page.evaluate(
        f"{MAP}.queryRenderedFeatures({json.dumps(box)}, {{layers: {json.dumps(names)}}})"
        ".map(f => ({...f.properties, part: f.layer.id.split('-').pop()}))"
    )
    return list(found)


def wait_drawn(page: Page, kind: str, x_m: float, y_m: float) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = wait_for(
        lambda: drawn(page, kind, x_m, y_m), f"a {kind} at {x_m}, {y_m}"
    )
    return found


def wait_rgb(page: Page, at: tuple[float, float], rgb: tuple[int, int, int]) -> None:
    wait_for(lambda: is_rgb(page, at, rgb), f"{rgb} at {at}")


def colours(page: Page) -> Image.Image:
    return Image.open(io.BytesIO(page.locator(".map").screenshot())).convert("RGB")


def is_rgb(page: Page, at: tuple[float, float], rgb: tuple[int, int, int]) -> bool:
    found = colours(page).getpixel((round(at[0]), round(at[1])))
    assert isinstance(found, tuple)
    return all(abs(a - b) < NEAR_RGB for a, b in zip(found, rgb, strict=True))


def has_rgb(page: Page, x_m: float, y_m: float, rgb: tuple[int, int, int]) -> bool:
    return is_rgb(page, pixel_of(page, x_m, y_m), rgb)


def wait_for_rgb(page: Page, x_m: float, y_m: float, rgb: tuple[int, int, int]) -> None:
    wait_for(lambda: has_rgb(page, x_m, y_m, rgb), f"{rgb} at {x_m}, {y_m}")


def test_fixes_are_tracks_of_arrows_and_points(page: Page) -> None:
    """P6 and P13; a GPSFix heads east where its track says 90 degrees."""
    assert wait_drawn(page, "gps", 0.0, -7.0)[0]["color"] == "#c40000"
    wait_for(
        lambda: "fill" in {shape["part"] for shape in drawn(page, "gps", 0.8, -7.0)}, "an arrow"
    )
    assert not drawn(page, "gps", -0.8, -7.0)
    point = wait_drawn(page, "navsat", 8.0, -7.0)[0]
    assert (point["part"], point["color"]) == ("point", "#008000")


def test_a_grid_has_its_cells_where_it_was_put(page: Page) -> None:
    """P7: four by four cells of half a metre from (4, -9)."""
    assert wait_drawn(page, "grid", 6.0, -7.0)[0]["color"] == "#0000c4"
    assert drawn(page, "grid", 4.0, -9.0)
    assert not drawn(page, "grid", 6.5, -6.5, reach_px=2)
    assert not drawn(page, "grid", 4.25, -8.75, reach_px=2)


def test_a_laser_scan_moves_with_the_robot(page: Page, server: FakeServer) -> None:
    """P9: the echo straight ahead lies 2 m before it, the ray without an echo draws nothing."""
    x_m, y_m, _ = server.robot.pose()
    assert wait_drawn(page, "laserscan", x_m + 2.0, y_m)[0]["color"] == "#00c8c8"
    assert not drawn(page, "laserscan", x_m + 1.0, y_m)
    count = f"{MAP}.queryRenderedFeatures({{layers: ['layer-laserscan-point']}}).length"
    assert page.evaluate(count) == 30


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("arrow", "fill"), ("cube", "fill"), ("sphere", "fill"), ("cylinder", "fill"),
        ("strip", "line"), ("list", "line"), ("cubes", "fill"), ("spheres", "fill"),
        ("points", "point"), ("text", "label"), ("mesh", "fill"), ("triangle", "fill"),
    ],
)  # fmt: skip
def test_each_kind_of_marker_is_drawn_in_its_colour(page: Page, name: str, part: str) -> None:
    """P10."""
    beside_m = 0.4 if name in {"cubes", "spheres", "points"} else 0.0
    found = wait_drawn(page, "marker", messages.MARKER_X[name] + beside_m, messages.MARKER_Y)
    assert part in {shape["part"] for shape in found}
    assert found[0]["color"] == "rgb(255 128 0)"
    if name == "text":
        assert found[0]["label"] == "weed 7"


def test_a_deleted_marker_is_gone(page: Page) -> None:
    wait_drawn(page, "marker", 0.0, messages.MARKER_Y)
    assert not drawn(page, "marker", -3.0, messages.MARKER_Y)


def test_an_occupancy_grid_lies_where_its_origin_says(page: Page) -> None:
    """P14: white is free, black occupied, grey unknown."""
    wait_for_rgb(page, 12.5, -7.5, (255, 255, 255))
    assert has_rgb(page, 13.5, -7.5, (0, 0, 0))
    assert has_rgb(page, 13.5, -6.25, (146, 163, 155))


def test_odometry_has_an_ellipse_of_its_covariance(page: Page) -> None:
    """P15: 2.45 sigmas, 0.5 m east and 0.2 m north."""
    assert wait_drawn(page, "odometry", 18.0, -7.0)[0]["color"] == "#8b2fc9"
    assert drawn(page, "odometry", 18.0 + 1.15, -7.0, reach_px=1)
    assert not drawn(page, "odometry", 18.0 + 1.4, -7.0, reach_px=1)
    assert not drawn(page, "odometry", 18.0, -7.0 + 0.7, reach_px=1)


def test_a_path_and_a_route_are_lines_and_the_place_on_the_route_an_arrow(page: Page) -> None:
    """P16 and P22."""
    line = wait_drawn(page, "path", 21.0, -7.0)[0]
    assert (line["part"], line["color"]) == ("line", "#123456")
    assert {s["color"] for s in wait_drawn(page, "route", 12.8, -11.0)} == {"#224466", "#ff0000"}
    assert {s["color"] for s in drawn(page, "route", 13.8, -11.0, reach_px=2)} == {"#224466"}


def test_a_point_cloud_has_the_colours_of_its_points(page: Page) -> None:
    """P19."""
    for i, color in enumerate(("#ff0000", "#00ff00", "#0000ff")):
        assert wait_drawn(page, "pointcloud2", float(i), -11.0)[0]["color"] == color


def test_a_pose_and_a_frame_show_their_heading(page: Page) -> None:
    """P20 and P25: the pose looks north, the frame's x axis is red and points east."""
    assert wait_drawn(page, "pose", 4.0, -10.3)[0]["color"] == "#ff8800"
    assert not drawn(page, "pose", 4.0, -11.5)
    assert "#d22f26" in {s["color"] for s in wait_drawn(page, "tf_frame", 22.7, -11.0)}
    assert {s["color"] for s in drawn(page, "tf_frame", 22.0, -10.3)} == {"#17923f"}


def test_a_textured_marker_and_the_robots_picture_lie_on_the_ground(page: Page) -> None:
    """P24 and P21: 2 m x 1 m each; the robot's is turned to the north."""
    wait_for_rgb(page, 18.8, -11.4, messages.RED)
    assert not has_rgb(page, 18.8, -10.2, messages.RED)
    wait_for_rgb(page, 8.0, -10.2, messages.BLUE)
    assert not has_rgb(page, 8.8, -11.0, messages.BLUE)


def test_pictures_and_instruments_stand_in_their_corners(page: Page) -> None:
    """P1, P3 and P8: 30 degrees to the right, the sky is on the upper right, the ground left."""
    box = page.locator(".map").bounding_box()
    assert box
    wait_rgb(page, (box["width"] / 2, 32), messages.GREEN)
    wait_rgb(page, (120, 32), (255, 0, 0))
    centre = (box["width"] - 72 - 60, box["height"] - 12 - 60)
    sky, ground = (61, 132, 198), (138, 90, 43)
    wait_rgb(page, (centre[0], centre[1] - 45), sky)
    assert is_rgb(page, (centre[0], centre[1] + 50), ground)
    assert is_rgb(page, (centre[0] + 48, centre[1] + 10), ground) != is_rgb(
        page, (centre[0] - 48, centre[1] + 10), ground
    )


@pytest.mark.parametrize(
    ("side", "rgb"), [("bottom left", (255, 0, 255)), ("bottom centre", (255, 255, 0))]
)
def test_numbers_and_texts_are_written_on_the_map(
    page: Page, side: str, rgb: tuple[int, int, int]
) -> None:
    """P5 and P23."""
    box = page.locator(".map").bounding_box()
    assert box
    left = 72 if side == "bottom left" else box["width"] / 2 - 60

    def letters() -> int:
        image = colours(page).crop(
            (int(left), int(box["height"]) - 70, int(left) + 120, int(box["height"]) - 38)
        )
        bands = np.asarray(image, dtype=int) - np.array(rgb)
        return int((np.abs(bands).max(axis=-1) < NEAR_RGB).sum())

    wait_for(lambda: letters() > 30, "letters in their colour")


def test_tile_maps_and_image_pyramids_cover_their_ground(page: Page) -> None:
    """P26 and P27."""
    for x_m, y_m in ((-5.5, -8.5), (20.5, -25.5)):
        wait_rgb(page, pixel_of(page, x_m, y_m), fake_answers.TILE_RGB)
    assert not has_rgb(page, 14.0, -14.0, fake_answers.TILE_RGB)


def on_screen(page: Page, x_m: float, y_m: float) -> tuple[float, float]:
    """Where a place lies, in pixels of the page; asked at once, as banners move the map."""
    lat_deg, lon_deg = messages.lat_lon(x_m, y_m)
    x, y = page.evaluate(f"""(() => {{
      const box = document.querySelector('.map').getBoundingClientRect()
      const at = {MAP}.project([{lon_deg}, {lat_deg}])
      return [box.x + at.x, box.y + at.y]
    }})()""")
    return x, y


def tap(page: Page, *places: tuple[float, float]) -> None:
    for place in places:
        page.mouse.click(*on_screen(page, *place))


@contextmanager
def tool(page: Page, title: str) -> Iterator[None]:
    button = page.get_by_role("button", name=title)
    button.click()
    yield
    button.click()


def test_a_picked_coordinate_is_shown_and_copied(page: Page) -> None:
    """P2."""
    with tool(page, "Read position"):
        tap(page, (20.0, -15.0))
        hint = page.locator(".map-hint")
        expect(hint).to_contain_text(re.compile(r"E (19|20)\.\d{3} m  N -1[45]"))
        page.evaluate("navigator.clipboard.writeText = async text => { window.__copied = text }")
        page.get_by_role("button", name="Copy the position").click()
        lat_deg, lon_deg = messages.lat_lon(20.0, -15.0)
        copied = [float(word) for word in until(page, "window.__copied").split(", ")]
        assert copied == pytest.approx([lat_deg, lon_deg], abs=1e-6)


def test_the_place_under_the_mouse_is_shown(page: Page) -> None:
    page.mouse.move(*on_screen(page, 22.0, -16.0))
    expect(page.locator(".map-cursor")).to_contain_text(re.compile(r"E 2[12]\.\d\d  N -1[56]\."))


def test_measuring_adds_up_and_gives_the_area(page: Page) -> None:
    """P11: 4 m and 3 m are 7 m around 6 square metres."""
    with tool(page, "Measure"):
        tap(page, (16.0, -14.0), (20.0, -14.0), (20.0, -17.0))
        expect(page.locator(".map-hint")).to_contain_text("Total 7.0 m")
        expect(page.locator(".map-hint")).to_contain_text("6.0 m²")


def test_a_drawn_polygon_is_sent_and_stays(page: Page, server: FakeServer) -> None:
    """P4: to the recording, and to the program that listens."""
    corners = [(16.0, -14.0), (20.0, -14.0), (20.0, -17.0)]
    with tool(page, "Draw a polygon"):
        tap(page, *corners, corners[0])
        shape = wait_for(lambda: commands(server, wire.DrawShape), "a polygon")[-1]
        assert shape.shape == "polygon"
        for sent, meant in zip(shape.corners_map_m, corners, strict=True):
            assert sent == pytest.approx(meant, abs=0.06)
        wait_for(lambda: "panels/listener-polygon" in server.written, "the listener's answer")
        assert server.written["panels/listener-polygon"] == {
            "points": [list(corner) for corner in shape.corners_map_m]
        }
    red, green, blue = (177, 18, 138)
    wait_for_rgb(page, 18.0, -14.0, (red, green, blue))


def test_a_route_begins_at_the_robot_and_is_sent(page: Page, server: FakeServer) -> None:
    """P17."""
    with tool(page, "Plan a route"):
        tap(page, (10.0, -14.0), (12.0, -14.0))
        expect(page.locator(".map-hint")).to_contain_text("2 stops")
        tap(page, (12.0, -14.0))
        sent = wait_for(
            lambda: [s for s in commands(server, wire.DrawShape) if s.shape == "route"], "a route"
        )
        x_m, y_m, _ = server.robot.pose()
        assert sent[0].corners_map_m[0] == pytest.approx([x_m, y_m], abs=0.01)
        assert sent[0].corners_map_m[2] == pytest.approx([12.0, -14.0], abs=0.06)


def test_a_published_point_and_a_goal_are_sent(page: Page, server: FakeServer) -> None:
    """P18 and P12."""
    with tool(page, "Publish a point"):
        tap(page, (26.0, -13.0))
        point = wait_for(lambda: commands(server, wire.PointOut), "a point")[0]
        assert [point.x_map_m, point.y_map_m] == pytest.approx([26.0, -13.0], abs=0.06)
    page.get_by_role("button", name="Drive to a place").click()
    tap(page, (26.0, -14.0))
    page.get_by_role("button", name="Drive here", exact=True).click()
    goal = wait_for(lambda: commands(server, wire.GoTo), "a goal")[0]
    assert [goal.x_map_m, goal.y_map_m] == pytest.approx([26.0, -14.0], abs=0.06)


def add_display(page: Page, kind: str, title: str, **options: str) -> None:
    page.get_by_role("button", name="Add display").click()
    dialog = page.get_by_role("dialog", name="Add a display")
    dialog.get_by_role("combobox").first.select_option(label=kind)
    dialog.get_by_label("Name").fill(title)
    for name, value in options.items():
        dialog.get_by_label(name, exact=True).fill(value)
    dialog.get_by_role("button", name="Add", exact=True).click()


def shows(page: Page, layer: str) -> bool:
    return bool(page.evaluate(f"{MAP}.getLayer('{layer}') !== undefined"))


def test_a_display_is_added_changed_moved_saved_and_loaded(page: Page, server: FakeServer) -> None:
    page.get_by_role("button", name="Layers and views").click()
    add_display(page, "Odometry", "My track", Colour="#00ffff")
    track = f"{MAP}.queryRenderedFeatures({{layers: ['display-1-point']}})"
    wait_for(lambda: page.evaluate(f"{track}.length"), "the robot's own odometry")
    assert page.evaluate(f"{track}[0].properties.color") == "#00ffff"
    order = f"{MAP}.getStyle().layers.map(l => l.id).indexOf('%s')"
    above = f"{order % 'display-1-point'} > {order % 'layer-tf_frame-line'}"
    assert page.evaluate(above)
    page.get_by_role("button", name="Change My track").click()
    page.get_by_role("button", name="Further down").click()
    page.get_by_role("button", name="Done").click()
    assert not page.evaluate(above)
    page.get_by_role("button", name="Save view").click()
    page.get_by_label("Name of the view").fill("Mine")
    page.keyboard.press("Enter")
    saved = wait_for(lambda: server.written.get("views/Mine"), "the saved view")
    assert [display["type"] for display in saved["displays"]] == ["odometry"]
    page.get_by_role("button", name="Change My track").click()
    page.get_by_role("button", name="Remove", exact=True).click()
    wait_for(lambda: not shows(page, "display-1-point"), "the display to be gone")
    server.answers["views"] = ["Mine"]
    page.get_by_role("button", name="Open view").click()
    page.get_by_role("dialog").get_by_role("button", name="Mine").click()
    wait_for(lambda: shows(page, "display-1-point"), "the display to be back")
    wait_for(lambda: page.evaluate(f"{track}.length"), "its track")
    assert page.evaluate(f"{track}[0].properties.color") == "#00ffff"
    assert not page.evaluate(above)
    page.get_by_role("button", name="Layers and views").click()


def test_a_layer_of_a_program_lies_where_its_draw_order_says(
    page: Page, server: FakeServer
) -> None:
    """0 is the top, and -1 the lowest of all, also of the maps."""
    place = {"type": "Feature", "properties": {}, "geometry": {"type": "Point",
             "coordinates": list(reversed(messages.lat_lon(12.0, -9.0)))}}  # fmt: skip
    panels = server.answers["panels"]
    for name, order in {"low": -1, "top": 0}.items():
        panel = {"id": f"layer-{name}", "kind": "layer", "type": "geojson", "title": name,
                 "draw_order": order, "refresh_s": 1.0}  # fmt: skip
        server.written[f"panels/layer-{name}"] = place
        panels.append(panel)
    ids = f"{MAP}.getStyle().layers.map(l => l.id)"
    place_of = "ids.findIndex(id => id.startsWith('%s'))"
    low, top, tiles, frame = (
        place_of % name for name in ("layer-low", "layer-top", "tiles-aerial", "layer-tf_frame")
    )
    until(
        page,
        f"(ids => {low} >= 0 && {low} < {tiles} && {tiles} < {frame} && {frame} < {top})({ids})",
    )
    del panels[-2:]
    until(page, f"(ids => {low} < 0 && {top} < 0)({ids})")


def test_an_imported_pyramid_is_a_display_of_its_own(page: Page) -> None:
    """P27: the tiles of the map that was chosen."""
    page.get_by_role("button", name="Layers and views").click()
    page.get_by_role("button", name="Add display").click()
    dialog = page.get_by_role("dialog", name="Add a display")
    dialog.get_by_role("combobox").first.select_option(label="Multi-resolution image")
    dialog.get_by_role("combobox").nth(1).select_option(label="pyramid")
    dialog.get_by_label("Name").fill("My pyramid")
    dialog.get_by_role("button", name="Add", exact=True).click()
    kind = f"{MAP}.getStyle().layers.find(layer => layer.id.startsWith('display-') && "
    source = until(page, kind + "layer.type === 'raster')?.source")
    tiles = until(page, f"{MAP}.getSource('{source}').tiles?.[0]")  # the map reads them in time
    assert tiles.endswith("/tiles/farm/{z}/{x}/{y}")
    page.get_by_role("button", name="Layers and views").click()


def test_a_picture_of_the_map_shows_what_the_screen_shows(page: Page) -> None:
    with page.expect_download() as file:
        page.get_by_role("button", name="Save a picture of the map").click()
    picture = Image.open(file.value.path()).convert("RGB")
    width, _ = picture.size
    assert picture.getpixel((width // 2, 32)) == messages.GREEN
    x, y = pixel_of(page, 18.8, -11.4)
    found = picture.getpixel((round(x), round(y)))
    assert isinstance(found, tuple)
    assert all(abs(a - b) < NEAR_RGB for a, b in zip(found, messages.RED, strict=True))


def test_a_video_of_the_map_plays(page: Page, tmp_path: Path) -> None:
    page.get_by_role("button", name="Record a video of the map").click()
    page.evaluate(f"window.__drawn = 0; {MAP}.on('render', () => window.__drawn++)")
    until(page, "window.__drawn > 12")
    with page.expect_download() as file:
        page.get_by_role("button", name="Record a video of the map").click()
    assert file.value.suggested_filename.endswith(".webm")
    film = tmp_path / "map.webm"
    file.value.save_as(film)
    frames = []
    video = cv2.VideoCapture(str(film))
    while True:
        is_read, frame = video.read()
        if not is_read:
            break
        frames.append(frame)
    video.release()
    assert len(frames) >= 3
    height, width, _ = frames[-1].shape
    blue, green, red = (int(value) for value in frames[-1][32, width // 2])
    assert all(
        abs(a - b) < NEAR_RGB for a, b in zip((red, green, blue), messages.GREEN, strict=True)
    )
    assert height > 400


@pytest.mark.parametrize("theme", ["light", "dark", "sun"])
def test_the_layer_list_and_its_dialog_are_accessible_and_leave_stop_free(
    page: Page, theme: str
) -> None:
    while page.evaluate("document.documentElement.dataset.theme") != theme:
        page.locator(".theme-button").click()
    page.evaluate(AXE.read_text())
    page.get_by_role("button", name="Layers and views").click()
    found = violations(page, theme)
    page.get_by_role("button", name="Add display").click()
    expect(page.get_by_role("dialog")).to_be_visible()
    found += violations(page, theme)
    page.set_viewport_size({"width": 320, "height": 568})
    assert page.evaluate(STOP_FREE)
    page.set_viewport_size({"width": 1280, "height": 900})
    page.get_by_role("button", name="Close").click()
    page.get_by_role("button", name="Layers and views").click()
    assert found == []
