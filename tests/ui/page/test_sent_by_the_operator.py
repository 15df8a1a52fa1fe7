"""What an operator sends from the page to the simulated robot: places, plans, recordings.

One robot serves all tests of this file, in their order.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from agribot.core import config
from agribot.core.geo import MapFrame
from tests import nightly
from tests.ui.page.conftest import (
    hold_map_still,
    shared_page,
    show,
    take_control,
    until,
    wait_for_toast,
)
from tests.ui.page.robots import Robot, robot_with_page
from tests.waiting import wait_for

SETTINGS = ["--set", "perception.enabled=false", "--set", "seed=1"]
STATE = "window.__agribot.state()"
FIELD = Path(__file__).parents[3] / "examples" / "field.geojson"
GOAL = (-1.0, 4.0)
PACE = 4.0  # no manual driving here, and an open page costs by the second


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    out_dir = tmp_path_factory.mktemp("runs") / "run"
    with robot_with_page("farm", out_dir, SETTINGS, PACE) as robot:
        yield robot


@pytest.fixture(scope="module")
def page(browser: Browser, robot: Robot) -> Iterator[Page]:
    with shared_page(browser, f"{robot.address}/?off=scene,camera#/drive") as page:
        until(page, "window.__agribot.map?.loaded()")
        take_control(page)
        hold_map_still(page)
        yield page


def at(page: Page, east_m: float, north_m: float) -> tuple[float, float]:
    """Bring a place of the map into view; its pixel on the screen."""
    frame = MapFrame(config.load("farm").field.datum)
    lat_deg, lon_deg, _ = frame.geodetic_from_map(east_m, north_m)
    page.evaluate(f"void window.__agribot.map.jumpTo({{center: [{lon_deg}, {lat_deg}], zoom: 20}})")
    box = page.locator(".map").bounding_box()
    assert box
    px = page.evaluate(f"window.__agribot.map.project([{lon_deg}, {lat_deg}])")
    return box["x"] + px["x"], box["y"] + px["y"]


def tap(page: Page, east_m: float, north_m: float) -> None:
    page.mouse.click(*at(page, east_m, north_m))


def draw_north(page: Page, east_m: float, north_m: float) -> None:
    """Press at a place and drag to the north, for a tool that takes a heading as well."""
    x, y = at(page, east_m, north_m)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 80, steps=3)
    page.mouse.up()


@nightly.by_day(
    "tests/ui/page/test_places.py"
    "::test_a_place_that_the_robot_cannot_reach_or_nobody_may_send_it_to_is_not_sent",
    "tests/ui/test_goal_preview.py::test_a_place_that_cannot_be_reached_says_why",
)
def test_a_place_beyond_the_fence_is_refused_with_the_reason(page: Page) -> None:
    until(page, f"{STATE}.mode === 'mission' && {STATE}.v_mps > 0.1")
    page.get_by_role("button", name="Drive to a place").click()
    tap(page, 60.0, 0.0)
    proposal = page.get_by_role("group", name="Proposal")
    expect(proposal).to_contain_text("beyond the fence")
    expect(proposal.get_by_role("button", name="Drive here")).to_be_disabled()
    assert page.evaluate(f"{STATE}.mode") == "mission"
    proposal.get_by_role("button", name="Cancel").click()


@nightly.by_day(
    "tests/ui/page/test_places.py"
    "::test_a_goal_and_a_pose_are_sent_when_they_are_confirmed_and_not_before",
    "tests/autonomy/plan/test_mission_errands.py"
    "::test_it_drives_to_a_place_around_the_crop_and_waits_there",
)
def test_the_robot_drives_to_the_place_that_was_drawn_and_waits(page: Page) -> None:
    page.get_by_role("button", name="Drive to a place").click()
    draw_north(page, *GOAL)
    proposal = page.get_by_role("group", name="Proposal")
    expect(proposal).to_contain_text("of way")
    proposal.get_by_role("button", name="Drive here").click()
    until(page, f"{STATE}.mission.leg === 'to the goal'")
    goal = until(page, "window.__agribot.goal()")
    assert goal == pytest.approx(GOAL, abs=0.3)
    until(page, f"{STATE}.mission.reason.includes('at the goal')")
    until(page, f"Math.abs({STATE}.v_mps) < 0.01")
    x_m, y_m, yaw_rad = page.evaluate(f"{STATE}.pose")
    assert (x_m, y_m) == pytest.approx(GOAL, abs=0.3)  # as near as a finger on the map
    assert math.cos(yaw_rad - math.pi / 2) > 0.98
    expect(page.locator(".reason")).to_contain_text("resume goes on with the mission")


@nightly.by_day(
    "tests/ui/page/test_places.py"
    "::test_a_goal_and_a_pose_are_sent_when_they_are_confirmed_and_not_before",
    "tests/ui/test_seat_and_commands.py::test_a_pose_by_hand_needs_the_seat_and_a_robot_at_rest",
)
def test_a_standing_robot_believes_the_pose_that_was_drawn_and_then_its_sensors(page: Page) -> None:
    before = page.evaluate(f"{STATE}.pos_std_m")
    assert before < 0.05
    page.get_by_role("button", name="Correct the robot’s pose").click()
    draw_north(page, *page.evaluate(f"{STATE}.pose.slice(0, 2)"))
    page.get_by_role("button", name="Correct the pose", exact=True).click()
    wait_for_toast(page, "Pose corrected")
    until(page, f"{STATE}.pos_std_m < 0.05 && Math.abs({STATE}.v_mps) < 0.01")


@nightly.by_day(
    "tests/ui/page/test_drawing.py"
    "::test_the_plan_is_checked_by_the_robot_and_its_reasons_are_on_the_map",
    "tests/ui/test_rest.py::test_a_drawn_field_is_planned_with_a_certificate",
    "tests/autonomy/plan/test_mission_errands.py"
    "::test_another_plan_is_taken_by_a_standing_robot_and_begins_when_resumed",
)
def test_a_checked_plan_becomes_the_mission(page: Page, robot: Robot) -> None:
    show(page, "plan")
    page.get_by_label("Field file").set_input_files(FIELD)
    expect(page.locator("main")).to_contain_text("1 boundary, 2 obstacles")
    page.get_by_role("button", name="Check plan").click()
    expect(page.locator(".tag.good")).to_be_visible()
    page.get_by_role("button", name="Use this plan").click()
    page.get_by_role("dialog").get_by_role("button", name="Use this plan").click()
    until(page, f"{STATE}.mission.reason.includes('new plan')")
    assert page.evaluate(f"{STATE}.mission.rows_total") > 6
    show(page, "drive")
    page.locator("[data-action=resume]").click()
    until(page, f"{STATE}.mode === 'mission' && {STATE}.v_mps > 0.1")
    wait_for((robot.out_dir / "plan.geojson").is_file, "the plan beside the run")


@nightly.by_day(
    "tests/ui/page/test_screens.py::test_a_recording_is_replayed_and_a_moment_marked",
    "tests/ui/test_seat_and_commands.py"
    "::test_a_recording_is_begun_and_ended_by_operators_without_the_seat",
)
def test_a_recording_is_ended_marked_and_begun_again(page: Page, robot: Robot) -> None:
    show(page, "recordings")
    page.get_by_role("button", name="Mark this moment").click()
    page.get_by_label("What happened").fill("a stone")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="End the recording").click()
    until(page, f"{STATE}.recording === ''")
    expect(page.locator("main")).to_contain_text("Nothing is being recorded")
    page.get_by_role("button", name="Record", exact=True).click()
    until(page, f"{STATE}.recording === 'run-2'")
    expect(page.locator("main")).to_contain_text("Recording now: run-2")
    assert (robot.out_dir.with_name("run-2") / "run.mcap").is_file()
    lines = (robot.out_dir / "events.jsonl").read_text().splitlines()
    told = [json.loads(line)["reason"] for line in lines]
    for asked in ("a stone", "goto ", "pose_estimate ", "plan (", "stop_recording"):
        assert any(reason.startswith(asked) for reason in told), asked
