"""Graphs of nodes and topics: their layout, their formats, and the robot's own."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core.topics import TOPICS, Qos
from agribot.ros.graph import Graph, format_dot, format_graph, make_graph, select_topics
from agribot.ros.graph_layout import find_columns, order_columns
from agribot.ros.graph_picture import draw_graph
from agribot.ros.robot_graph import make_robot_graph
from agribot.ros.ros2 import wire

CHAIN: Graph = make_graph(
    "test",
    {"/alone"},
    {"/scan": "sensor_msgs/msg/LaserScan"},
    {"/scan": {"/lidar"}, "/cmd": {"/driver"}, "/rosout": {"/lidar"}},
    {"/scan": {"/driver"}, "/cmd": {'/motor "<&>"'}, "/wanted": {"/driver"}},
)


def test_an_arrow_leads_to_a_later_column_and_a_circle_ends() -> None:
    edges = [("a", "b"), ("b", "c"), ("a", "c"), ("c", "a"), ("d", "d")]
    columns = find_columns(["a", "b", "c", "d"], edges)
    assert columns == {"a": 0, "b": 1, "c": 2, "d": 0}


def test_neighbours_lie_in_the_same_order_so_that_arrows_do_not_cross() -> None:
    edges = [("a", "z"), ("b", "y"), ("c", "x")]
    columns = dict.fromkeys("abc", 0) | dict.fromkeys("xyz", 1)
    left, right = order_columns(columns, edges)
    partners = dict(edges)
    assert [partners[each] for each in left] == right


def test_the_text_names_who_hears_what_and_what_nobody_says() -> None:
    text = format_graph(select_topics(CHAIN))
    assert "-> /scan [sensor_msgs/msg/LaserScan]  (/driver)" in text
    assert "<- /wanted  (no node)" in text
    assert "/rosout" not in text
    assert "/alone\n  (no topics)" in text
    assert "/rosout" in format_graph(select_topics(CHAIN, all_topics=True))


def test_a_pattern_keeps_its_topics_and_their_nodes_alone() -> None:
    kept = select_topics(CHAIN, "/sc*")
    assert [topic.name for topic in kept.topics] == ["/scan"]
    assert kept.nodes == ("/driver", "/lidar")


def test_strange_names_break_neither_the_picture_nor_the_dot_file() -> None:
    root = ET.fromstring(draw_graph(CHAIN))
    texts = {element.text for element in root.iter() if element.tag.endswith("text")}
    assert '/motor "<&>"' in texts
    assert '[label="/motor \\"<&>\\""]' in format_dot(CHAIN)
    assert "no nodes" in draw_graph(Graph(network="empty"))


def test_the_robots_own_graph_has_every_topic_of_the_table() -> None:
    graph = make_robot_graph()
    assert {topic.name for topic in graph.topics} == {topic.name for topic in TOPICS}
    blind = make_robot_graph({}, absent=["camera", "perceive"], bridges=["ROS 1"])
    assert "camera" not in blind.nodes
    assert "bridge ROS 1" in blind.nodes
    assert all(topic.rate_hz is None for topic in blind.topics), "nothing was measured"


def test_the_command_writes_what_the_ending_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["graph", "robot"]) == 0
    assert "supervisor" in capsys.readouterr().out
    for ending, start in ((".svg", "<svg"), (".dot", "digraph"), (".json", "{")):
        out = tmp_path / f"graph{ending}"
        assert main(["graph", "robot", "--out", str(out)]) == 0
        assert out.read_text().startswith(start)
    assert json.loads((tmp_path / "graph.json").read_text())["network"] == "robot"
    assert main(["graph", "robot", "--out", str(tmp_path / "graph.pdf")]) == 2


def test_a_master_that_is_not_there_is_named_with_the_remedy(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["graph", "ros1", "--ros-master", "http://127.0.0.1:9"]) == 2
    assert "no master answers at http://127.0.0.1:9" in capsys.readouterr().err


def test_a_token_tells_of_its_publisher_what_a_subscriber_has_to_know() -> None:
    name = wire.NodeName(domain=0, zid="ab12", name="lidar", namespace="/front")
    qos = Qos(reliable=False, latched=True, depth=1)
    token = name.make_endpoint_token(3, "MP", "/scan", "sensor_msgs/msg/LaserScan", "RIHS01_x", qos)
    assert wire.read_publisher(token) == wire.FoundPublisher(
        "/front/lidar", "/scan", "sensor_msgs/msg/LaserScan", "RIHS01_x", False, True
    )
    assert wire.read_publisher(name.make_token()) is None
    assert wire.read_node_name(name.make_token()) == "/front/lidar"
