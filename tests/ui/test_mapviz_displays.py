"""A program of ROS adds displays to the page's map by the service of mapviz."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from agribot.ros.display_requests import ADD_DISPLAY_SERVICE, DisplayRequest
from agribot.ros.ros2.display_service import ADD_DISPLAY, load_display_types
from agribot.ros.ros2.node import Ros2Node
from agribot.ui import wire
from agribot.ui.about import About, RosPlaces
from agribot.ui.server.mapviz_layers import make_layer
from agribot.ui.server.outside_layers import BadLayer
from tests import machine
from tests.ros.live import ROOT, free_port
from tests.ros.ros1_system import Ros1
from tests.ros.ros2_transports import DdsUser, RequestingUser, ZenohUser
from tests.ui import conftest
from tests.ui.client import Browser
from tests.waiting import wait_for

Display = tuple[str, str, int, bool, dict[str, str]]
SCAN: Display = (
    "front", "mapviz_plugins/laserscan", -1, True,
    {"topic": "/scan", "size": "4", "use_rainbow": "true"},
)  # fmt: skip
HOLOGRAM: Display = ("h", "mapviz_plugins/hologram", 0, True, {"topic": "/scan"})
ANSWERS = [
    [True, "display 'front' set"],
    [False, "type 'mapviz_plugins/hologram' is not a display of the map; name another"],
]


class Robot(conftest.Robot):
    """A robot whose page takes displays from a network."""

    places = RosPlaces()

    def _about(self, port: int) -> About:
        return msgspec.structs.replace(super()._about(port), ros=self.places)


@contextmanager
def page_on(places: RosPlaces, folder: Path) -> Iterator[Robot]:
    robot = Robot(folder)
    robot.places, robot.answers[wire.ListPanels] = places, []
    robot.start()
    try:
        yield robot
    finally:
        robot.server.close()


def check_the_map(robot: Robot, network: str) -> None:
    [layer] = Browser(robot.port).ask("GET", "/api/v1/layers")[1]
    assert (layer["title"], layer["type"], layer["topic"]) == (
        "front", "laserscan", f"{network}:/scan",
    )  # fmt: skip
    assert (layer["draw_order"], layer["visible"]) == (0, True)
    assert layer["style"] == {"size": 4.0, "rainbow": True}
    robot.wait_for_request("note", lambda request: bool(request.text == "display 'front' set"))


def test_a_client_of_rospy_adds_a_display_at_a_real_master(tmp_path: Path) -> None:
    machine.require("roscore")
    ros = Ros1(tmp_path)
    places = RosPlaces(master=ros.uri, layers_from=("ros1",))
    with page_on(places, tmp_path / "page") as robot:
        script = str(ROOT / "tests" / "ros" / "rospy_display.py")
        client = ros.start("/usr/bin/python3", script, json.dumps(SCAN), json.dumps(HOLOGRAM))
        assert client.stdout is not None
        assert [json.loads(line) for line in client.stdout] == ANSWERS
        check_the_map(robot, "ros1")
    ros.close()


@pytest.mark.parametrize("network", ["ros2", "dds"])
def test_a_client_of_ros2_adds_a_display_over_zenoh_and_dds(network: str, tmp_path: Path) -> None:
    if network == "dds":
        pytest.importorskip("cyclonedds")
    domain, router = 160 + os.getpid() % 20, f"tcp/127.0.0.1:{free_port()}"
    places = RosPlaces(domain=domain, router=router, layers_from=(network,))
    with (
        closing(Ros2Node("router", domain, router, listen=True)) as node,
        closing(DdsUser(domain) if network == "dds" else ZenohUser(router, domain)) as user,
        page_on(places, tmp_path) as robot,
    ):
        if network == "ros2":
            wait_for(lambda: any("add_mapviz" in one for one in node.list_tokens()), "the service")
        answers = [call(user, *display) for display in (SCAN, HOLOGRAM)]
        assert [[one.success, one.message] for one in answers] == ANSWERS
        check_the_map(robot, network)


def call(user: RequestingUser, *display: Any) -> Any:
    types = load_display_types()
    make = types.types["marti_common_msgs/msg/KeyValue"]
    *fields, properties = display
    pairs = [make(*pair) for pair in properties.items()]
    return user._call(ADD_DISPLAY_SERVICE, ADD_DISPLAY, *fields, pairs, types=types)


def make(**changes: Any) -> wire.OutsideLayer:
    request = DisplayRequest(name="front", type="mapviz_plugins/laserscan", properties=SCAN[4])
    return make_layer("ros1", msgspec.structs.replace(request, **changes), 3)[0]


def test_the_order_of_mapviz_counts_from_the_lowest_and_ours_from_the_top() -> None:
    """1 is the lowest of all, -1 the topmost, and 0 keeps the order that it has."""
    orders = [make(draw_order=order).draw_order for order in (-1, -2, 1, 2, 0)]
    assert orders == [0, 1, -1, -2, 3]


def test_colours_stay_texts_and_what_does_not_fit_is_named() -> None:
    path = {"topic": "/way", "color": "#00ff00"}
    assert make(type="path", properties=path).style == {"color": "#00ff00"}
    request = DisplayRequest(name="a", type="path", properties={**path, "color": "true"})
    assert make_layer("dds", request, None)[0].topic == "dds:/way"
    odd = msgspec.structs.replace(request, type="pose", properties={**path, "buffer_size": "x"})
    assert "buffer_size = 'x'" in make_layer("dds", odd, None)[1]
    frame = msgspec.structs.replace(request, type="tf_frame", properties={"frame": "laser"})
    assert make_layer("dds", frame, None)[0].topic == "dds:frame:laser"


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"type": "mapviz_plugins/measuring"}, "a tool"),
        ({"properties": {}}, "add the property topic"),
    ],
)
def test_a_display_that_cannot_be_added_is_refused_with_the_reason(
    changes: dict[str, Any], why: str
) -> None:
    with pytest.raises(BadLayer, match=why):
        make(**changes)
