"""A client of Foxglove's WebSocket protocol watches; it has no way to move the robot."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.ros.foxglove_server import FoxgloveGateway
from agribot.ros.messages import rosmsg
from tests.waiting import PATIENCE_S

OUT = [topic for topic in topics.TOPICS if topic.ros_type]


@pytest.fixture(scope="module")
def gateway() -> Iterator[FoxgloveGateway]:
    with closing(FoxgloveGateway(OUT, port=0)) as running:
        yield running


@pytest.fixture
def client(gateway: FoxgloveGateway) -> Iterator[ClientConnection]:
    address = f"ws://127.0.0.1:{gateway.port}"
    with connect(address, subprotocols=["foxglove.sdk.v1"]) as connection:  # type: ignore[list-item]
        assert connection.subprotocol == "foxglove.sdk.v1"
        yield connection


def greeting(client: ClientConnection) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the server says of itself, and its channels by topic."""
    info: dict[str, Any] = {}
    channels: dict[str, Any] = {}
    while len(channels) < len(OUT):
        said = json.loads(client.recv(PATIENCE_S))
        if said["op"] == "serverInfo":
            info = said
        elif said["op"] == "advertise":
            channels |= {channel["topic"]: channel for channel in said["channels"]}
    return info, channels


def subscribe(client: ClientConnection, channel: dict[str, Any], number: int) -> None:
    wish = {"op": "subscribe", "subscriptions": [{"id": number, "channelId": channel["id"]}]}
    client.send(json.dumps(wish))


def message(client: ClientConnection) -> tuple[int, int, bytes]:
    """Subscription, time in ns, CDR."""
    while True:
        data = client.recv(PATIENCE_S)
        if isinstance(data, bytes) and data[0] == 1:
            number, t_ns = struct.unpack_from("<IQ", data, 1)
            return number, t_ns, data[13:]


def test_every_topic_is_offered_with_its_ros_type(client: ClientConnection) -> None:
    _, channels = greeting(client)
    for topic in OUT:
        channel = channels[topic.name]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        assert channel["schemaName"] == topic.ros_type


def test_a_late_client_gets_the_latched_description_and_then_what_is_new(
    gateway: FoxgloveGateway, client: ClientConnection
) -> None:
    urdf = rosmsg.to_cdr(rosmsg.make_text("<robot/>"))
    gateway.publish(topics.ROBOT_DESCRIPTION, urdf, 5)
    _, channels = greeting(client)
    subscribe(client, channels[topics.ROBOT_DESCRIPTION.name], 7)
    assert message(client) == (7, 5, urdf)
    newer = rosmsg.to_cdr(rosmsg.make_text("<robot name='b'/>"))
    gateway.publish(topics.ROBOT_DESCRIPTION, newer, 6)
    assert message(client) == (7, 6, newer)


def test_the_server_offers_no_way_to_ask_for_anything(client: ClientConnection) -> None:
    info, _ = greeting(client)
    assert info["capabilities"] == []
    # A client that tries all the same is refused or disconnected, and publishes nothing.
    wish = {"id": 1, "topic": "/agribot/cmd_vel", "encoding": "cdr", "schemaName": "x"}
    client.send(json.dumps({"op": "advertise", "channels": [wish]}))
    said = json.loads(client.recv(PATIENCE_S))
    assert said["op"] == "status"
    assert said["level"] > 0


def test_a_taken_port_is_named(gateway: FoxgloveGateway) -> None:
    with pytest.raises(BridgeError, match="--foxglove-port"):
        FoxgloveGateway(OUT, port=gateway.port)
