"""Each display with a topic of ROS 1, of ROS 2 over zenoh and of ROS 2 on DDS looks the same."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests import machine, nightly
from tests.ros.messages.gallery_scene import make_gallery
from tests.ui.page.display_gallery import FIELD, NETWORKS, SIZE_PX, Gallery, count_changed

pytestmark = nightly.by_day(
    "tests/ros/test_shown_topics_live.py"
    "::test_each_display_gets_its_message_over_zenoh_and_latched_ones_afterwards",
    "tests/ros/test_shown_topics_live.py"
    "::test_topics_of_dds_are_listed_by_type_shown_and_left_again",
    "tests/ui/page/test_build.py::test_the_page_type_checks_and_its_pure_parts_pass_their_tests",
)
MOST_APART = 0.01  # of the pixels: the edges of shapes


def test_each_display_is_the_same_from_every_network(browser: Browser, tmp_path: Path) -> None:
    """Tracks are drawn whole, but where they end differs."""
    machine.require("roscore")
    pytest.importorskip("zenoh")
    pytest.importorskip("cyclonedds")
    shown = [one for one in make_gallery(FIELD) if one.topic and len(one.messages) <= 1]
    assert len(shown) > 12
    made = {}
    for network in NETWORKS:
        folder = tmp_path / network
        folder.mkdir()
        with closing(Gallery(browser, network, folder)) as gallery:
            made[network] = {one.display: gallery.show(one) for one in shown}
    most = MOST_APART * SIZE_PX[0] * SIZE_PX[1]
    for display, picture in made["ros1"].items():
        for other in ("ros2", "dds"):
            assert count_changed(picture, made[other][display]) < most, (display, other)
