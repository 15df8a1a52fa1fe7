"""What a talker of a test publishes, as a file that its process reads."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from agribot.record.bag.definitions import name_in_ros1, ros1_store, ros2_store, serialize
from tests.ros.messages.shown_scene import Said, make_scene, to_ros1


class Publication(NamedTuple):
    """Messages of one topic, one after the other; `rate_hz` 0 is the first alone, latched."""

    topic: str
    messages: Sequence[Any]
    rate_hz: float


def list_scene(*topics: str) -> list[Publication]:
    """List the scene of the displays, or these topics of it."""
    return [_publish(said) for said in make_scene() if not topics or said.topic in topics]


def _publish(said: Said) -> Publication:
    return Publication(said.topic, [said.message], said.rate_hz)


def write_for_ros1(path: Path, publications: Iterable[Publication]) -> None:
    """Write topic, type, its definition, messages (hexadecimal) and rate, one JSON a line."""
    lines = []
    for topic, messages, rate_hz in publications:
        ros_type = name_in_ros1(messages[0].__msgtype__)
        definition, _ = ros1_store().generate_msgdef(ros_type, ros_version=1)
        data = [to_ros1(each).hex() for each in messages]
        lines.append(json.dumps([topic, ros_type.replace("/msg/", "/"), definition, data, rate_hz]))
    path.write_text("\n".join(lines), encoding="utf-8")


def write_for_ros2(path: Path, publications: Iterable[Publication]) -> None:
    """Write topic, type, messages (hexadecimal) and rate, one JSON a line."""
    lines = []
    for topic, messages, rate_hz in publications:
        ros_type = messages[0].__msgtype__
        data = [serialize(ros2_store(), ros_type, True, each).hex() for each in messages]
        lines.append(json.dumps([topic, ros_type, data, rate_hz]))
    path.write_text("\n".join(lines), encoding="utf-8")
