"""Displays that programs of ROS add to the page's map by mapviz's service AddMapvizDisplay."""

from __future__ import annotations

import queue
from collections.abc import Callable
from typing import Any

import msgspec

ADD_DISPLAY_SERVICE = "/add_mapviz_display"
_TAKEN_S = 5.0  # time within which the page must have taken a display
_MOST_PROPERTIES = 200


class DisplayRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A display in mapviz's words.

    `draw_order` counts from the lowest, which is 1, or below zero from the topmost, -1; 0 keeps it.
    """

    name: str
    type: str
    draw_order: int = 0
    visible: bool = True
    properties: dict[str, str] = {}


OnOutcome = Callable[[bool, str], None]  # whether it is drawn now, and why not
TakeDisplay = Callable[[DisplayRequest, OnOutcome], None]  # may answer later, in any thread


def read_display(message: Any) -> DisplayRequest:
    """Read the request of either ROS."""
    return DisplayRequest(
        name=message.name,
        type=message.type,
        draw_order=int(message.draw_order),
        visible=bool(message.visible),
        properties={one.key: one.value for one in message.properties[:_MOST_PROPERTIES]},
    )


def wait_for_outcome(take: TakeDisplay, request: DisplayRequest) -> tuple[bool, str]:
    """Ask for a display and wait for what became of it."""
    outcomes: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()
    take(request, lambda is_drawn, text: outcomes.put((is_drawn, text)))
    try:
        return outcomes.get(timeout=_TAKEN_S)
    except queue.Empty:
        return False, f"the page has not answered within {_TAKEN_S:g} s"
