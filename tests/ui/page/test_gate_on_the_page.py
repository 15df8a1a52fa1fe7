"""What the robot itself holds against its sensors and its start stands on the operator's page."""

from __future__ import annotations

import re
from pathlib import Path

from playwright.sync_api import BrowserContext, expect

from agribot.core.fact_text import render
from agribot.core.facts import NoContactor
from agribot.ui import wire
from tests import nightly
from tests.ui.page.conftest import WITHOUT_GL, OpenPage, until
from tests.ui.page.fake_server import FakeServer
from tests.ui.page.robots import robot_with_page

BLIND = [
    "--set", "perception.enabled=false", "--set", "seed=1", "--set", "faults=['gnss.jump=2@20']",
]  # fmt: skip

NO_CONTACTOR = render(NoContactor())


@nightly.by_day(
    "tests/ui/page/test_with_the_robot.py::test_the_robot_drives_its_mission_and_the_page_shows_it",
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests",
    "tests/ui/test_run_view.py::test_the_gate_is_shown_since_it_is_so_and_its_reason_once",
    "tests/ui/test_run_view.py::test_only_sensors_that_are_not_fine_cross_the_wire",
    "tests/autonomy/estimate/test_doubts.py"
    "::test_fixes_that_jump_while_the_robot_drives_are_not_followed_but_named",
)
def test_a_jump_of_the_receiver_is_told_once_with_state_sensor_and_the_list_before_the_start(
    context: BrowserContext, tmp_path: Path
) -> None:
    with robot_with_page("farm", tmp_path / "run", BLIND) as robot:
        page = context.new_page()
        page.goto(f"{robot.address}/?{WITHOUT_GL}#/drive")
        until(page, "window.__agribot?.ready")
        gate, listed = page.locator(".gate-line"), page.locator(".start-list")
        expect(gate.get_by_role("status")).to_have_text("Driving")
        expect(listed).to_contain_text(re.compile(r"Before the start: all \d+ good"))
        expect(page.locator(".sensors li")).to_have_count(5)
        expect(page.locator(".sensors .doubt")).to_have_count(0)
        assert listed.evaluate("list => !list.open")
        listed.locator("summary").click()
        expect(listed.get_by_text("Wheels and IMU")).to_be_visible()

        expect(gate.get_by_role("status")).to_have_text("Standby")
        expect(gate).to_contain_text("for ")
        expect(page.locator(".sensors li").first).to_contain_text("GNSS contradicted")
        expect(page.get_by_text("GNSS jumped by")).to_have_count(1)
        expect(page.locator(".mission .reason")).to_contain_text("resume to believe GNSS")
        expect(listed.get_by_text("Wheels and IMU")).to_be_visible()


def test_what_is_to_be_known_of_a_good_item_of_the_list_before_the_start_stands_under_it(
    server: FakeServer, open_page: OpenPage
) -> None:
    server.robot.checks.append(wire.StartCheck(name="contactor", remark=NO_CONTACTOR))
    listed = open_page("drive").locator(".start-list")
    count = len(server.robot.checks)
    expect(listed).to_contain_text(f"Before the start: all {count} good")
    listed.locator("summary").click()
    first = listed.locator("li").first
    expect(first).to_contain_text("Contactor")
    expect(first.locator(".reason")).to_have_text(NO_CONTACTOR.capitalize())
    expect(listed.locator("li .reason")).to_have_count(1)
