"""Every row of the topic table to ROS 1 and back again, with exact values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from agribot.core import topics
from agribot.core.topics import Topic
from agribot.ros.messages.rosmsg import load_types, to_cdr
from agribot.ros.ros1.types import find_input, list_outputs, load_ros1_types
from tests.record.bag.random_messages import Dice

ROWS = [topic for topic in topics.TOPICS if topic.ros_type]
GROWN = {topics.WEEDS.ros_type}  # ROS 2 gave Marker further fields, which ROS 1 does not carry


def sample(topic: Topic, seed: int = 1) -> tuple[Any, bytes]:
    message, _ = Dice(load_types(), seed).message(topic.ros_type)
    return message, bytes(load_types().serialize_cdr(message, topic.ros_type))


@pytest.mark.parametrize("topic", ROWS, ids=lambda topic: topic.name)
def test_a_row_of_the_table_is_the_same_after_ros_1_and_back(topic: Topic) -> None:
    _, cdr = sample(topic)
    for output in list_outputs(topic):
        there = output.convert(cdr)
        assert load_ros1_types().deserialize_ros1(there, output.ros_type)
        if output.ros_type == topic.ros_type and topic.ros_type not in GROWN:
            assert bytes(load_types().ros1_to_cdr(there, output.ros_type)) == cdr


@pytest.mark.parametrize(
    "topic", [row for row in ROWS if row.seed_alias], ids=lambda topic: topic.seed_alias
)
def test_what_goes_out_under_the_originals_name_is_heard_under_it(topic: Topic) -> None:
    message, cdr = sample(topic, seed=2)
    name, ros_type, convert = find_input(topic)
    (out,) = (o for o in list_outputs(topic) if (o.name, o.ros_type) == (name, ros_type))
    back = convert(out.convert(cdr))
    if ros_type == topic.ros_type:
        assert back == cdr
        return
    got: Any = load_types().deserialize_cdr(back, topic.ros_type)
    if topic is topics.MAGNETIC:
        for axis in "xyz":
            assert getattr(got.magnetic_field, axis) == getattr(message.magnetic_field, axis)
        assert got.header == message.header
    elif topic is topics.EXTENDED_FIX:
        assert back == cdr
    else:
        assert topic is topics.POSE
        assert got.pose == message.pose


def test_the_markers_of_the_weed_map_keep_what_ros_1_has_of_them() -> None:
    message, cdr = sample(topics.WEEDS)
    (output,) = list_outputs(topics.WEEDS)
    got: Any = load_ros1_types().deserialize_ros1(output.convert(cdr), output.ros_type)
    for mine, theirs in zip(message.markers, got.markers, strict=True):
        assert (theirs.ns, theirs.id, theirs.type) == (mine.ns, mine.id, mine.type)
        places = [(p.x, p.y, p.z) for p in mine.points]
        assert [(p.x, p.y, p.z) for p in theirs.points] == places
        assert (theirs.color.r, theirs.scale.x) == (mine.color.r, mine.scale.x)


def test_a_message_of_our_own_making_is_among_them() -> None:
    """The random messages are of the kind that the table's own writers make."""
    data = to_cdr(load_types().types["std_msgs/msg/Float64"](np.float64(1.5)))
    (own, _) = list_outputs(topics.ANGLE)
    assert bytes(load_types().ros1_to_cdr(own.convert(data), own.ros_type)) == data
