"""`agribot graph`: who publishes and who listens, over ROS 1, ROS 2 or DDS, or inside the robot."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec

from agribot.cli.run.bridging import (
    add_ros1_arguments,
    add_ros2_arguments,
    read_domain,
    read_master,
    read_router,
)
from agribot.core import extras
from agribot.core.errors import ConfigError, explain_os_error
from agribot.ros.graph import Graph, format_dot, format_graph, select_topics

NODE = "agribot_graph"
ENDINGS = (".svg", ".dot", ".json", ".txt")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "what",
        choices=("ros1", "ros2", "dds", "robot"),
        help="a ROS 1 master, a ROS 2 domain (zenoh, DDS), or the parts of the robot's own program",
    )
    parser.add_argument(
        "--topics", default="*", metavar="PATTERN", help="those alone: '/agribot/*'"
    )
    parser.add_argument(
        "--all", action="store_true", help="also /rosout and such, which every node has"
    )
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--json", action="store_true", help="JSON instead of text")
    kind.add_argument("--dot", action="store_true", help="the language of Graphviz")
    kind.add_argument("--svg", action="store_true", help="a picture")
    parser.add_argument(
        "--out",
        metavar="FILE",
        help=f"a file, of the kind of its ending ({', '.join(ENDINGS)})",
    )
    group = parser.add_argument_group("networks")
    add_ros1_arguments(group)
    add_ros2_arguments(group)


def run(options: argparse.Namespace) -> int:
    kind = _find_kind(options)
    found = select_topics(_read(options), options.topics, all_topics=options.all)
    text = _format(found, kind)
    if options.out is None:
        sys.stdout.write(text)
        return 0
    with explain_os_error(f"--out {options.out}", "name another file", ConfigError):
        Path(options.out).write_text(text, encoding="utf-8")
    sys.stderr.write(f"{options.out}: {len(found.nodes)} nodes, {len(found.topics)} topics\n")
    return 0


def _find_kind(options: argparse.Namespace) -> str:
    """Find the kind of output, from the options or the ending of the file.

    Raises: ConfigError: an ending of another kind.
    """
    asked = next((name for name in ("json", "dot", "svg") if getattr(options, name)), "")
    if options.out is None or asked:
        return asked or "txt"
    ending = Path(options.out).suffix
    if ending not in ENDINGS:
        raise ConfigError(
            f"--out {options.out}: unknown format; end it with one of {', '.join(ENDINGS)}"
        )
    return ending.removeprefix(".")


def _read(options: argparse.Namespace) -> Graph:
    if options.what == "robot":
        from agribot.ros.robot_graph import make_robot_graph

        return make_robot_graph()
    if options.what == "ros1":
        from agribot.ros.ros1.system_state import read_graph

        return read_graph(read_master(options))
    if options.what == "dds":
        return _read_dds(options)
    extras.require("ros", "agribot graph ros2")
    from contextlib import closing

    from agribot.ros.ros2.node import Ros2Node
    from agribot.ros.ros2.system_state import read_graph as read_ros2_graph

    with closing(Ros2Node(NODE, read_domain(options), read_router(options), listen=False)) as node:
        return read_ros2_graph(node)


def _read_dds(options: argparse.Namespace) -> Graph:
    extras.require("dds", "agribot graph dds")
    from contextlib import closing

    from agribot.ros.dds.open_topics import DdsTopics
    from agribot.ros.dds.types import load_dds_types

    with closing(DdsTopics(NODE, read_domain(options), load_dds_types)) as topics:
        return topics.read_graph()


def _format(graph: Graph, kind: str) -> str:
    if kind == "json":
        return msgspec.json.format(msgspec.json.encode(graph), indent=2).decode() + "\n"
    if kind == "dot":
        return format_dot(graph)
    if kind == "svg":
        from agribot.ros.graph_picture import draw_graph

        return draw_graph(graph)
    return format_graph(graph)
