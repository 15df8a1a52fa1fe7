"""Print docs/topics.md: `python scripts/topics_page.py > docs/topics.md`."""

from __future__ import annotations

import sys

from agribot.core.inbound_topics import INBOUND_TOPICS
from agribot.core.topics import TOPICS, Qos, Topic

HEAD = """# Topics

Written by `make pages` from [`topics.py`](../src/agribot/core/topics.py).
Rates are nominal; "-" is "when it changes". QoS is reliable with depth 10, of latched topics 1;
latched topics reach those who come late. The ROS 1 bridge publishes under the original's name, too,
with its type where that differs. A topic with two names is published under
both by every bridge, and stands in a recording under the first.

| topic | type | Hz | the original's | what |
|---|---|---|---|---|
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
    kind = f"`{topic.ros_type}`" if topic.ros_type else "only AGRIBOT reads it"
    names = ", ".join(f"`{name}`" for name in topic.names)
    about = topic.about + _describe_qos(topic.qos)
    return f"| {names} | {kind} | {rate} | {_describe_original(topic)} | {about} |\n"


def _describe_original(topic: Topic) -> str:
    if not topic.seed_alias:
        return ""
    name = "same" if topic.seed_alias == topic.name else f"`{topic.seed_alias}`"
    return name if topic.seed_ros_type == topic.ros_type else f"{name} `{topic.seed_ros_type}`"


def _describe_qos(qos: Qos) -> str:
    """Say what differs from most topics; empty where nothing does."""
    if qos.latched:
        return "; latched"
    return "" if qos.reliable else f"; best effort, depth {qos.depth}"


if __name__ == "__main__":
    sys.stdout.write(page())
