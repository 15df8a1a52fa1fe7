"""Sensors from other people's ROS topics: `ros2:/fix`, `ros1://HOST:PORT/imu/data`."""

from __future__ import annotations

from typing import Protocol

from agribot.core.platform import Sensor
from agribot.drivers.line.schemes import SourceContext, SourceUri
from agribot.ros.messages.sensor_readers import make_image_readers, make_readers
from agribot.ros.ros1.master import check_master
from agribot.ros.topic_source import TopicSource, UntypedConnection

NODE = "agribot_sensors"


class ListingConnection(UntypedConnection, Protocol):
    """A network that knows which topics are published on it."""

    def list_topics(self) -> dict[str, str]:
        """List the topics that somebody publishes, with their types.

        Raises: BridgeError: the network is gone.
        """
        ...


def open_ros2_topic(sensor: Sensor, uri: SourceUri, context: SourceContext) -> TopicSource:
    """Open a topic of ROS 2.

    Raises: BridgeError: the network cannot be reached.
    """
    return _open_topic(sensor, uri, context, _connect_ros2(uri, context))


def open_ros1_topic(sensor: Sensor, uri: SourceUri, context: SourceContext) -> TopicSource:
    """Open a topic of ROS 1.

    Raises: BridgeError: the master cannot be reached.
    """
    return _open_topic(sensor, uri, context, _connect_ros1(uri, context))


def open_pictures(uri: SourceUri, context: SourceContext) -> TopicSource:
    """Open a topic of ROS 1 or 2 with pictures of any size.

    Raises: BridgeError: the network cannot be reached.
    """
    connect = _connect_ros1 if uri.scheme == "ros1" else _connect_ros2
    readers = make_image_readers(None)
    return TopicSource("frames", uri.path, connect(uri, context), readers, context.refuse)


def list_topics(uri: SourceUri, context: SourceContext) -> dict[str, str]:
    """List the topics that somebody publishes on the network of a topic, with their types.

    Raises: BridgeError: the network is gone.
    """
    connect = _connect_ros1 if uri.scheme == "ros1" else _connect_ros2
    return connect(uri, context).list_topics()


def _connect_ros2(uri: SourceUri, context: SourceContext) -> ListingConnection:
    from agribot.ros.ros2.connection import Ros2Connection

    router = f"tcp/{uri.at}" if uri.at else context.ros.router()
    return context.share(
        ("ros2", uri.at),
        lambda: Ros2Connection(NODE, domain=context.ros.domain(), router=router, listen=not uri.at),
    )


def _connect_ros1(uri: SourceUri, context: SourceContext) -> ListingConnection:
    from agribot.ros.ros1.connection import Ros1Connection

    master = check_master(f"http://{uri.at}") if uri.at else context.ros.master()
    return context.share(("ros1", uri.at), lambda: Ros1Connection(NODE, context.refuse, master))


def _open_topic(
    sensor: Sensor, uri: SourceUri, context: SourceContext, link: UntypedConnection
) -> TopicSource:
    known = make_readers(sensor, context.robot)
    return TopicSource(sensor, uri.path, link, known, context.refuse)
