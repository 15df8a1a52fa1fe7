"""The card of one plant on the screen of the weed map."""

from __future__ import annotations

import time

import msgspec
from playwright.sync_api import BrowserContext, expect

from agribot.ui import wire
from tests.ui.conftest import Robot
from tests.ui.messages import make_weed
from tests.ui.page.conftest import WITHOUT_GL, until
from tests.ui.page.fake_robot import FakeRobot


def test_the_card_of_a_plant_follows_what_becomes_of_it(
    context: BrowserContext, robot: Robot
) -> None:
    robot.answers[wire.ListPanels] = []
    robot.say(wire.WeedChanges(set=[make_weed(1), make_weed(2)]))
    robot.say(FakeRobot().state(time.monotonic() * 1e3))
    page = context.new_page()
    page.goto(f"http://127.0.0.1:{robot.port}/?{WITHOUT_GL}#/weeds")
    until(page, "window.__agribot?.ready && window.__agribot.counters.weeds === 2")
    page.get_by_role("button", name="Plant before").click()
    card = page.locator(".details")
    treated = card.locator("dl div", has_text="Treated")
    expect(card).to_contain_text("Weed 2")
    expect(treated).to_have_text("Treated–")
    picture = card.locator("figcaption")
    expect(picture).not_to_be_empty()
    page.evaluate("document.querySelector('.details figcaption').dataset.isSame = 'yes'")
    robot.say(wire.WeedChanges(set=[msgspec.structs.replace(make_weed(2), treated_s=83.0)]))
    expect(treated).to_have_text("Treated1:23")
    expect(picture).to_have_attribute("data-is-same", "yes")  # it is not requested again
    robot.say(wire.WeedChanges(gone=[2]))
    expect(card).to_contain_text("Plant 2 is not on the map any more.")
    page.get_by_role("button", name="Plant before").click()
    expect(card).to_contain_text("Weed 1")
