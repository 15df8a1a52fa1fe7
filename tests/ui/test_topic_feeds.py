"""Topics that displays look at: opened when asked for, thinned, stale when they stop, closed."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer

from agribot.core.errors import BridgeError
from agribot.core.geo import transform
from agribot.record.bag.definitions import deserialize, ros1_store
from agribot.ros.display_requests import TakeDisplay
from agribot.ros.graph import Graph, GraphTopic
from agribot.ros.topic_network import OnBytes
from agribot.ui import wire
from agribot.ui.server.recorded_topics import RecordedTopics
from agribot.ui.server.topic_feeds import IDLE_S, MOST_TOPICS, TopicFeeds
from tests.ros.messages import shown_samples as samples
from tests.ros.messages.shown_scene import LASER, make_scene, make_transforms, to_ros1
from tests.waiting import wait_for


class OpenTopic:
    def __init__(self, network: Network, name: str) -> None:
        self._network, self._name = network, name

    def close(self) -> None:
        del self._network.listeners[self._name]


class Network:
    """A network in which the test says what it likes."""

    is_ros2 = False

    def __init__(self) -> None:
        self.types: dict[str, str] = {}
        self.listeners: dict[str, OnBytes] = {}
        self.is_there = True

    def read_graph(self) -> Graph:
        if not self.is_there:
            raise BridgeError("no master answers")
        topics = tuple(
            GraphTopic(name=name, ros_type=kind, publishers=("/talker",))
            for name, kind in self.types.items()
        )
        return Graph(network="test", topics=topics)

    def open_topic(self, name: str, on_bytes: OnBytes) -> OpenTopic | None:
        if not self.is_there:
            raise BridgeError("no master answers")
        if name not in self.types:
            return None
        self.listeners[name] = on_bytes
        return OpenTopic(self, name)

    def take_texts(self, name: str, on_bytes: OnBytes) -> OpenTopic:
        self.listeners[name] = on_bytes
        return OpenTopic(self, name)

    def serve_displays(self, take: TakeDisplay) -> None:
        """No program asks here."""

    def close(self) -> None:
        self.listeners.clear()

    def say(self, name: str, message: Any) -> None:
        self.listeners[name](message.__msgtype__, to_ros1(message))


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def network() -> Network:
    found = Network()
    found.types = {
        "/scan": "sensor_msgs/msg/LaserScan",
        "/map": "nav_msgs/msg/OccupancyGrid",
        "/map_updates": "map_msgs/msg/OccupancyGridUpdate",
        "/tf_static": "tf2_msgs/msg/TFMessage",
        "/cmd_vel": "geometry_msgs/msg/Twist",
    }
    return found


@pytest.fixture
def feeds(network: Network, clock: Clock) -> TopicFeeds:
    body_frames = {"base_link": transform((0.0, 0.0, 0.3))}

    def decode(ros_type: str, data: bytes) -> Any:
        return deserialize(ros1_store(), ros_type, False, data)

    return TopicFeeds(network, decode, body_frames, clock)


def body(news: wire.TopicNews) -> Any:
    import msgspec

    assert news.message is not None
    return msgspec.json.decode(bytes(news.message))


def test_only_what_a_display_can_show_is_listed_with_those_that_can(feeds: TopicFeeds) -> None:
    listed = {topic.name: topic.displays for topic in feeds.list_topics()}
    assert listed == {"/scan": ["laserscan"], "/map": ["occupancy_grid"]}


def test_a_topic_comes_once_in_the_map_by_its_frame(feeds: TopicFeeds, network: Network) -> None:
    feeds.read("/scan", 0)
    network.say("/scan", samples.scan([1.0, 2.0], frame="laser"))
    assert feeds.read("/scan", 0).note.startswith("frame 'laser' is not known")
    network.say("/tf_static", make_transforms())
    network.say("/scan", samples.scan([1.0, 2.0], frame="laser"))
    clock_of(feeds).now_s += 1.0
    news = feeds.read("/scan", 0)
    assert news.note == ""
    shown = body(news)
    assert shown["ranges"] == [1.0, 2.0]
    assert np.reshape(shown["header"]["in_map"], (4, 4))[:2, 3].tolist() == list(LASER)
    assert feeds.read("/scan", news.seq).message is None, "the page has it already"
    listed = {topic.name for topic in feeds.list_topics()}
    assert "frame:laser" in listed
    frame = body(feeds.read("frame:laser", 0))
    assert frame["child_frame_id"] == "laser"


def clock_of(feeds: TopicFeeds) -> Clock:
    clock = feeds._now_s
    assert isinstance(clock, Clock)
    return clock


def test_a_topic_that_stops_is_stale_and_one_that_spoke_once_is_not(
    feeds: TopicFeeds, network: Network, clock: Clock
) -> None:
    feeds.read("/scan", 0)
    network.say("/scan", samples.scan([1.0]))
    clock.now_s += 50.0
    assert not feeds.read("/scan", 0).is_stale, "it may be latched"
    for _ in range(20):
        clock.now_s += 0.1
        network.say("/scan", samples.scan([1.0]))
    assert not feeds.read("/scan", 0).is_stale
    clock.now_s += 60.0
    news = feeds.read("/scan", 0)
    assert news.is_stale
    assert news.note == "no message for 60 s"


def test_a_fast_topic_is_shown_five_times_a_second_and_the_newest_counts(
    feeds: TopicFeeds, network: Network, clock: Clock
) -> None:
    feeds.read("/scan", 0)
    seen = set()
    for number in range(100):
        clock.now_s += 0.01
        network.say("/scan", samples.scan([1.0 + number / 100.0]))
        seen.add(feeds.read("/scan", 0).seq)
    assert 4 <= len(seen - {0}) <= 6


def test_a_grid_hears_of_its_updates(feeds: TopicFeeds, network: Network, clock: Clock) -> None:
    feeds.read("/map", 0)
    network.say("/map", samples.grid(np.zeros((2, 2), dtype=np.int8)))
    for _ in range(2):
        feeds.read("/map", 0)
        clock.now_s += 5.0
    network.say("/map_updates", samples.grid_update(0, 0, np.full((1, 2), 100, dtype=np.int8)))
    assert body(feeds.read("/map", 0))["data"] == "ZGQAAA=="


def test_nobody_to_publish_and_no_network_are_named_and_tried_again(
    feeds: TopicFeeds, network: Network, clock: Clock
) -> None:
    assert feeds.read("/later", 0).note == "no node publishes /later now"
    network.types["/later"] = "std_msgs/msg/String"
    clock.now_s += 5.0
    feeds.read("/later", 0)
    network.say("/later", samples.make("std_msgs/msg/String", "hello"))
    assert body(feeds.read("/later", 0)) == {"data": "hello"}
    network.is_there = False
    assert feeds.read("/other", 0).note == "no master answers"


def test_a_topic_that_nobody_looks_at_is_closed_and_the_network_left(
    feeds: TopicFeeds, network: Network, clock: Clock
) -> None:
    feeds.read("/scan", 0)
    clock.now_s += IDLE_S / 2.0
    feeds.close_idle()
    assert "/scan" in network.listeners
    clock.now_s += IDLE_S
    feeds.close_idle()
    assert network.listeners == {}


def test_a_topic_that_no_display_reads_is_named_and_spoils_no_other(
    feeds: TopicFeeds, network: Network
) -> None:
    feeds.read("/cmd_vel", 0)
    twist = samples.make(
        "geometry_msgs/msg/Twist", samples.vector(1.0, 0.0), samples.vector(0.0, 0.0)
    )
    network.say("/cmd_vel", twist)
    assert feeds.read("/cmd_vel", 0).note.startswith("no display reads geometry_msgs/msg/Twist;")
    feeds.read("/scan", 0)
    network.say("/scan", samples.scan([1.0]))
    assert body(feeds.read("/scan", 0))["ranges"] == [1.0]


def test_there_is_a_limit_of_topics(feeds: TopicFeeds) -> None:
    for number in range(MOST_TOPICS):
        feeds.read(f"/topic{number}", 0)
    assert "remove one" in feeds.read("/one_more", 0).note


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten seconds of a scan whose only beam grows by a metre a second, and all of the scene."""
    path = tmp_path_factory.mktemp("bags") / "farm.bag"
    store = ros1_store()
    with Writer(path) as writer:
        connections = {}
        for said in make_scene():
            ros_type = said.message.__msgtype__
            connections[said.topic] = writer.add_connection(said.topic, ros_type, typestore=store)
            if said.topic != "/scan":
                writer.write(connections[said.topic], 1_000_000_000, to_ros1(said.message))
        for second in range(1, 11):
            message = samples.scan([float(second)], frame="laser")
            writer.write(connections["/scan"], second * 1_000_000_000, to_ros1(message))
    return path


def read_when_loaded(topics: RecordedTopics, name: str, t_s: float) -> wire.TopicNews:
    def read() -> wire.TopicNews | None:
        news = topics.read(name, 0, t_s)
        return None if "being read" in news.note else news

    return wait_for(read, f"{name} of the recording")


def has_beam(topics: RecordedTopics, t_s: float, metres: float) -> bool:
    return bool(body(topics.read("/scan", 0, t_s))["ranges"] == [metres])


def test_a_recording_shows_what_was_said_last_forwards_and_backwards(recording: Path) -> None:
    topics = RecordedTopics(recording, {})
    assert {"/scan", "/cloud", "/map"} <= {topic.name for topic in topics.list_topics()}
    read_when_loaded(topics, "/scan", 3.5)
    for t_s, metres in ((3.5, 3.0), (7.2, 7.0), (2.0, 2.0)):
        wait_for(partial(has_beam, topics, t_s, metres), f"the beam of {metres} m at {t_s} s")
        shown = body(topics.read("/scan", 0, t_s))
        assert "in_map" in shown["header"], "by the transforms of the recording"
    assert "not come to its first message" in topics.read("/scan", 0, 0.5).note


def test_every_display_of_a_recording_has_its_message(recording: Path) -> None:
    topics = RecordedTopics(recording, {})
    for said in make_scene():
        if said.display:
            news = read_when_loaded(topics, said.topic, 9.0)
            assert news.message is not None, (said.topic, news.note)
