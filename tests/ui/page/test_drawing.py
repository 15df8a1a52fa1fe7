"""Drawing a field on the map: every tool, in numbers too, back and forth, and nothing kept unasked.

One page draws; the tests follow each other.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from tests import nightly
from tests.ui.page.conftest import hold_map_still, new_context, until
from tests.ui.page.fake_answers import ROBOT
from tests.ui.page.fake_server import FakeServer, serving
from tests.ui.page.test_plan import drawn, import_and_export, lonlat
from tests.waiting import wait_for

# Data may be old for a time on a busy machine: the banner would lie over what is tapped.
STEADY = ".banners { display: none }"
NEAR_M = 0.06  # as near as a pixel of the map
BESIDE = (10.0, -14.0)  # ground without anything
AREA = [(6.0, -18.0), (14.0, -18.0), (14.0, -11.0), (6.0, -11.0)]
POND = [(12.0, -13.0), (13.0, -13.0), (13.0, -12.0)]
ROW = [(8.0, -17.0), (8.0, -12.0)]
AB = [(10.0, -17.0), (11.0, -12.0)]
GOALS = [(7.0, -16.0), (7.0, -13.0)]


@pytest.fixture(scope="module")
def server() -> Iterator[FakeServer]:
    fake = FakeServer(weeds=0)
    fake.robot.mode = "paused"  # the map is not drawn anew for a robot that stands
    with serving(fake) as fake.address:
        yield fake


@pytest.fixture(scope="module")
def asked() -> list[str]:
    return []


@pytest.fixture(scope="module")
def page(browser: Browser, server: FakeServer, asked: list[str]) -> Iterator[Page]:
    context = new_context(browser, viewport={"width": 900, "height": 600}, locale="en")
    context.on("request", lambda request: asked.append(request.url))
    page = context.new_page()
    page.goto(f"{server.address}/?off=scene,camera#/plan")
    until(page, "window.__agribot?.ready && window.__agribot.map?.getLayer('plan-path')")
    hold_map_still(page)
    [[lon_deg, lat_deg]] = lonlat([BESIDE])
    jump = f"void window.__agribot.map.jumpTo({{center: [{lon_deg}, {lat_deg}], zoom: 20.5}})"
    page.evaluate(jump)
    page.add_style_tag(content=STEADY)
    yield page
    context.close()


def tap(page: Page, *places: tuple[float, float]) -> None:
    for lon_deg, lat_deg in lonlat(list(places)):
        x, y = page.evaluate(
            "([lon, lat]) => { const at = window.__agribot.map.project([lon, lat]);"
            "const box = document.querySelector('.map').getBoundingClientRect();"
            "return [box.x + at.x, box.y + at.y] }",
            [lon_deg, lat_deg],
        )
        page.mouse.move(x, y)
        page.mouse.click(x, y)


def choose(page: Page, tool: str) -> None:
    page.locator(".tool-grid").get_by_role("button", name=tool, exact=True).click()


def sent(page: Page, server: FakeServer) -> list[dict[str, Any]]:
    """The features that the page asks the robot to plan on."""
    server.written.pop("plan", None)
    page.get_by_role("button", name="Check plan").click()
    plan = wait_for(lambda: server.written.get("plan"), "a plan to check")
    return list(plan["field"]["features"])


def points(features: list[dict[str, Any]], kind: str) -> list[list[tuple[float, float]]]:
    """Of every shape of this kind, in the map."""
    return [
        drawn({"features": [feature]})[kind]
        for feature in features
        if feature["properties"]["kind"] == kind
    ]


def is_near(found: list[tuple[float, float]], wanted: list[tuple[float, float]]) -> bool:
    return len(found) == len(wanted) and all(
        point == pytest.approx(place, abs=NEAR_M)
        for point, place in zip(found, wanted, strict=True)
    )


def test_the_plan_is_checked_by_the_robot_and_its_reasons_are_on_the_map(
    page: Page, server: FakeServer
) -> None:
    page.get_by_role("button", name="Check plan").click()
    expect(page.locator("ol.reasons")).to_contain_text("Row 3 leaves the boundary")
    expect(page.locator(".reason-pin")).to_have_text("1")
    sent = server.written["plan"]
    kinds = [feature["properties"]["kind"] for feature in sent["field"]["features"]]
    assert kinds.count("row") == 6
    assert sent["implement_width_m"] == ROBOT.tool_width_m
    expect(page.get_by_role("button", name="Use this plan")).to_be_disabled()
    width = page.get_by_label("Working width, m")
    width.fill("2")
    expect(page.locator(".reasons, .reason-pin")).to_have_count(0)  # those of another plan
    width.fill(f"{ROBOT.tool_width_m}")


def test_a_field_file_is_imported_drawn_and_exported_again(
    page: Page, server: FakeServer, tmp_path: Path
) -> None:
    import_and_export(page, server, ".geojson", tmp_path)


def test_each_tool_draws_where_the_map_was_tapped(page: Page, server: FakeServer) -> None:
    for tool, places in (("Boundary", AREA), ("Obstacle", POND)):
        choose(page, tool)
        expect(page.locator(".side")).to_contain_text("Tap the corners on the map")
        tap(page, *places, places[0])
        expect(page.locator(f"[data-kind={tool.lower()}]")).to_have_attribute(
            "aria-pressed", "false"
        )
    for tool, places in (("Row", ROW), ("A–B line", AB)):
        choose(page, tool)
        tap(page, *places, places[-1])
    choose(page, "Goals")
    tap(page, *GOALS)
    choose(page, "Goals")
    expect(page.locator(".side")).to_contain_text("1 obstacle")
    features = sent(page, server)
    for kind, places in (("boundary", AREA), ("obstacle", POND), ("row", ROW), ("ab_line", AB)):
        assert is_near(points(features, kind)[-1], places), kind
    assert [is_near(p, [g]) for p, g in zip(points(features, "waypoint"), GOALS, strict=True)] == [
        True, True,
    ]  # fmt: skip


def test_the_last_step_is_taken_back_and_done_again(page: Page, server: FakeServer) -> None:
    side = page.locator(".side")
    expect(side).to_contain_text("2 goals")
    page.get_by_role("button", name="Undo").click()
    expect(side).to_contain_text("1 goal ")
    page.get_by_role("button", name="Redo").click()
    expect(side).to_contain_text("2 goals")
    expect(page.get_by_role("button", name="Redo")).to_be_disabled()


def test_a_corner_is_moved_in_numbers_to_the_centimetre(page: Page, server: FakeServer) -> None:
    tap(page, (12.7, -12.8))  # in the pond
    expect(page.locator(".side h2", has_text="Obstacle")).to_be_visible()
    expect(page.locator(".side")).to_contain_text("m²")
    corner = page.get_by_label("Point 1, east, metres")
    corner.fill("11.250")
    corner.press("Enter")
    page.get_by_label("Point 1, north, metres").press("Enter")
    moved = wait_for(lambda: points(sent(page, server), "obstacle"), "the obstacle")[0]
    assert moved[0][0] == pytest.approx(11.25, abs=1e-3)
    assert moved[0][1] == pytest.approx(POND[0][1], abs=NEAR_M)


def test_a_field_of_rows_is_made_from_its_first(page: Page, server: FakeServer) -> None:
    before = len(points(sent(page, server), "row"))
    tap(page, (8.0, -15.0))
    page.get_by_label("More rows").fill("2")
    page.get_by_label("To the left, m").fill("-1.5")
    page.get_by_role("button", name="Add rows").click()
    rows = points(sent(page, server), "row")
    assert len(rows) == before + 2
    for row, east_m in zip(rows[-2:], (9.5, 11.0), strict=True):
        assert is_near(row, [(east_m, ROW[0][1]), (east_m, ROW[1][1])])
    page.get_by_role("button", name="Undo").click()
    assert len(points(sent(page, server), "row")) == before


def test_goals_change_places_and_a_shape_is_deleted(page: Page, server: FakeServer) -> None:
    tap(page, GOALS[0])
    page.get_by_role("button", name="Later").click()
    first, second = points(sent(page, server), "waypoint")
    assert is_near(first, [GOALS[1]])
    assert is_near(second, [GOALS[0]])
    tap(page, (12.7, -12.7))
    page.get_by_role("button", name="Delete").click()
    expect(page.locator(".side")).not_to_contain_text("obstacle")
    assert points(sent(page, server), "obstacle") == []


def test_a_boundary_is_recorded_by_driving_along_it(page: Page, server: FakeServer) -> None:
    before = len(points(sent(page, server), "boundary"))
    choose(page, "By driving")
    server.robot.mode = "mission"
    x_m, y_m, _ = server.robot.pose()
    pose = "window.__agribot.state().pose"
    until(page, f"Math.hypot({pose}[0] - {x_m}, {pose}[1] - {y_m}) > 3")
    server.robot.mode = "paused"
    choose(page, "By driving")
    found = points(sent(page, server), "boundary")
    assert len(found) == before + 1
    assert len(found[-1]) >= 5
    steps_m = [math.dist(a, b) for a, b in pairwise(found[-1])]
    assert min(steps_m) >= 0.49
    assert max(steps_m) < 1.5


def test_nothing_was_kept_or_asked_elsewhere_meanwhile(
    page: Page, server: FakeServer, asked: list[str]
) -> None:
    """What is drawn touches no saved field, and drawing needs only the robot."""
    assert [each for each in server.requests if each.startswith(("PUT", "DELETE"))] == []
    assert [url for url in asked if not url.startswith((server.address, "data:", "blob:"))] == []


def test_small_distances_are_not_rounded_away(page: Page) -> None:
    """A source that stops at zoom 18, as usual, rounds places to 11 mm."""
    sources = page.evaluate("window.__agribot.map.getStyle().sources")
    zooms = {
        name: each.get("maxzoom") for name, each in sources.items() if each["type"] == "geojson"
    }
    own = {name: zoom for name, zoom in zooms.items() if not name.startswith("td-")}
    assert len(own) > 8
    assert {name for name, zoom in own.items() if zoom != 22} == set()


def test_a_field_is_saved_on_the_robot_under_its_name(page: Page, server: FakeServer) -> None:
    page.get_by_role("button", name="Save", exact=True).first.click()
    page.get_by_label("Name of the field").fill("north acre")
    page.keyboard.press("Enter")
    wait_for(lambda: "fields/north acre" in server.written, "the saved field")
    assert server.written["fields/north acre"]["type"] == "FeatureCollection"
    assert "PUT fields/north acre" in server.requests


@nightly.by_day("tests/ui/test_rest.py::test_one_of_several_fields_in_a_file_is_opened_by_its_name")
def test_one_of_the_fields_in_a_file_is_chosen_and_a_new_one_begins_empty(
    page: Page, server: FakeServer, tmp_path: Path
) -> None:
    file = tmp_path / "farm.geojson"
    rings = {"West": AREA, "East": [(x_m + 40.0, y_m) for x_m, y_m in AREA]}
    file.write_text(json.dumps({"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {"kind": "boundary", "name": name},
         "geometry": {"type": "Polygon", "coordinates": [[*lonlat(ring), lonlat(ring)[0]]]}}
        for name, ring in rings.items()
    ]}))  # fmt: skip
    page.get_by_label("Field file").set_input_files(file)
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("farm.geojson holds 2 fields.")
    dialog.get_by_label("Which field?").select_option("East")
    dialog.get_by_role("button", name="Open").click()
    expect(page.locator(".side")).to_contain_text("1 boundary")
    [boundary] = points(sent(page, server), "boundary")
    assert is_near(boundary, rings["East"])
    page.get_by_role("button", name="New").click()
    expect(page.locator(".side")).to_contain_text("Choose what to draw, then tap the map.")
    assert sent(page, server) == []
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".side")).to_contain_text("1 boundary")
