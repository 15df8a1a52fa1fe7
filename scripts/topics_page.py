"""Print docs/topics.md: `python scripts/topics_page.py > docs/topics.md`."""

from __future__ import annotations

import sys

from agribot.core.inbound_topics import INBOUND_TOPICS
from agribot.core.topics import TOPICS, Topic

HEAD = """# Topics

Written by `make pages` from [`topics.py`](../src/agribot/core/topics.py).
Rates are nominal; "-" is "when it changes". Latched topics reach those who come late. The
original's name and type are what the ROS 1 bridge adds. A topic with two names is published under
both by every bridge, and stands in a recording under the first.

| topic | type | Hz | QoS | the original's | what |
|---|---|---|---|---|---|
"""


INBOUND_HEAD = """
## What a run takes

From [`inbound_topics.py`](../src/agribot/core/inbound_topics.py); [who may send](ros.md#requests).

| topic | in ROS 1 | type | what |
|---|---|---|---|
"""


def page() -> str:
    outbound, inbound = map(_row, TOPICS), map(_inbound_row, INBOUND_TOPICS)
    return HEAD + "".join(outbound) + INBOUND_HEAD + "".join(inbound)


def _inbound_row(topic: Topic) -> str:
    name, seed = topic.name, topic.seed_alias or topic.name
    return f"| `{name}` | `{seed}` | `{topic.ros_type}` | {topic.about} |\n"


def _row(topic: Topic) -> str:
    rate = "-" if topic.rate_hz is None else f"{topic.rate_hz:g}"
    qos = "reliable" if topic.qos.reliable else "best effort"
    qos += f", depth {topic.qos.depth}" + (", latched" if topic.qos.latched else "")
    seed = f"`{topic.seed_alias}` `{topic.seed_ros_type}`" if topic.seed_alias else ""
    ros_type = f"`{topic.ros_type}`" if topic.ros_type else "only AGRIBOT reads it"
    names = ", ".join(f"`{name}`" for name in topic.names)
    return f"| {names} | {ros_type} | {rate} | {qos} | {seed} | {topic.about} |\n"


if __name__ == "__main__":
    sys.stdout.write(page())
