"""The robot in 3D: its own description, where it stands, its frames and its camera's view."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.ui.page.conftest import OpenPage, show, until
from tests.ui.page.fake_server import SOURCE, FakeServer
from tests.waiting import wait_for

SCENE = "window.__agribot.scene()"
LINKS = 12
NEAR_M = 0.02
WHEEL_PITCH_RAD = 0.15


@pytest.fixture
def page_size() -> tuple[int, int]:
    return 1100, 500


@pytest.fixture
def page(open_page: OpenPage) -> Page:
    page = open_page("robot", query="off=map,camera")
    until(page, f"window.__agribot.scene && Object.keys({SCENE}.joints).length")
    return page


def triangles_described() -> int:
    """Of all meshes that the description places, as their files count them."""
    folder = SOURCE / "description"
    names = re.findall(r"meshes/\w+\.stl", (folder / "urdf" / "agribot.urdf").read_text())
    return sum(int.from_bytes((folder / name).read_bytes()[80:84], "little") for name in names)


def shown(page: Page) -> dict[str, Any]:
    found: dict[str, Any] = page.evaluate(SCENE)
    return found


def standing(page: Page, server: FakeServer) -> tuple[dict[str, Any], float]:
    """What is shown of the robot where it stands, and how far it has driven in all."""
    server.robot.mode = "paused"
    wait_for(
        lambda: shown(page)["pose"] == pytest.approx(server.robot.pose(), abs=1e-3),
        "the robot where it stands now",
    )
    return shown(page), server.robot.s_m


def test_the_described_robot_stands_where_it_is_and_its_wheels_turn(
    page: Page, server: FakeServer
) -> None:
    until(page, f"{SCENE}.triangles >= {triangles_described()}")  # all meshes have come
    before, start_m = standing(page, server)
    server.robot.mode = "mission"
    wait_for(lambda: server.robot.s_m > start_m + 0.5, "half a metre driven")
    after, end_m = standing(page, server)
    wheel = "base_link_to_left_wheel_F_joint"
    rolled_m = WHEEL_PITCH_RAD * (after["joints"][wheel] - before["joints"][wheel])
    assert rolled_m == pytest.approx(end_m - start_m, abs=NEAR_M)
    wait_for(lambda: shown(page)["pictures"] > before["pictures"], "another picture")
    assert page.evaluate("document.querySelector('.stage canvas').clientWidth") > 300


def test_the_eye_goes_with_the_robot_until_it_is_let_go_and_turns_by_dragging(page: Page) -> None:
    first = shown(page)
    until(page, f"{SCENE}.pose[0] > {first['pose'][0]} + 0.5")
    second = shown(page)
    moved = [b - a for a, b in zip(first["eye"], second["eye"], strict=True)]
    assert moved[:2] == pytest.approx(
        [b - a for a, b in zip(first["pose"][:2], second["pose"][:2], strict=True)], abs=0.05
    )
    page.get_by_role("button", name="Follow the robot").click()
    still = shown(page)
    until(page, f"{SCENE}.pose[0] > {still['pose'][0]} + 0.3")
    assert shown(page)["eye"] == pytest.approx(still["eye"], abs=1e-3)
    box = page.locator(".stage canvas").bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y, steps=4)
    page.mouse.up()
    until(page, f"Math.abs({SCENE}.eye[1] - {still['eye'][1]}) > 0.2")


def test_every_link_has_its_axes_and_the_camera_its_field_of_view(page: Page) -> None:
    assert shown(page)["camera"] is True
    assert shown(page)["axes"] == []
    page.get_by_label("Frames of the links").check()
    axes = shown(page)["axes"]
    assert len(axes) == LINKS
    heights = sorted(round(z_m, 2) for _, _, z_m in axes)
    assert heights[0] >= 0.0
    assert 0.6 < heights[-1] < 1.5  # the camera's, above the wheels
    page.get_by_label("Camera’s field of view").uncheck()
    assert shown(page)["camera"] is False
    page.get_by_label("Frames of the links").uncheck()
    assert shown(page)["axes"] == []


def test_the_scene_is_given_back_when_the_screen_is_left(page: Page) -> None:
    for screen in ("health", "robot", "health"):
        show(page, screen)
    assert page.evaluate("window.__agribot.scene") is None
    expect(page.locator(".stage")).to_have_count(0)
