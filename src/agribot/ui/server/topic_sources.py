"""Everything whose topics displays can show: networks of ROS, the recording on show, and bags."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from agribot.core.errors import AgribotError, BridgeError
from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.ros.decoding import make_undecodable
from agribot.ros.display_requests import TakeDisplay
from agribot.ros.graph import Graph
from agribot.ui import wire
from agribot.ui.about import About, RosPlaces
from agribot.ui.server.outside_layers import TOPIC as LAYERS
from agribot.ui.server.recorded_topics import RecordedTopics
from agribot.ui.server.replay import Replay
from agribot.ui.server.topic_feeds import TopicFeeds

NODE = "agribot_page"
MOST_BYTES = 3_000_000  # size of one answer; the rest comes with the next
MOST_BAGS = 2
BAG = "bag:"
RECORDING = "recording"
TITLES = {"ros1": "ROS 1", "ros2": "ROS 2", "dds": "ROS 2 on DDS", RECORDING: "Recording"}
BAG_ENDINGS = (".bag", ".mcap", ".db3")
OPTICAL_FRAME, FOOTPRINT = "camera_optical_frame", "base_footprint"


class TopicSources:
    """Calls may block and belong into a thread; nothing is opened before somebody asks."""

    def __init__(self, about: About) -> None:
        self._body_frames = list_body_frames(about.robot_spec)
        self._bags_dir = Path(about.home_dir) / "bags"
        self.feeds = {
            name: TopicFeeds(make(about.ros), make_decoder(name), self._body_frames)
            for name, make in _NETWORKS.items()
        }
        self._lock = threading.Lock()
        self._replays: WeakKeyDictionary[Replay, RecordedTopics] = WeakKeyDictionary()
        self._bags: dict[str, tuple[RecordedTopics, float]] = {}

    def list_all(self, replay: Replay | None) -> list[wire.TopicNetworkInfo]:
        """List the topics of every source, or why it has none."""
        found = [
            _list_one(name, TITLES[name], feeds.list_topics) for name, feeds in self.feeds.items()
        ]
        if replay is not None:
            recorded = self._find_recorded(replay)
            found.append(_list_one(RECORDING, f"Recording {replay.name}", recorded.list_topics))
        for path in self._list_bags():
            source = BAG + path.name
            found.append(_list_one(source, path.name, partial(self._list_bag, path.name)))
        return found

    def read(self, wishes: list[wire.TopicWish], replay: Replay | None) -> list[wire.TopicNews]:
        """Read what is new of each; a message without room stays out until it is asked again."""
        news, size = list[wire.TopicNews](), 0
        for wish in wishes:
            one = self._read_one(wish, replay)
            length = 0 if one.message is None else len(bytes(one.message))
            if size and size + length > MOST_BYTES:
                one = wire.TopicNews(seq=wish.after, type=one.type, note=one.note)
            else:
                size += length
            news.append(one)
        return news

    def read_graph(self, name: str) -> Graph:
        """Read the graph of a network.

        Raises: BridgeError: it cannot be reached. KeyError: no such network.
        """
        return self.feeds[name].read_graph()

    def take_layers(self, network: str, take: Callable[[str], None]) -> None:
        """Give `take` what programs say on the topic for layers; a network may come later."""
        with contextlib.suppress(BridgeError):
            self.feeds[network].take_texts(LAYERS, take)

    def serve_displays(self, network: str, take: TakeDisplay) -> None:
        """Give `take` the displays that programs add by a service; a network may come later."""
        with contextlib.suppress(BridgeError):
            self.feeds[network].serve_displays(take)

    def close_idle(self) -> None:
        for feeds in self.feeds.values():
            feeds.close_idle()

    def _read_one(self, wish: wire.TopicWish, replay: Replay | None) -> wire.TopicNews:
        try:
            if wish.source in self.feeds:
                return self.feeds[wish.source].read(wish.name, wish.after)
            if wish.source == RECORDING:
                if replay is None:
                    return wire.TopicNews(note="no recording is shown", is_stale=True)
                return self._find_recorded(replay).read(wish.name, wish.after, replay.now_s)
            if wish.source.startswith(BAG):
                return self._read_bag(wish)
        except AgribotError as error:
            return wire.TopicNews(note=str(error), is_stale=True)
        return wire.TopicNews(note=f"no source '{wish.source[:40]}'", is_stale=True)

    def _find_recorded(self, replay: Replay) -> RecordedTopics:
        with self._lock:
            if replay not in self._replays:
                self._replays[replay] = RecordedTopics(replay.file, self._body_frames)
            return self._replays[replay]

    def _list_bags(self) -> list[Path]:
        if not self._bags_dir.is_dir():
            return []
        return sorted(
            path
            for path in self._bags_dir.iterdir()
            if path.name.endswith(BAG_ENDINGS) or (path / "metadata.yaml").is_file()
        )

    def _list_bag(self, name: str) -> list[wire.ListedTopic]:
        return self._open_bag(name).list_topics()

    def _open_bag(self, name: str) -> RecordedTopics:
        path = next((path for path in self._list_bags() if path.name == name), None)
        if path is None:
            raise BridgeError(f"no recording '{name[:80]}' in {self._bags_dir}; name another")
        with self._lock:
            if name not in self._bags:
                while len(self._bags) >= MOST_BAGS:
                    self._bags.pop(next(iter(self._bags)))
                self._bags[name] = (RecordedTopics(path, self._body_frames), time.monotonic())
            return self._bags[name][0]

    def _read_bag(self, wish: wire.TopicWish) -> wire.TopicNews:
        """Play a bag as fast as it was recorded, over and over."""
        name = wish.source.removeprefix(BAG)
        bag = self._open_bag(name)
        with self._lock:
            started_s = self._bags[name][1]
        length_s = max(bag.end_s - bag.start_s, 1.0)
        return bag.read(
            wish.name, wish.after, bag.start_s + (time.monotonic() - started_s) % length_s
        )


def list_body_frames(robot: RobotSpec) -> dict[str, FloatArray]:
    """List the robot's own frames, each with its pose in the body frame, (4, 4)."""
    frames = {link.name: robot.body_from_link(link.name) for link in robot.links}
    frames.setdefault(FOOTPRINT, np.eye(4))
    if robot.camera is not None:
        frames.setdefault(OPTICAL_FRAME, robot.body_from_camera())
    return frames


def _list_one(
    source: str, title: str, list_topics: Callable[[], list[wire.ListedTopic]]
) -> wire.TopicNetworkInfo:
    try:
        return wire.TopicNetworkInfo(source=source, title=title, topics=list_topics())
    except AgribotError as error:
        return wire.TopicNetworkInfo(source=source, title=title, problem=str(error))


def _make_ros1(places: RosPlaces) -> Any:
    from agribot.ros.ros1.open_topics import Ros1Topics

    return Ros1Topics(NODE, places.master)


def _make_ros2(places: RosPlaces) -> Any:
    from agribot.record.bag.definitions import ros2_store
    from agribot.ros.ros2.open_topics import Ros2Topics

    return Ros2Topics(NODE, places.domain, places.router, ros2_store)


def _make_dds(places: RosPlaces) -> Any:
    from agribot.record.bag.definitions import ros2_store
    from agribot.ros.dds.open_topics import DdsTopics

    return DdsTopics(NODE, places.domain, ros2_store)


_NETWORKS = {"ros1": _make_ros1, "ros2": _make_ros2, "dds": _make_dds}


def make_decoder(network: str) -> Callable[[str, bytes], Any]:
    """Make the function that decodes a message of a network.

    Raises: BridgeError: (the function) the bytes are no message of that type.
    """

    def decode(ros_type: str, data: bytes) -> Any:
        from agribot.record.bag.definitions import deserialize, ros1_store, ros2_store

        is_ros2 = network != "ros1"
        try:
            return deserialize(ros2_store() if is_ros2 else ros1_store(), ros_type, is_ros2, data)
        except Exception as error:  # the generated code of rosbags raises any error
            raise make_undecodable(data, ros_type) from error

    return decode
