"""Runs one node on a link: messages from any thread are heard in one, in their order."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from typing import Any

from agribot.core.topics import Topic
from agribot.ros.link import Link
from agribot.ros.nodes.stage import Said, Stage

PERIOD_S = 0.1
_QUEUE_MESSAGES = 2000  # seconds of a fast sensor; a flood loses what is newest
_SAY_PERIOD_S = 5.0


class NodeRunner:
    """`say` hears why the node is quiet, at each change, but not more often than needed."""

    def __init__(self, stage: Stage, link: Link, say: Callable[[str], None]) -> None:
        self._stage, self._link, self._say = stage, link, say
        self._heard: queue.Queue[tuple[Topic, bytes]] = queue.Queue(_QUEUE_MESSAGES)
        self._next_tick_s = time.monotonic()
        self._said_reason, self._next_say_s = "", 0.0
        self.counts = {topic.name: 0 for topic in (*stage.inputs, *stage.outputs)}
        self.dropped = 0
        for topic in stage.outputs:
            link.advertise(topic)
        for topic in stage.inputs:
            link.hear(topic, self._hearer(topic))

    def run(self, is_over: Callable[[], bool]) -> None:
        """Until the node is done or `is_over`. Raises: BridgeError: the network was lost."""
        while not (self._stage.is_done or is_over()):
            self.step()
        self._publish(self._stage.last_words())

    def step(self) -> None:
        """Hear one message, or wait for the next tick at most."""
        now_s = time.monotonic()
        if now_s >= self._next_tick_s:
            self._next_tick_s = max(self._next_tick_s + PERIOD_S, now_s)
            self._publish(self._stage.tick(now_s))
            self._tell(now_s)
        try:
            topic, data = self._heard.get(timeout=max(0.0, self._next_tick_s - now_s))
        except queue.Empty:
            return
        message = self._decoded(topic, data)
        if message is not None:
            self.counts[topic.name] += 1
            self._publish(self._stage.hear(topic, message, time.monotonic()))

    def _hearer(self, topic: Topic) -> Callable[[bytes], None]:
        def heard(data: bytes) -> None:
            try:
                self._heard.put_nowait((topic, data))
            except queue.Full:
                self.dropped += 1

        return heard

    def _decoded(self, topic: Topic, data: bytes) -> Any:
        from agribot.ros.messages.rosmsg import typestore

        try:
            return typestore().deserialize_cdr(data, topic.ros_type)
        except Exception:  # noqa: BLE001  rosbags raises what its generated code happens to
            self._say(f"{topic.name}: {len(data)} bytes are no {topic.ros_type}; dropped")
            return None

    def _publish(self, said: tuple[Said, ...] | Any) -> None:
        from agribot.ros.messages.rosmsg import to_cdr

        for topic, message in said:
            self.counts[topic.name] += 1
            self._link.publish(topic, to_cdr(message))

    def _tell(self, now_s: float) -> None:
        reason = self._stage.reason
        if reason != self._said_reason and now_s >= self._next_say_s:
            self._said_reason, self._next_say_s = reason, now_s + _SAY_PERIOD_S
            self._say(reason or "working")


def last_of(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count) or "nothing"
