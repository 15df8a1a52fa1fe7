"""Run one node on a link: messages from any thread are handled in one, in their order."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from typing import Any

from agribot.core.topics import Topic
from agribot.ros.connection import TopicConnection
from agribot.ros.nodes.stage import NodeStage, OutgoingMessage

PERIOD_S = 0.1
_QUEUE_MESSAGES = 2000  # seconds of a fast sensor; a flood loses what is newest
_REPORT_PERIOD_S = 5.0


class NodeRunner:
    """`report` gets why the node publishes nothing, at each change, but not too often."""

    def __init__(
        self, stage: NodeStage, link: TopicConnection, report: Callable[[str], None]
    ) -> None:
        self._stage, self._link, self._print = stage, link, report
        self._received: queue.Queue[tuple[Topic, bytes]] = queue.Queue(_QUEUE_MESSAGES)
        self._next_tick_s = time.monotonic()
        self._reported_reason, self._next_report_s = "", 0.0
        self.counts = {topic.name: 0 for topic in (*stage.inputs, *stage.outputs)}
        self.dropped = 0
        for topic in stage.outputs:
            link.advertise(topic)
        for topic in stage.inputs:
            link.subscribe(topic, self._make_subscriber(topic))

    def run(self, is_over: Callable[[], bool]) -> None:
        """Run until the node is done or `is_over`.

        Raises: BridgeError: the network was lost.
        """
        while not (self._stage.is_done or is_over()):
            self.step()
        self._publish(self._stage.finish())

    def step(self) -> None:
        """Handle one message, or wait for the next tick at most."""
        now_s = time.monotonic()
        if now_s >= self._next_tick_s:
            self._next_tick_s = max(self._next_tick_s + PERIOD_S, now_s)
            self._publish(self._stage.tick(now_s))
            self._report(now_s)
        try:
            topic, data = self._received.get(timeout=max(0.0, self._next_tick_s - now_s))
        except queue.Empty:
            return
        message = self._decode(topic, data)
        if message is not None:
            self.counts[topic.name] += 1
            self._publish(self._stage.receive(topic, message, time.monotonic()))

    def _make_subscriber(self, topic: Topic) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            try:
                self._received.put_nowait((topic, data))
            except queue.Full:
                self.dropped += 1

        return receive

    def _decode(self, topic: Topic, data: bytes) -> Any:
        from agribot.ros.messages.rosmsg import load_types

        try:
            return load_types().deserialize_cdr(data, topic.ros_type)
        except Exception:  # noqa: BLE001  rosbags raises what its generated code happens to
            self._print(f"{topic.name}: {len(data)} bytes are no {topic.ros_type}; dropped")
            return None

    def _publish(self, messages: tuple[OutgoingMessage, ...] | Any) -> None:
        from agribot.ros.messages.rosmsg import to_cdr

        for topic, message in messages:
            self.counts[topic.name] += 1
            self._link.publish(topic, to_cdr(message))

    def _report(self, now_s: float) -> None:
        reason = self._stage.reason
        if reason != self._reported_reason and now_s >= self._next_report_s:
            self._reported_reason, self._next_report_s = reason, now_s + _REPORT_PERIOD_S
            self._print(reason or "working")
