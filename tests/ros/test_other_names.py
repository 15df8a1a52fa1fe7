"""A topic with two names reaches listeners of both, on every network; a recording has it once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing

import pytest

from agribot.core import topics
from agribot.core.messages import Inbox
from agribot.core.topics import Topic
from agribot.ros.messages import rosmsg
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.topic_writer import TopicWriter
from agribot.ros.requests import Requests
from agribot.ros.ros1.types import list_outputs
from agribot.ros.ros2.connection import Ros2Connection
from agribot.ros.ros2.gateway import Ros2Gateway
from agribot.ros.tick_publisher import Gateway
from tests.record import record_samples as samples
from tests.ros.live import free_port
from tests.ros.test_tick_publisher import DATUM
from tests.waiting import wait_for

OUT = [topics.ODOM, topics.JOINT_STATES]
NAMES = {"/odom", "/agribot/odom", "/joint_states", "/agribot/joint_states"}


def messages() -> list[tuple[Topic, bytes]]:
    kept: list[tuple[Topic, bytes]] = []

    def keep(topic: Topic, _log_ns: int, data: bytes, _publish_ns: int) -> None:
        if topic in OUT:
            kept.append((topic, data))

    robot = samples.robot()
    writer = TopicWriter(keep, robot, DATUM, samples.URDF, CameraLog(robot, 0.0, 80))
    for record in samples.ticks(2):
        writer(record)
    return kept


def named(name: str) -> Topic:
    found = topics.find_topic(name)
    assert found is not None
    return next(topic for topic in found.list_named() if topic.name == name)


def hear(gateway: Gateway, subscribe: Callable[[Topic, Callable[[bytes], None]], object]) -> None:
    """Publish again and again until each name has been heard with the very bytes."""
    heard: dict[str, bytes] = {}
    for name in NAMES:

        def note(data: bytes, name: str = name) -> None:
            heard[name] = data

        subscribe(named(name), note)
    sent = messages()

    def publish() -> bool:
        for topic, data in sent:
            gateway.publish(topic, data, 0)
        return set(heard) == NAMES

    wait_for(publish, f"all of {sorted(NAMES)}")
    newest = {topic.name: data for topic, data in sent}
    for name in NAMES:
        found = topics.find_topic(name)
        assert found is not None
        assert rosmsg.load_types().deserialize_cdr(heard[name], found.ros_type)
        assert len(heard[name]) == len(newest[found.name])


def test_on_ros2() -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    gateway = Ros2Gateway(Requests(Inbox()), OUT, router=router, serves=False)
    with closing(gateway), closing(Ros2Connection("peer", router=router)) as peer:
        hear(gateway, peer.subscribe)


def test_on_dds() -> None:
    pytest.importorskip("cyclonedds")
    from agribot.ros.dds.gateway import DdsGateway
    from agribot.ros.dds.node import DdsNode

    domain = 17
    with (
        closing(DdsGateway(Requests(Inbox()), OUT, domain=domain)) as gateway,
        closing(DdsNode("peer", domain)) as peer,
    ):
        hear(gateway, peer.subscribe)


def test_in_foxglove() -> None:
    pytest.importorskip("foxglove")
    from agribot.ros.foxglove_server import FoxgloveGateway

    with closing(FoxgloveGateway(OUT, free_port())) as gateway:
        assert set(gateway._channels) == NAMES
        for topic, data in messages():
            gateway.publish(topic, data, 0)


def test_on_ros1_and_in_a_recording() -> None:
    assert {output.name for topic in OUT for output in list_outputs(topic)} == NAMES
    assert {topic.name for topic, _ in messages()} == {"/odom", "/agribot/joint_states"}
