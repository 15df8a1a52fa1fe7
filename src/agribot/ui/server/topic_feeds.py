"""The topics of one network that displays look at: opened when asked for, closed when not."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec

from agribot.core.errors import BridgeError
from agribot.core.messages import FloatArray
from agribot.ros.display_requests import TakeDisplay
from agribot.ros.graph import Graph
from agribot.ros.messages.frame_tree import FrameTree
from agribot.ros.messages.shown_messages import FramePlaces, UnknownFrame
from agribot.ros.messages.shown_types import BESIDE, SHOWN_TYPES
from agribot.ros.topic_network import OpenTopic, TopicNetwork
from agribot.ui import wire
from agribot.ui.server.shown_topic import Decode, ShownTopic, show_frame

MOST_TOPICS = 24
IDLE_S = 10.0  # time without a look after which a topic is closed
LIST_S = 2.0  # period of looks at the list of topics
FRAME = "frame:"  # prefix of a frame that is shown like a topic
TRANSFORM_TOPICS = ("/tf", "/tf_static")
_TRANSFORMS_KEPT = 1000


class _Feed:
    def __init__(self, shown: ShownTopic) -> None:
        self.shown = shown
        self.opened: list[OpenTopic] = []
        self.asked_s = 0.0
        self.next_try_s = 0.0
        self.problem = ""

    def close(self) -> None:
        for topic in self.opened:
            topic.close()
        self.opened.clear()


class TopicFeeds:
    """All calls may block for as long as the network does, and are made one at a time."""

    def __init__(
        self,
        network: TopicNetwork,
        decode: Decode,
        body_frames: dict[str, FloatArray],
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._network, self._decode, self._now_s = network, decode, now_s
        self._lock = threading.Lock()
        self._tree = FrameTree()
        self._places = FramePlaces(self._tree.find, body_frames)
        self._transforms: deque[tuple[str, bytes]] = deque(maxlen=_TRANSFORMS_KEPT)
        self._transform_topics: dict[str, OpenTopic] = {}
        self._next_transforms_s = -math.inf
        self._feeds: dict[str, _Feed] = {}
        self._texts: OpenTopic | None = None
        self._serves_displays = False
        self._graph = Graph(network="")
        self._listed_s: float | None = None

    def list_topics(self) -> list[wire.ListedTopic]:
        """List what displays can show, with the displays that can.

        Raises: BridgeError: the network cannot be reached.
        """
        with self._lock:
            graph = self._look()
            self._hear_transforms()
        topics = [
            wire.ListedTopic(
                name=topic.name,
                type=topic.ros_type,
                displays=list(SHOWN_TYPES[topic.ros_type]),
                publishers=list(topic.publishers),
            )
            for topic in graph.topics
            if topic.ros_type in SHOWN_TYPES and topic.publishers
        ]
        self._take_transforms()
        frames = [
            wire.ListedTopic(name=f"{FRAME}{frame}", type="frame", displays=["tf_frame"])
            for frame in self._tree.frames
        ]
        return topics + frames

    def read_graph(self) -> Graph:
        """Read who publishes and who listens.

        Raises: BridgeError: the network cannot be reached.
        """
        with self._lock:
            return self._look()

    def read(self, name: str, after: int) -> wire.TopicNews:
        """Read the newest of a topic; the message is left out where it is the one of `after`."""
        with self._lock:
            self._hear_transforms()
            self._take_transforms()
            if name.startswith(FRAME):
                return self._read_frame(name)
            feed = self._find(name)
            if feed is None:
                return wire.TopicNews(note=f"{MOST_TOPICS} topics are shown already; remove one")
            self._open(name, feed)
            feed.shown.update()
            return self._report(name, feed, after)

    def take_texts(self, name: str, on_text: Callable[[str], None]) -> None:
        """Hear texts on a topic from now on; once more is no more than once.

        Raises: BridgeError: the network cannot be reached.
        """

        def on_bytes(ros_type: str, data: bytes) -> None:
            try:
                message: Any = self._decode(ros_type, data)
                on_text(str(message.data))
            except (BridgeError, AttributeError):
                return

        with self._lock:
            if self._texts is None:
                self._texts = self._network.take_texts(name, on_bytes)

    def serve_displays(self, take: TakeDisplay) -> None:
        """Serve the service for displays from now on; once more is no more than once.

        Raises: BridgeError: the network cannot be reached.
        """
        with self._lock:
            if not self._serves_displays:
                self._network.serve_displays(take)
                self._serves_displays = True

    def close_idle(self) -> None:
        """Leave the topics that no page shows; without any, leave the network."""
        with self._lock:
            now_s = self._now_s()
            for name, feed in list(self._feeds.items()):
                if now_s - feed.asked_s > IDLE_S:
                    del self._feeds[name]
                    feed.close()
            is_listed = self._listed_s is not None and now_s - self._listed_s < IDLE_S
            if not (self._feeds or is_listed or self._texts or self._serves_displays):
                self._leave()

    def close(self) -> None:
        with self._lock:
            self._leave()

    def _leave(self) -> None:
        for topic in self._transform_topics.values():
            topic.close()
        self._transform_topics.clear()
        self._next_transforms_s = -math.inf
        self._feeds.clear()
        self._network.close()

    def _look(self) -> Graph:
        now_s = self._now_s()
        if self._listed_s is None or now_s - self._listed_s >= LIST_S:
            self._graph = self._network.read_graph()
            self._listed_s = now_s
        return self._graph

    def _find(self, name: str) -> _Feed | None:
        if name not in self._feeds:
            if len(self._feeds) >= MOST_TOPICS:
                return None
            self._feeds[name] = _Feed(ShownTopic(self._decode, self._places, self._now_s))
        feed = self._feeds[name]
        feed.asked_s = self._now_s()
        return feed

    def _open(self, name: str, feed: _Feed) -> None:
        """Open a topic, and the one beside it; again and again until somebody is there."""
        now_s = self._now_s()
        if now_s < feed.next_try_s:
            return
        wanted = [] if feed.opened else [name]
        if len(feed.opened) == 1 and feed.shown.ros_type in BESIDE:
            wanted = [name + BESIDE[feed.shown.ros_type]]
        feed.next_try_s = now_s + LIST_S
        try:
            for one in wanted:
                opened = self._network.open_topic(one, feed.shown.put)
                if opened is not None:
                    feed.opened.append(opened)
            feed.problem = "" if feed.opened else f"no node publishes {name} now"
        except BridgeError as error:
            feed.problem = str(error)

    def _report(self, name: str, feed: _Feed, after: int) -> wire.TopicNews:
        shown = feed.shown
        note, is_stale = feed.problem or shown.note, False
        if shown.count and shown.is_silent and shown.age_s is not None:
            is_stale = True
            note = f"no message for {shown.age_s:.0f} s"
        elif not shown.count and not note:
            note = f"no message on {name} yet"
        return wire.TopicNews(
            seq=shown.seq,
            type=shown.ros_type,
            age_s=None if shown.age_s is None else round(shown.age_s, 1),
            rate_hz=None if shown.rate_hz is None else round(shown.rate_hz, 2),
            is_stale=is_stale,
            note=note,
            left_out=shown.left_out,
            message=None if shown.json is None or shown.seq == after else shown.json,
        )

    def _read_frame(self, name: str) -> wire.TopicNews:
        try:
            value = show_frame(self._places, name.removeprefix(FRAME))
        except UnknownFrame as error:
            return wire.TopicNews(note=str(error), is_stale=True)
        text = msgspec.json.encode(value)
        return wire.TopicNews(seq=hash(text), message=msgspec.Raw(text))

    def _hear_transforms(self) -> None:
        now_s = self._now_s()
        if now_s < self._next_transforms_s:
            return
        self._next_transforms_s = now_s + LIST_S
        for name in TRANSFORM_TOPICS:
            if name in self._transform_topics:
                continue
            try:
                opened = self._network.open_topic(name, self._keep_transforms)
            except BridgeError:
                return
            if opened is not None:
                self._transform_topics[name] = opened

    def _keep_transforms(self, ros_type: str, data: bytes) -> None:
        self._transforms.append((ros_type, data))

    def _take_transforms(self) -> None:
        while self._transforms:
            ros_type, data = self._transforms.popleft()
            try:
                message: Any = self._decode(ros_type, data)
            except BridgeError:
                continue
            self._tree.add(getattr(message, "transforms", ()))
