"""A graph of nodes and topics as an SVG that needs nothing else.

Colours are those of the page around it, where it is part of one.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from html import escape
from typing import NamedTuple

from agribot.ros.graph import Graph, GraphTopic
from agribot.ros.graph_layout import find_columns, order_columns

_CHAR_PX, _BOLD_PX, _LINE_PX, _PAD_PX = 7.3, 8.3, 18.0, 12.0
_ROW_GAP_PX, _COLUMN_GAP_PX, _MARGIN_PX = 14.0, 56.0, 16.0
_GAP_PER_HEIGHT, _MOST_GAP_PX = 0.08, 150.0  # room for the arrows of high columns
_MOST_LINES = 12  # lines of topics in one box
_STYLE = """
.graph text { font: 13px system-ui, sans-serif; fill: var(--ink, #16201b); }
.graph .type, .graph .rate { font-size: 11.5px; fill: var(--muted, #55625b); }
.graph .node rect { fill: var(--accent-soft, #dcefe2); stroke: var(--accent, #17653a); }
.graph .node text { font-weight: 600; }
.graph .topic rect { fill: var(--surface, #ffffff); stroke: var(--strong-edge, #8a968f); }
.graph path { fill: none; stroke: var(--muted, #55625b); stroke-width: 1.3; opacity: 0.75; }
.graph .end { fill: var(--muted, #55625b); stroke: none; opacity: 1; }
"""


class _Box(NamedTuple):
    """A node, the topics that the same nodes publish and hear, or a gap for an edge."""

    key: str
    kind: str
    lines: tuple[tuple[str, str], ...]  # a name, and what stands behind it
    span_px: float = 0.0  # width of a gap for an edge: that of its column

    @property
    def width_px(self) -> float:
        if self.kind == "bend":
            return self.span_px
        longest = max(len(name) + (len(rest) + 2 if rest else 0) for name, rest in self.lines)
        letter_px = _BOLD_PX if self.kind == "node" else _CHAR_PX
        return longest * letter_px + 2 * _PAD_PX

    @property
    def height_px(self) -> float:
        if self.kind == "bend":
            return 0.0
        return len(self.lines) * _LINE_PX + _PAD_PX


class _Placed(NamedTuple):
    box: _Box
    x: float
    y: float


def draw_graph(graph: Graph) -> str:
    """Draw a graph; topics with the same publishers and listeners share a box."""
    boxes, edges = _collect(graph)
    if not boxes:
        return _frame(260.0, 60.0, '<text x="16" y="34">no nodes and no topics</text>')
    columns = find_columns(list(boxes), edges)
    ways = _bend(edges, boxes, columns)
    steps = [step for way in ways for step in itertools.pairwise(way)]
    placed = _place(boxes, order_columns(columns, steps))
    width = max(each.x + each.box.width_px for each in placed.values()) + _MARGIN_PX
    height = max(each.y + each.box.height_px for each in placed.values()) + _MARGIN_PX
    lines = [_draw_way([placed[key] for key in way]) for way in ways]
    shown = [_draw_box(each) for each in placed.values() if each.box.kind != "bend"]
    return _frame(width, height, "\n".join([*lines, *shown]))


def _bend(
    edges: list[tuple[str, str]], boxes: dict[str, _Box], columns: dict[str, int]
) -> list[list[str]]:
    """Lead long edges through a gap of each column between; adds the gaps to boxes and columns."""
    ways = []
    for source, target in edges:
        way = [source]
        for column in range(columns[source] + 1, columns[target]):
            key = f"bend {len(boxes)}"
            boxes[key] = _Box(key, "bend", ())
            columns[key] = column
            way.append(key)
        ways.append([*way, target])
    return ways


def _collect(graph: Graph) -> tuple[dict[str, _Box], list[tuple[str, str]]]:
    groups: defaultdict[tuple[tuple[str, ...], tuple[str, ...]], list[GraphTopic]]
    groups = defaultdict(list)
    for topic in graph.topics:
        groups[topic.publishers, topic.subscribers].append(topic)
    boxes = {f"n:{node}": _Box(f"n:{node}", "node", ((node, ""),)) for node in graph.nodes}
    edges = []
    for (publishers, subscribers), topics in groups.items():
        for first in range(0, len(topics), _MOST_LINES):
            some = topics[first : first + _MOST_LINES]
            key = f"t:{some[0].name}"
            boxes[key] = _Box(key, "topic", tuple((each.name, _describe(each)) for each in some))
            edges += [(f"n:{node}", key) for node in publishers]
            edges += [(key, f"n:{node}") for node in subscribers]
    return boxes, edges


def _describe(topic: GraphTopic) -> str:
    return "" if topic.rate_hz is None else f"{topic.rate_hz:g} Hz"


def _place(boxes: dict[str, _Box], columns: list[list[str]]) -> dict[str, _Placed]:
    heights = [
        sum(boxes[key].height_px + _ROW_GAP_PX for key in column) - _ROW_GAP_PX
        for column in columns
    ]
    placed: dict[str, _Placed] = {}
    x = _MARGIN_PX
    for column, height in zip(columns, heights, strict=True):
        y = _MARGIN_PX + (max(heights) - height) / 2.0
        width = max(boxes[key].width_px for key in column)
        for key in column:
            box = boxes[key]
            shift = 0.0 if box.kind == "bend" else (width - box.width_px) / 2.0
            placed[key] = _Placed(box, x + shift, y)
            y += box.height_px + _ROW_GAP_PX
        for key in (key for key in column if boxes[key].kind == "bend"):
            placed[key] = placed[key]._replace(box=placed[key].box._replace(span_px=width))
        x += width + min(_COLUMN_GAP_PX + _GAP_PER_HEIGHT * max(heights), _MOST_GAP_PX)
    return placed


def _draw_box(placed: _Placed) -> str:
    box, x, y = placed
    radius = box.height_px / 2.0 if box.kind == "node" else 4.0
    shape = (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{box.width_px:.1f}" height="{box.height_px:.1f}" '
        f'rx="{radius:.1f}"/>'
    )
    texts = []
    for i, (name, rest) in enumerate(box.lines):
        at_y = y + _PAD_PX / 2.0 + (i + 0.72) * _LINE_PX
        if box.kind == "node":
            middle = x + box.width_px / 2.0
            texts.append(
                f'<text x="{middle:.1f}" y="{at_y:.1f}" text-anchor="middle">{escape(name)}</text>'
            )
            continue
        texts.append(f'<text x="{x + _PAD_PX:.1f}" y="{at_y:.1f}">{escape(name)}</text>')
        if rest:
            end = x + box.width_px - _PAD_PX
            texts.append(
                f'<text class="rate" x="{end:.1f}" y="{at_y:.1f}" text-anchor="end">{rest}</text>'
            )
    return f'<g class="{box.kind}">{shape}{"".join(texts)}</g>'


def _draw_way(way: list[_Placed]) -> str:
    """Draw an edge: curves from column to column, straight through the gaps of those between."""
    parts: list[str] = []
    for before, after in itertools.pairwise(way):
        x0, y0 = before.x + before.box.width_px, before.y + before.box.height_px / 2.0
        x1, y1 = after.x, after.y + after.box.height_px / 2.0
        reach = max(_COLUMN_GAP_PX / 2.0, abs(x1 - x0) / 2.0 if x1 > x0 else _COLUMN_GAP_PX)
        start = f"L{x0:.1f} {y0:.1f}" if parts else f"M{x0:.1f} {y0:.1f}"
        parts.append(
            f"{start}C{x0 + reach:.1f} {y0:.1f} {x1 - reach:.1f} {y1:.1f} {x1:.1f} {y1:.1f}"
        )
    tip = f"M{x1:.1f} {y1:.1f}l-8 -4v8z"
    return f'<path d="{"".join(parts)}"/><path class="end" d="{tip}"/>'


def _frame(width: float, height: float, inside: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="graph" viewBox="0 0 {width:.0f} '
        f'{height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img" '
        f'aria-label="Nodes and topics"><style>{_STYLE}</style>\n{inside}\n</svg>\n'
    )
