"""The scene of the map's displays, published over DDS by a process of its own.

Its arguments are the domain and the topics. Says "ready" when all are announced.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial

from agribot.core.topics import LATCHED, STREAM, Topic
from agribot.record.bag.definitions import ros2_store, serialize
from agribot.ros.dds.node import DdsNode
from tests.ros.messages.shown_scene import make_scene


def announce_scene(node: DdsNode, names: Sequence[str]) -> list[Callable[[], None]]:
    """Publish the latched messages; return what publishes the others once."""
    again: list[Callable[[], None]] = []
    for said in make_scene():
        if said.topic in names:
            ros_type = said.message.__msgtype__
            qos = STREAM if said.rate_hz else LATCHED
            topic = Topic(name=said.topic, ros_type=ros_type, qos=qos)
            publish = node.create_publisher(topic, ros2_store())
            data = serialize(ros2_store(), ros_type, True, said.message)
            if said.rate_hz:
                again.append(partial(publish, data))
            else:
                publish(data)
    node.announce()
    return again


def main() -> None:
    with closing(DdsNode("talker", int(sys.argv[1]))) as node:
        again = announce_scene(node, sys.argv[2:])
        sys.stdout.write('"ready"\n')
        sys.stdout.flush()
        while not threading.Event().wait(1.0):
            for publish in again:
                publish()


if __name__ == "__main__":
    main()
