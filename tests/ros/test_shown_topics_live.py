"""Topics of real networks as displays of the page get them: rospy at a roscore, zenoh, DDS."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import pytest

from agribot.core.errors import BridgeError
from agribot.core.topics import LATCHED, STREAM, Topic
from agribot.record.bag.definitions import ros2_store, serialize
from agribot.ros.dds.discovery import Discovery
from agribot.ros.dds.node import DdsNode
from agribot.ros.dds.open_topics import DdsTopics
from agribot.ros.ros1.open_topics import Ros1Topics
from agribot.ros.ros1.system_state import read_graph
from agribot.ros.ros2.node import Ros2Node
from agribot.ros.ros2.open_topics import Ros2Topics
from agribot.ros.topic_network import check_definition
from agribot.ui import wire
from agribot.ui.server.topic_feeds import TopicFeeds
from agribot.ui.server.topic_sources import make_decoder
from tests import machine, nightly
from tests.ros.live import free_port, program
from tests.ros.messages.shown_scene import LASER, make_scene
from tests.ros.publications import list_scene, write_for_ros2
from tests.ros.ros1_system import Ros1
from tests.ros.scene_talker import start_talker
from tests.waiting import wait_for

SCAN = "sensor_msgs/msg/LaserScan"


@contextmanager
def saying(messages: Sequence[tuple[Callable[[bytes], None], bytes]]) -> Iterator[None]:
    """Publish all of them again and again."""
    is_over = threading.Event()

    def run() -> None:
        while not is_over.wait(1.0):
            for publish, data in messages:
                publish(data)

    talker = threading.Thread(target=run)
    talker.start()
    try:
        yield
    finally:
        is_over.set()
        talker.join()


def read_all(feeds: TopicFeeds) -> dict[str, wire.TopicNews]:
    """The first message of every display, each waited for."""
    wanted = [said.topic for said in make_scene() if said.display]
    for topic in wanted:  # all are opened before one is waited for
        feeds.read(topic, 0)
    return {topic: wait_for(partial(read_shown, feeds, topic), topic) for topic in wanted}


def check_scene(feeds: TopicFeeds) -> None:
    news = read_all(feeds)
    assert news["/cloud"].left_out == "1,000,000 points thinned to 20,000"
    assert "frame 'moon' is not known" in news["/markers"].note
    scan = json.loads(bytes(news["/scan"].message))
    assert scan["header"]["in_map"][3] == 2.0
    listed = {topic.name: topic.displays for topic in feeds.list_topics()}
    for said in make_scene():
        if said.display:
            assert said.display in listed[said.topic]


@nightly.by_day("test_each_display_gets_its_message_over_zenoh_and_latched_ones_afterwards")
def test_each_display_gets_its_message_from_a_node_of_rospy(tmp_path: Path) -> None:
    machine.require("roscore")
    ros = Ros1(tmp_path)
    try:
        talker = start_talker(ros)
        network = Ros1Topics("page", ros.uri)
        with closing(TopicFeeds(network, make_decoder("ros1"), {})) as feeds:
            check_scene(feeds)
            [scan] = [topic for topic in read_graph(ros.uri).topics if topic.name == "/scan"]
            assert scan.publishers[0].startswith("/talker")
            assert scan.subscribers[0].startswith("/page")
            ros.stop(talker)
            stale = wait_for(lambda: feeds.read("/scan", 0).is_stale, "the scan to be stale")
            assert stale
        assert "/scan" not in ros.subscribers()
    finally:
        ros.close()


def test_each_display_gets_its_message_over_zenoh_and_latched_ones_afterwards() -> None:
    pytest.importorskip("zenoh")
    router = f"tcp/127.0.0.1:{free_port()}"
    with closing(Ros2Node("talker", 0, router, listen=True)) as node:
        said_again, kept = [], []
        for said in make_scene():
            ros_type = said.message.__msgtype__
            qos = STREAM if said.rate_hz else LATCHED
            topic = Topic(name=said.topic, ros_type=ros_type, qos=qos)
            publish = node.create_publisher(topic, ros2_store())
            data = serialize(ros2_store(), ros_type, True, said.message)
            publish(data)
            said_again.append((publish, data)) if said.rate_hz else kept.append(publish)
        network = Ros2Topics("page", 0, router, ros2_store)
        with closing(TopicFeeds(network, make_decoder("ros2"), {})) as feeds:
            wait_for(lambda: len(feeds.list_topics()) >= 6, "the topics to be announced")
            with saying(said_again):
                check_scene(feeds)
            graph = feeds.read_graph()
            assert graph.nodes == ("/talker",)


def test_topics_of_dds_are_listed_by_type_shown_and_left_again(tmp_path: Path) -> None:
    pytest.importorskip("cyclonedds")
    domain = 120 + os.getpid() % 20
    scene = tmp_path / "scene.jsonl"
    write_for_ros2(scene, list_scene("/tf_static", "/scan", "/map"))
    command = ("-m", "tests.ros.ros2_talker", str(scene), str(domain))
    network = DdsTopics("page", domain, ros2_store)
    with program(sys.executable, *command), closing(DdsNode("watcher", domain)) as node:
        watcher = Discovery(node)
        with closing(TopicFeeds(network, make_decoder("dds"), {})) as feeds:
            expected = [
                ("/map", ["occupancy_grid"], ["/talker"]),
                ("/scan", ["laserscan"], ["/talker"]),
                ("frame:laser", ["tf_frame"], []),
                ("frame:map", ["tf_frame"], []),
            ]

            def are_listed() -> bool:
                found = feeds.list_topics()
                return [(one.name, one.displays, one.publishers) for one in found] == expected

            wait_for(are_listed, "a scan, a map and two frames, and the name of their node")
            for name in ("/map", "/scan"):  # the map was published before the page was there
                news = wait_for(partial(read_shown, feeds, name), name)
                assert news.note == ""
            in_map = json.loads(bytes(news.message))["header"]["in_map"]
            assert (in_map[3], in_map[7]) == LASER
            wait_for(lambda: hears(watcher, "/scan"), "the page to be known")
        wait_for(lambda: not hears(watcher, "/scan"), "the page to have left")


def hears(watcher: Discovery, name: str) -> bool:
    """Whether the page hears a topic."""
    topics = {topic.name: topic for topic in watcher.read_graph().topics}
    return name in topics and bool(topics[name].subscribers)


def read_shown(feeds: TopicFeeds, name: str) -> wire.TopicNews | None:
    news = feeds.read(name, 0)
    return news if news.message is not None else None


def test_a_type_of_another_definition_is_refused() -> None:
    check_definition(ros2_store(), "/scan", SCAN, "", "/old")
    check_definition(ros2_store(), "/scan", SCAN, ros2_store().hash_rihs01(SCAN), "/new")
    with pytest.raises(BridgeError, match=f"/scan: {SCAN} of /other has another definition"):
        check_definition(ros2_store(), "/scan", SCAN, "RIHS01_00", "/other")
    with pytest.raises(BridgeError, match="/own: the type own_msgs/msg/Own is unknown"):
        check_definition(ros2_store(), "/own", "own_msgs/msg/Own", "", "/other")


def test_a_router_that_is_not_there_is_named() -> None:
    pytest.importorskip("zenoh")
    network = Ros2Topics("page", 0, f"tcp/127.0.0.1:{free_port()}", ros2_store)
    with closing(network), pytest.raises(Exception, match="no zenoh router answers"):
        network.read_graph()
