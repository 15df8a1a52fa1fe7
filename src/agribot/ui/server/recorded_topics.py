"""The topics of a recording as displays look at them: what was said last at its time."""

from __future__ import annotations

import bisect
import math
import threading
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec

from agribot.core.errors import AgribotError, BridgeError
from agribot.core.messages import FloatArray
from agribot.record.bag.opening import open_bag
from agribot.record.bag.source import Bag, BagMessage, UndecodableMessage
from agribot.ros.messages.frame_tree import FrameTree
from agribot.ros.messages.shown_messages import FramePlaces
from agribot.ros.messages.shown_sets import adds_up
from agribot.ros.messages.shown_types import BESIDE, SHOWN_TYPES
from agribot.ui import wire
from agribot.ui.server.shown_topic import MOST_WAITING, Decode, ShownTopic

MOST_BYTES = 200_000_000  # size of one topic in memory
LEAST_STEP_S = 0.1  # least time between two kept messages of a topic whose newest counts
TRANSFORM_TOPICS = frozenset({"/tf", "/tf_static"})
STALE_S = 3.0
_S = 1e-9


def _refuse(ros_type: str, _data: bytes) -> Any:
    raise BridgeError(f"{ros_type} is not read yet; wait")


class _Kept:
    """The messages of one topic, in the order of their times."""

    def __init__(self) -> None:
        self.times_s: list[float] = []
        self.values: list[tuple[str, bytes]] = []
        self.decode: Decode = _refuse
        self.is_read = False
        self.note = ""


class RecordedTopics:
    """Read in threads of its own; meanwhile a display says so.

    Raises: RecordingError: no recording.
    """

    def __init__(self, path: Path, body_frames: dict[str, FloatArray]) -> None:
        self._path = path
        with warnings.catch_warnings(action="ignore"), open_bag(path) as bag:
            self.topics = bag.topics
            first_ns, last_ns = bag.times_ns or (0, 0)
        self.start_s, self.end_s = first_ns * _S, last_ns * _S
        self._lock = threading.Lock()
        self._tree = FrameTree()
        self._places = FramePlaces(self._tree.find, body_frames)
        self._kept: dict[str, _Kept] = {}
        self._players: dict[str, _Player] = {}
        self._transforms_to_s = self.start_s

    def list_topics(self) -> list[wire.ListedTopic]:
        return [
            wire.ListedTopic(
                name=topic.name,
                type=topic.ros_type,
                displays=list(SHOWN_TYPES[topic.ros_type]),
            )
            for topic in self.topics
            if topic.ros_type in SHOWN_TYPES and topic.count
        ]

    def read(self, name: str, after: int, t_s: float) -> wire.TopicNews:
        """Read what a topic had said by `t_s`, on the recording's clock."""
        with self._lock:
            kept, transforms = self._find(name), self._find("/tf")
        if not (kept.is_read and transforms.is_read):
            return wire.TopicNews(note="the recording is being read")
        if not kept.times_s:
            return wire.TopicNews(note=kept.note or f"the recording has no {name}")
        with self._lock:
            self._take_transforms(t_s)
            player = self._players.get(name)
            if player is None:
                player = self._players[name] = _Player(kept, self._places)
            return player.read(after, t_s)

    def _find(self, name: str) -> _Kept:
        if name not in self._kept:
            self._kept[name] = _Kept()
            threading.Thread(
                target=self._load, args=(name, self._kept[name]), name="topic", daemon=True
            ).start()
        return self._kept[name]

    def _load(self, name: str, kept: _Kept) -> None:
        beside = {name + ending for ending in BESIDE.values()}
        names = TRANSFORM_TOPICS if name == "/tf" else {name, *beside}
        try:
            with warnings.catch_warnings(action="ignore"), open_bag(self._path) as bag:
                kept.decode = _make_decoder(bag)
                _keep_messages(kept, bag.messages(frozenset(names)), is_tree=name == "/tf")
        except AgribotError as error:
            kept.note = str(error)
        kept.is_read = True

    def _take_transforms(self, t_s: float) -> None:
        """Bring the tree to `t_s`; going back in time begins anew."""
        kept = self._kept["/tf"]
        if not kept.is_read:
            return
        first = bisect.bisect_right(kept.times_s, self._transforms_to_s)
        if t_s < self._transforms_to_s or self._transforms_to_s == self.start_s:
            first = 0
        for ros_type, data in kept.values[first : bisect.bisect_right(kept.times_s, t_s)]:
            self._tree.add(kept.decode(ros_type, data).transforms)
        self._transforms_to_s = t_s


def _make_decoder(bag: Bag) -> Decode:
    topics = {topic.ros_type: topic for topic in bag.topics}

    def decode(ros_type: str, data: bytes) -> Any:
        try:
            return bag.value(BagMessage(topics[ros_type], 0, 0, data))
        except UndecodableMessage as error:
            raise BridgeError(str(error)) from error

    return decode


def _keep_messages(kept: _Kept, messages: Iterable[BagMessage], *, is_tree: bool) -> None:
    """Keep what may be shown; of transforms and of what stands for itself not every one."""
    size, last_s = 0, dict[str, float]()
    for message in messages:
        t_s, ros_type = message.log_ns * _S, message.topic.ros_type
        key = message.topic.name
        if is_tree:
            try:
                key += _name_frames(kept.decode(ros_type, message.data))
            except BridgeError:
                continue
        is_thinned = is_tree or not adds_up(ros_type)
        if is_thinned and t_s - last_s.get(key, -math.inf) < LEAST_STEP_S:
            continue
        last_s[key] = t_s
        size += len(message.data)
        if size > MOST_BYTES:
            kept.note = f"only its first {t_s - kept.times_s[0]:.0f} s, {MOST_BYTES:,} bytes"
            return
        kept.times_s.append(t_s)
        kept.values.append((ros_type, message.data))


def _name_frames(message: Any) -> str:
    return " ".join(each.child_frame_id for each in message.transforms)


class _Player:
    """How far a topic has been shown."""

    def __init__(self, kept: _Kept, places: FramePlaces) -> None:
        self._kept, self._places = kept, places
        self._seq = 0
        self._begin()

    def _begin(self) -> None:
        self._next = 0
        self._shown = ShownTopic(self._kept.decode, self._places)
        self._sent: msgspec.Raw | None = None

    def read(self, after: int, t_s: float) -> wire.TopicNews:
        end = bisect.bisect_right(self._kept.times_s, t_s)
        if end < self._next:
            self._begin()
        if end == 0:
            return wire.TopicNews(note="the recording has not come to its first message")
        self._put_until(end)
        self._shown.update()
        if self._shown.json is not self._sent:
            self._sent, self._seq = self._shown.json, self._seq + 1
        age_s = t_s - self._kept.times_s[end - 1]
        is_stale = age_s > STALE_S and end > 1
        note = f"no message for {age_s:.0f} s" if is_stale else self._shown.note
        return wire.TopicNews(
            seq=self._seq,
            type=self._shown.ros_type,
            age_s=round(age_s, 1),
            is_stale=is_stale,
            note=note or self._kept.note,
            left_out=self._shown.left_out,
            message=None if self._seq == after else self._sent,
        )

    def _put_until(self, end: int) -> None:
        """Take what is new; of what stands for itself the newest alone."""
        values = self._kept.values
        first = self._next if adds_up(values[end - 1][0]) else max(self._next, end - 1)
        for number, (ros_type, data) in enumerate(values[first:end]):
            self._shown.put(ros_type, data)
            if number % (MOST_WAITING - 1) == 0:
                self._shown.take_waiting()
        self._next = end
