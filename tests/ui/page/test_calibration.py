"""Calibrating from the page: the real server, the simulated robot, its settings on the disk."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests import nightly
from tests.ui.page.conftest import WITHOUT_GL, new_context, show, take_control, until
from tests.ui.page.robots import Robot, robot_with_page
from tests.waiting import wait_for

pytestmark = nightly.by_day(
    "tests/ui/page/test_with_the_robot.py::test_stop_ends_a_calibration_at_once",
    "tests/app/calibration/test_wizard.py"
    "::test_whatever_else_is_asked_of_the_robot_ends_it_at_once",
    "tests/app/calibration/test_wizard.py::test_a_hand_and_the_loss_of_the_operator_end_it",
    "tests/app/calibration/test_wizard.py::test_it_is_refused_while_a_mission_runs_or_a_stop_holds",
    "tests/autonomy/estimate/test_mag_fit.py::test_an_ellipse_without_noise_is_found_exactly",
    "tests/ui/page/test_screens.py"
    "::test_calibrations_asked_for_before_an_undo_do_not_come_back_with_a_late_answer",
)

# The rows lie far enough that a way leads to them from any end of a drive.
WORDS = [
    'world="empty"', "field.start_map_m=[0.0,0.0]", "field.start_yaw_deg=90.0",
    "field.first_row_start_map_m=[30.0,2.0]", "field.obstacles_map_m=[]",
    "mission.waits_for_goals=true", "perception.enabled=false",
]  # fmt: skip
STATE = "window.__agribot.state()"
CALIBRATION = f"{STATE}?.calibration"
PHASE = f"{CALIBRATION}?.phase"
IS_OVER = f"!['driving', 'computing'].includes({PHASE})"
ATTEMPTS = 8
IS_STILL = f"Math.abs({STATE}.v_mps) < 0.02"
FEW_SEEN = (
    "/^[1-6] of 36 directions seen$/.test("
    "document.querySelector('.coverage-ring')?.getAttribute('aria-label'))"
)
WEDGES = "document.querySelectorAll('.coverage-ring .seen').length"
FITS = """['.coverage-ring', '.error-plot'].every(name => {
    const box = document.querySelector(name).getBoundingClientRect()
    return box.width > 100 && box.left >= 0 && box.right <= innerWidth
})"""
POST = """([what, body]) => fetch('/api/v1/calibrations/' + what,
    {method: 'POST', body: JSON.stringify(body)})
    .then(async answer => [answer.status, (await answer.json()).error])
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Nothing that is taken over here counts in other tests."""
    folder = tmp_path_factory.mktemp("home")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AGRIBOT_HOME", str(folder))
        yield folder


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory, home: Path) -> Iterator[Robot]:
    words = [word for setting in WORDS for word in ("--set", setting)]
    with robot_with_page("farm", tmp_path_factory.mktemp("runs") / "run", words, 6.0) as robot:
        yield robot


@pytest.fixture
def page(browser: Browser, robot: Robot) -> Iterator[Page]:
    context = new_context(browser, viewport={"width": 1280, "height": 800}, locale="en")
    page = opened(context.new_page(), robot)
    take_control(page)
    if page.evaluate(f"{STATE}.stop"):
        page.get_by_role("button", name="Release stop").click()
        until(page, f"!{STATE}.stop")
    yield page
    context.close()


def opened(page: Page, robot: Robot) -> Page:
    page.goto(f"{robot.address}/?{WITHOUT_GL}#/settings")
    until(page, f"window.__agribot?.ready && {STATE}")
    return page


def calibrate(page: Page, title: str, *sights: str) -> None:
    """Until each sight was seen, one after the other.

    Begun again, as by a person, where the page stuttered: its robot does not go on without an
    operator, and a sight may be over before it is shown.
    """
    left = list(sights)
    for _ in range(ATTEMPTS):
        page.evaluate(POST, ["cancel", {}])  # forgets how the one before ended
        until(page, f"!{PHASE} && {IS_STILL}")
        page.get_by_role("button", name=f"Calibrate: {title}").click()
        expect(page.get_by_role("dialog")).to_contain_text("STOP, Cancel")
        page.get_by_role("button", name="Drive now").click()
        until(page, PHASE)
        while left and until(page, f"{left[0]} ? 'seen' : {IS_OVER} && 'over'") == "seen":
            left.pop(0)
        if not left:
            return
    raise AssertionError(f"{left[0]}; at last {page.evaluate(CALIBRATION)}")


def test_the_compass_is_measured_taken_over_and_taken_back(page: Page, home: Path) -> None:
    calibrate(
        page,
        "Compass",
        f"document.querySelector('.calibration progress')?.value > 0.05 && {FEW_SEEN}",
        f"{CALIBRATION}?.motion === 'spin left'",
        f"{PHASE} === 'driving' && {WEDGES} > 9 && {WEDGES} < 36",  # fills under way
        f"{PHASE} === 'found'",
    )
    card, ring = page.locator(".calibration"), page.locator(".coverage-ring")
    expect(ring).to_have_attribute("aria-label", "36 of 36 directions seen")
    plot = page.locator(".error-plot")
    expect(plot).to_have_attribute("aria-label", re.compile(r"by direction: up to [\d.]+° before"))
    assert plot.locator(".after").get_attribute("points").count(",") == 36  # type: ignore[union-attr]
    page.set_viewport_size({"width": 360, "height": 740})
    assert page.evaluate(FITS)
    page.set_viewport_size({"width": 1280, "height": 800})
    expect(card.locator("table")).to_contain_text("Hard iron ahead (µT)")
    expect(card.locator("table")).to_contain_text("36")
    kept = home / "robots" / "agribot.toml"
    assert not kept.exists()  # nothing counts before it is taken over
    card.get_by_role("button", name="Use these values").click()
    expect(card).to_contain_text("estimate.mag_offset_t")
    assert "mag_shape" in kept.read_text()
    card.get_by_role("button", name="Undo the newest").click()
    expect(card).to_contain_text("Nothing was measured")
    assert not kept.exists()


def stop_calibrating(page: Page) -> None:
    page.locator("#stop").click()
    until(page, f"{STATE}.signals.at(-1)?.[3] === 0 && {IS_STILL}")
    expect(page.locator(".calibration")).to_contain_text("not finished: ended by 'stop'")
    page.get_by_role("button", name="Release stop").click()
    until(page, f"!{STATE}.stop")
    assert page.evaluate(IS_STILL)


def test_cancel_brings_the_robot_to_rest_and_changes_nothing(page: Page, home: Path) -> None:
    calibrate(page, "Wheels and turning", f"{STATE}.signals.at(-1)?.[3] > 0.3")
    page.get_by_role("button", name="Cancel").click()
    until(page, f"{PHASE} === 'failed' && {STATE}.signals.at(-1)?.[3] === 0 && {IS_STILL}")
    expect(page.locator(".calibration")).to_contain_text("cancelled by")
    assert not (home / "robots").exists() or not list((home / "robots").glob("*.toml"))


@pytest.mark.parametrize("how", ["another takes the seat", "the operator is gone"])
def test_without_its_operator_the_robot_does_not_go_on(
    page: Page, robot: Robot, browser: Browser, how: str
) -> None:
    calibrate(page, "Wheels and turning", f"{STATE}.signals.at(-1)?.[3] > 0.3")
    context = new_context(browser, locale="en")
    other = opened(context.new_page(), robot)
    if how == "the operator is gone":
        page.context.close()
    else:
        other.get_by_role("button", name="Operator").click()
        other.get_by_role("dialog").get_by_role("button", name="Take over").click()
    until(other, f"{PHASE} === 'failed' && {STATE}.signals.at(-1)?.[3] === 0 && {IS_STILL}")
    expect(other.locator(".calibration")).to_contain_text(
        re.compile(r"(took the robot|is not heard any more)\.")
    )
    context.close()


def test_only_the_operator_may_start_one_and_only_while_nothing_else_drives(page: Page) -> None:
    assert page.evaluate(POST, ["start", {"kind": "tyres"}])[0] == 409
    show(page, "drive")
    page.locator("[data-action=resume]").click()
    until(page, f"{STATE}.mode === 'mission'")
    status, reason = page.evaluate(POST, ["start", {"kind": "motors"}])
    assert status == 409 and "pause its mission first" in reason
    page.locator("[data-action=pause]").click()
    until(page, f"{STATE}.mode === 'paused' && {IS_STILL}")
    show(page, "settings")
    page.get_by_role("button", name="Operator").click()
    page.get_by_role("button", name="Hand over").click()
    expect(page.get_by_role("button", name="Calibrate: Motors")).to_be_disabled()
    status, reason = page.evaluate(POST, ["start", {"kind": "motors"}])
    assert status == 409 and "seat" in reason
    wait_for(lambda: page.evaluate(IS_STILL), "a robot at rest")
