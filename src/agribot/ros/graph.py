"""Who publishes and who listens in a network: text, JSON, and DOT for Graphviz."""

from __future__ import annotations

import fnmatch

import msgspec

# Topics that every node has, which hide what a picture is to show.
QUIET = ("/rosout", "/rosout_agg", "/parameter_events")


class GraphTopic(msgspec.Struct, frozen=True, kw_only=True):
    """A topic; `rate_hz` is None where it was not measured."""

    name: str
    ros_type: str = ""
    publishers: tuple[str, ...] = ()
    subscribers: tuple[str, ...] = ()
    rate_hz: float | None = None


class Graph(msgspec.Struct, frozen=True, kw_only=True):
    """The nodes and topics of one network."""

    network: str
    nodes: tuple[str, ...] = ()
    topics: tuple[GraphTopic, ...] = ()


def make_graph(
    network: str,
    nodes: set[str],
    types: dict[str, str],
    publishers: dict[str, set[str]],
    subscribers: dict[str, set[str]],
) -> Graph:
    """Make a graph of what each topic's nodes are, sorted by name."""
    topics = tuple(
        GraphTopic(
            name=name,
            ros_type=types.get(name, ""),
            publishers=tuple(sorted(publishers.get(name, set()))),
            subscribers=tuple(sorted(subscribers.get(name, set()))),
        )
        for name in sorted({*publishers, *subscribers})
    )
    named = {node for topic in topics for node in (*topic.publishers, *topic.subscribers)}
    return Graph(network=network, nodes=tuple(sorted(nodes | named)), topics=topics)


def select_topics(graph: Graph, pattern: str = "*", *, all_topics: bool = False) -> Graph:
    """Keep the topics whose name fits a pattern like `/agribot/*`, and the nodes that have one.

    Without `all_topics` those that every node has are left out.
    """
    kept = tuple(
        topic
        for topic in graph.topics
        if fnmatch.fnmatchcase(topic.name, pattern) and (all_topics or topic.name not in QUIET)
    )
    busy = {node for topic in kept for node in (*topic.publishers, *topic.subscribers)}
    nodes = tuple(node for node in graph.nodes if node in busy) if pattern != "*" else graph.nodes
    return Graph(network=graph.network, nodes=nodes, topics=kept)


def format_graph(graph: Graph) -> str:
    """Format a graph as text: each node with what it publishes and hears."""
    lines = [f"{graph.network}: {len(graph.nodes)} nodes, {len(graph.topics)} topics"]
    for node in graph.nodes:
        lines.append(f"\n{node}")
        said = [topic for topic in graph.topics if node in topic.publishers]
        heard = [topic for topic in graph.topics if node in topic.subscribers]
        lines += [f"  -> {_describe(topic)}{_name_peers(topic.subscribers)}" for topic in said]
        lines += [f"  <- {_describe(topic)}{_name_peers(topic.publishers)}" for topic in heard]
        if not (said or heard):
            lines.append("  (no topics)")
    return "\n".join(lines) + "\n"


def _describe(topic: GraphTopic) -> str:
    rate = "" if topic.rate_hz is None else f" {topic.rate_hz:g} Hz"
    return f"{topic.name}{f' [{topic.ros_type}]' if topic.ros_type else ''}{rate}"


def _name_peers(nodes: tuple[str, ...]) -> str:
    return f"  ({', '.join(nodes)})" if nodes else "  (no node)"


def format_dot(graph: Graph) -> str:
    """Format a graph for Graphviz: nodes are ellipses, topics boxes."""
    lines = ["digraph ros {", "  rankdir=LR;", "  node [fontname=sans];"]
    lines += [f"  {_quote('n:' + node)} [label={_quote(node)}];" for node in graph.nodes]
    for topic in graph.topics:
        label = topic.name if topic.rate_hz is None else f"{topic.name}\n{topic.rate_hz:g} Hz"
        lines.append(f"  {_quote('t:' + topic.name)} [label={_quote(label)}, shape=box];")
        lines += [
            f"  {_quote('n:' + node)} -> {_quote('t:' + topic.name)};" for node in topic.publishers
        ]
        lines += [
            f"  {_quote('t:' + topic.name)} -> {_quote('n:' + node)};" for node in topic.subscribers
        ]
    return "\n".join([*lines, "}"]) + "\n"


def _quote(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
