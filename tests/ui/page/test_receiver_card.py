"""The Health screen shows the GNSS receiver, and what it does not report as missing, in red.

One page shows them all.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.ui.page.conftest import WITHOUT_GL, shared_page
from tests.ui.page.fake_robot import SATELLITES, make_receiver
from tests.ui.page.fake_server import FakeServer, serving
from tests.ui.page.test_layout import check

NO_SKY = {"satellites": [], "used_count": 0, "in_view_count": 0, "hdop": None, "pdop": None,
          "vdop": None}  # fmt: skip
NO_CORRECTIONS = {"correction_age_s": None, "correction_hz": None}
LOST = "corrections from caster.example:2101/NEAR are lost: nothing came for 15 s; trying again"
BROKEN = (
    "the link to the receiver on /dev/ttyACM0 broke 3 messages within 2.1 s, which are left out; "
    "check its cable, plugs and ground"
)


@pytest.fixture(scope="module")
def shared_server() -> Iterator[FakeServer]:
    fake = FakeServer(weeds=0)
    with serving(fake) as fake.address:
        yield fake


@pytest.fixture(scope="module")
def open_once(browser: Browser, shared_server: FakeServer) -> Iterator[Page]:
    with shared_page(browser, f"{shared_server.address}/?{WITHOUT_GL}#/health") as page:
        yield page


@pytest.fixture
def server(shared_server: FakeServer) -> FakeServer:
    """With a receiver that is well."""
    shared_server.robot.receiver = make_receiver()
    return shared_server


@pytest.fixture
def page(open_once: Page, server: FakeServer) -> Page:
    expect(fact(open_once, "Last fix")).to_have_text("0.1 s ago, 10 per second")
    expect(card_of(open_once).get_by_role("status")).to_have_text("RTK fixed")
    return open_once


def card_of(page: Page) -> Locator:
    return page.get_by_role("region", name="GNSS receiver")


def fact(page: Page, name: str) -> Locator:
    """The text shown under a name."""
    return card_of(page).locator("dt", has_text=name).locator("xpath=following-sibling::dd")


def test_the_card_tells_fix_sky_and_corrections_of_a_receiver_that_is_well(
    page: Page, server: FakeServer
) -> None:
    card, receiver = card_of(page), server.robot.receiver
    expect(card.get_by_role("status")).to_have_text("RTK fixed")
    expect(card).to_contain_text("serial:/dev/ttyACM0")
    expect(card.get_by_text("Simulated")).to_be_hidden()
    expect(fact(page, "Last fix")).to_have_text("0.1 s ago, 10 per second")
    expect(fact(page, "Accuracy")).to_have_text("East, North ±1.4 cm; up not reported")
    used = f"{receiver.used_count} used of {SATELLITES} in view"
    expect(fact(page, "Satellites")).to_have_text(used)
    expect(fact(page, "Signal")).to_contain_text("dB-Hz")
    expect(fact(page, "Dilution")).to_have_text("HDOP 0.7, PDOP 1.3, VDOP 1.1")
    expect(fact(page, "Corrections")).to_have_text("0.8 s old")
    expect(fact(page, "Caster caster.example:2101/NEAR")).to_have_text(
        "connected, 5.0 messages per second"
    )
    expect(fact(page, "Line")).to_have_text("no broken messages reported")
    expect(card.locator("dd.bad, dd.warn")).to_have_count(0)


def test_the_sky_is_drawn_with_north_up_and_the_used_ones_filled(
    page: Page, server: FakeServer
) -> None:
    sky, receiver = card_of(page).locator(".sky"), server.robot.receiver
    expect(sky.locator("circle.used")).to_have_count(receiver.used_count)
    expect(sky.locator("circle.seen")).to_have_count(SATELLITES - receiver.used_count)
    for satellite in receiver.satellites:
        dot = sky.locator("circle", has_text=f"{satellite.system} {satellite.number}:")
        x, y = (float(dot.get_attribute(name) or "nan") for name in ("cx", "cy"))
        azimuth_rad = satellite.azimuth_deg * 3.14159265 / 180.0
        away = 88.0 * (1.0 - satellite.elevation_deg / 90.0)
        north, east = page.evaluate(f"[Math.cos({azimuth_rad}), Math.sin({azimuth_rad})]")
        assert (x, y) == pytest.approx((away * east, -away * north), abs=0.06)


@pytest.mark.parametrize(
    ("ratio", "said", "tone"),
    [(0.95, "0.8 s old, 95 % used", "plain"), (0.0, "0.8 s old, none used by the receiver", "bad")],
)
def test_corrections_that_the_receiver_does_not_use_are_told_in_red(
    page: Page, server: FakeServer, ratio: float, said: str, tone: str
) -> None:
    server.robot.receiver = make_receiver(correction_use_ratio=ratio)
    told = fact(page, "Corrections")
    expect(told).to_have_text(said)
    assert ("bad" in (told.get_attribute("class") or "")) is (tone == "bad")


@pytest.mark.parametrize(
    ("quality", "said"),
    [(1, "Single fix, no corrections"), (2, "DGNSS"), (4, "RTK fixed"), (5, "RTK float")],
)
def test_the_state_of_the_receiver_is_told_in_words(
    page: Page, server: FakeServer, quality: int, said: str
) -> None:
    server.robot.receiver = make_receiver(quality=quality)
    expect(card_of(page).get_by_role("status")).to_have_text(said)


def test_a_receiver_that_fell_silent_is_a_fault_and_nowhere_a_zero(
    page: Page, server: FakeServer
) -> None:
    page.set_viewport_size({"width": 844, "height": 390})
    card = card_of(page)
    expect(card.get_by_role("status")).to_have_text("RTK fixed")
    server.robot.receiver = make_receiver(
        fix_age_s=12.3, status_age_s=12, caster_state="failed", correction_trouble=LOST,
        line_trouble=BROKEN, **NO_SKY, **NO_CORRECTIONS,
    )  # fmt: skip
    expect(card.get_by_role("status")).to_have_text("No fix since 12 s")
    expect(card.locator(".tag.bad")).to_have_count(1)
    for name, said in (
        ("Last fix", "12 s ago"),
        ("Accuracy", "not known"),
        ("Satellites", "not reported for 12 s"),
        ("Dilution", "not reported for 12 s"),
        ("Corrections", "none"),
        ("Caster", LOST),
        ("Line", BROKEN),
    ):
        expect(fact(page, name)).to_have_text(said)
        expect(fact(page, name)).to_have_class("bad")
    expect(card.locator(".sky")).to_be_hidden()
    assert card.evaluate("card => card.scrollWidth <= card.clientWidth + 1")
    check(page, "the card of a receiver at fault")
    page.set_viewport_size({"width": 1280, "height": 800})


def test_a_receiver_without_a_first_fix_says_so(page: Page, server: FakeServer) -> None:
    server.robot.receiver = make_receiver(
        fix_age_s=None, quality=0, std_m=None, rate_hz=None, status_age_s=None, caster="",
        caster_state=None, **NO_SKY, **NO_CORRECTIONS,
    )  # fmt: skip
    expect(card_of(page).get_by_role("status")).to_have_text("No fix yet")
    expect(fact(page, "Last fix")).to_have_text("none since the start")
    expect(fact(page, "Satellites")).to_have_text("not reported")
