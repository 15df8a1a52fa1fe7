"""The robot alone in 3D, of `agribot describe --ui`: no robot runs, the sliders turn the joints."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.ui.page.conftest import new_context, until
from tests.ui.page.robots import Robot, described

ARM = """<link name="arm"><visual><geometry><box size="0.4 0.05 0.05"/></geometry></visual></link>
<joint name="lift" type="prismatic"><parent link="base_link"/><child link="arm"/>
<origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
<limit lower="-0.1" upper="0.3" effort="1" velocity="1"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """Our own robot with an arm that slides up and down, as a file of the user's."""
    from agribot.description.loader import export_urdf

    file = tmp_path_factory.mktemp("described") / "armed.urdf"
    file.write_text(export_urdf("agribot").replace("</robot>", ARM))
    with described(file) as robot:
        yield robot


@pytest.fixture(scope="module")
def page(browser: Browser, robot: Robot) -> Iterator[Page]:
    context = new_context(browser, viewport={"width": 900, "height": 500}, locale="en")
    page = context.new_page()
    page.goto(robot.address)
    expect(page.get_by_role("slider").first).to_be_visible()
    yield page
    context.close()  # or its picture would be drawn until the last test of the page has ended


def test_every_movable_joint_has_a_slider_within_its_limits(page: Page) -> None:
    sliders = page.get_by_role("slider")
    expect(sliders).to_have_count(5)  # four wheels and the arm
    lift = page.get_by_role("slider", name="Lift")
    assert (lift.get_attribute("min"), lift.get_attribute("max")) == ("-0.1", "0.3")


def test_a_slider_moves_its_joint_in_the_picture(page: Page) -> None:
    picture = page.locator("canvas")
    lift = page.get_by_role("slider", name="Lift")
    lift.fill("-0.1")
    expect(page.locator(".joints")).to_contain_text("-0.100 m")
    low = picture.screenshot()
    lift.fill("0.3")
    expect(page.locator(".joints")).to_contain_text("0.300 m")
    until(page, "document.visibilityState === 'visible'")
    assert picture.screenshot() != low


def test_nothing_on_it_speaks_of_a_robot_that_runs(page: Page) -> None:
    assert page.locator("#stop, .statusbar, .banner, .toast").count() == 0
    assert page.title() == "agribot · AGRIBOT"


def test_an_interrupt_ends_it(robot: Robot) -> None:
    assert robot.end() == 0
