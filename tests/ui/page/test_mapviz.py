"""A configuration of mapviz opened on the map, and the map written as one."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import expect

from agribot.ui.server.mapviz_config import displays_of
from tests import nightly
from tests.ui.page.conftest import OpenPage, until

FARM = Path(__file__).parents[1] / "data" / "farm.mvc"


@nightly.by_day(
    "tests/ui/test_mapviz_config.py::test_types_topics_colours_and_order_are_those_of_the_file",
    "tests/ui/test_mapviz_config.py::test_what_has_no_counterpart_is_named_with_the_reason",
    "tests/ui/test_mapviz_config.py::test_out_and_in_again_it_is_the_same",
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests",
)
def test_the_displays_of_mapviz_are_drawn_and_what_is_left_out_is_named(
    open_page: OpenPage,
) -> None:
    page = open_page(query="off=scene,camera")
    page.get_by_role("button", name="Layers and views").click()
    page.get_by_label("Mapviz configuration").set_input_files(FARM)
    told = page.get_by_role("dialog", name="From mapviz")
    expect(told).to_contain_text("7 displays read")
    expect(told).to_contain_text("house made: there is no display")
    expect(told).to_contain_text("satellite: the map 'Stamen (terrain)' is not on this robot")
    expect(told).to_contain_text("trajectory: shows GNSS receiver in place of /agribot/fix")
    expect(told).to_contain_text("lidar: nothing gives /scan now")
    page.get_by_role("button", name="Done").click()
    rows = page.locator(".layer-row")
    expect(rows.filter(has_text="filtered")).to_have_count(1)
    expect(page.get_by_role("checkbox", name="goals", exact=True)).not_to_be_checked()
    blue = (
        "window.__agribot.map.getStyle().layers.map(l => l.source)"
        ".filter(s => /^display-/.test(s)).map(s => window.__agribot.map.querySourceFeatures(s))"
        ".flat().some(f => f.properties.color === '#0000ff')"
    )
    until(page, blue)
    expect(page.get_by_label("Target frame")).to_have_value("heading")
    heading_right = (
        "Math.abs(((90 - window.__agribot.state().pose[2] * 180 / Math.PI + 270"
        " - window.__agribot.map.getBearing()) % 360 + 540) % 360 - 180) < 2"
    )
    until(page, heading_right)
    with page.expect_download() as saved:
        page.get_by_role("button", name="To mapviz").click()
    found = displays_of(Path(saved.value.path()).read_bytes())
    assert found["view"] == {"target": "heading", "turn": 270}, "as in the file"
    written = found["displays"]
    named = {display["title"]: display for display in written}
    assert list(named)[-1] == "filtered", "the topmost is last, as in the file"
    assert named["trajectory"]["options"]["color"] == "#0000ff"
    assert named["grid"]["options"]["columns"] == 8
    assert not named["goals"]["visible"]
