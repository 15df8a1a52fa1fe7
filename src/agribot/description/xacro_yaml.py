"""A bound for the YAML files that xacro loads, whose aliases may stand for any amount of text."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import yaml

MAX_NODES = 100_000  # nodes with every alias written out; files of robots have about 1000


class _BoundedLoader(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses a file before anything is made of it; units are those that xacro has added."""

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None and _count_nodes(node, {}) > MAX_NODES:
            raise ValueError(
                f"{self.name}: with its aliases written out it has more than {MAX_NODES} values; "
                "use fewer aliases"
            )
        return node


def _count_nodes(node: Any, counted: dict[int, int]) -> int:
    """Count a node and all below it, each as often as it is named; a node in itself is endless."""
    if id(node) in counted:
        return counted[id(node)]
    counted[id(node)] = MAX_NODES + 1  # until it is known: what it names below is itself
    children: list[Any] = []
    if isinstance(node, yaml.SequenceNode):
        children = node.value
    elif isinstance(node, yaml.MappingNode):
        children = [part for pair in node.value for part in pair]
    counted[id(node)] = 1 + sum(_count_nodes(child, counted) for child in children)
    return counted[id(node)]


@contextmanager
def bound_yaml() -> Iterator[None]:
    """Let what loads YAML safely refuse a file that expands beyond the limit, while open."""
    load = yaml.safe_load
    yaml.safe_load = lambda stream: yaml.load(stream, _BoundedLoader)
    try:
        yield
    finally:
        yaml.safe_load = load
