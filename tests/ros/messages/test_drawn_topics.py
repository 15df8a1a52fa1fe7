"""What an operator shows on the map goes out as the messages that mapviz's tools send."""

from __future__ import annotations

import math

import pytest

from agribot.core import topics
from agribot.core.messages import DrawShape, PointOut, RequestEvent, ShapeKind
from agribot.record.bag.definitions import ros1_store
from agribot.ros.messages.drawn_topics import list_drawn
from agribot.ros.messages.rosmsg import load_types, to_cdr
from agribot.ros.ros1.types import list_outputs
from tests.asking import ask, go_to


def draw(shape: ShapeKind, *corners_map_m: tuple[float, float]) -> RequestEvent:
    return ask(DrawShape(shape=shape, corners_map_m=corners_map_m))


def test_each_tool_sends_its_message_in_the_map() -> None:
    events = [
        ask(go_to((1.0, 2.0, math.pi / 2))),
        ask(PointOut(x_map_m=3.0, y_map_m=4.0)),
        draw("polygon", (0.0, 0.0), (1.0, 0.0), (1.0, 1.0)),
        draw("route", (0.0, 0.0), (0.0, 2.0), (5.0, 2.0)),
        ask("note"),
    ]
    found = {topic.name: message for topic, message in list_drawn(events, 1.5)}
    for topic in (topics.GOAL_POSE, topics.CLICKED_POINT, topics.DRAWN_POLYGON, topics.DRAWN_ROUTE):
        message = found[topic.name]
        assert message.header.frame_id == "map"
        again = load_types().deserialize_cdr(to_cdr(message), topic.ros_type)
        assert again.header.stamp.nanosec == 500_000_000  # type: ignore[attr-defined]
    assert found["/agribot/goal_pose"].pose.orientation.z == pytest.approx(math.sqrt(0.5))
    assert found["/clicked_point"].point.y == 4.0
    assert [(c.x, c.y) for c in found["/agribot/polygon"].polygon.points][2] == (1.0, 1.0)
    turned = [pose.pose.orientation.z for pose in found["/agribot/route"].poses]
    assert turned == pytest.approx([math.sqrt(0.5), 0.0, 0.0])


def test_a_shape_without_places_or_with_a_number_that_is_none_is_not_sent() -> None:
    nowhere = ask(PointOut(x_map_m=math.nan, y_map_m=1.0))
    assert list(list_drawn([draw("route"), nowhere], 0.0)) == []


def test_a_route_goes_to_ros_1_as_a_path_and_as_a_route_of_marti() -> None:
    [(topic, message)] = list_drawn([draw("route", (0.0, 0.0), (0.0, 2.0))], 1.5)
    outputs = {output.name: output for output in list_outputs(topic)}
    marti = outputs["/route"]
    assert marti.ros_type == "marti_nav_msgs/msg/Route"
    assert marti.latched
    route = ros1_store().deserialize_ros1(marti.convert(to_cdr(message)), marti.ros_type)
    points = route.route_points  # type: ignore[attr-defined]
    assert [(point.id, point.pose.position.y) for point in points] == [("0", 0.0), ("1", 2.0)]
