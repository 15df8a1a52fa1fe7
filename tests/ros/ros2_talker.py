"""A node of ROS 2 in a process of its own that publishes messages of any type.

Its arguments are a file of `write_for_ros2`, a domain, and a router, which it becomes; without one
it is on DDS. Says "ready" when all topics are announced.
"""

from __future__ import annotations

import itertools
import json
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from agribot.core.topics import LATCHED, STREAM, Topic
from agribot.record.bag.definitions import ros2_store
from agribot.ros.dds.node import DdsNode
from agribot.ros.ros2.node import Ros2Node


def join(domain: int, router: str = "") -> DdsNode | Ros2Node:
    if not router:
        return DdsNode("talker", domain)
    return Ros2Node("talker", domain, router, listen=True)


def talk(node: Any, line: str) -> None:
    name, ros_type, messages, rate_hz = json.loads(line)
    topic = Topic(name=name, ros_type=ros_type, qos=STREAM if rate_hz else LATCHED)
    publish = node.create_publisher(topic, ros2_store())
    data = [bytes.fromhex(each) for each in messages]
    if rate_hz:
        threading.Thread(target=repeat, args=(publish, data, rate_hz), daemon=True).start()
    else:
        publish(data[0])
        _kept.append(publish)


_kept: list[Callable[[bytes], None]] = []  # a publisher that is dropped ends


def repeat(publish: Callable[[bytes], None], messages: list[bytes], rate_hz: float) -> None:
    for data in itertools.cycle(messages):
        publish(data)
        time.sleep(1.0 / rate_hz)


if __name__ == "__main__":
    made = join(int(sys.argv[2]), *sys.argv[3:])
    for each in Path(sys.argv[1]).read_text(encoding="utf-8").splitlines():
        talk(made, each)
    if isinstance(made, DdsNode):
        made.announce()
    sys.stdout.write('"ready"\n')
    sys.stdout.flush()
    threading.Event().wait()
