"""Displays in mapviz's words as layers of the page's map."""

from __future__ import annotations

from agribot.ros.display_requests import DisplayRequest
from agribot.ui import wire
from agribot.ui.server.mapviz_table import PREFIX, TABLE, TOOLS, read_display
from agribot.ui.server.outside_layers import BadLayer
from agribot.ui.server.topic_feeds import FRAME

_WORDS = {"true": True, "false": False}
_MOST_VALUE = 200  # characters of a property that are read


def make_layer(
    network: str, request: DisplayRequest, order: int | None
) -> tuple[wire.OutsideLayer, str]:
    """Make the layer of a display on a topic of `network`, and what of it does not fit, as text.

    `order` is the draw order that it has, if it is there already.
    Raises: BadLayer: there is no such display, or it has no topic.
    """
    type_ = request.type.removeprefix(PREFIX)
    if type_ in TOOLS:
        raise BadLayer(f"'{type_}' is a tool; it is always there, at the left of the map")
    if type_ not in TABLE:
        raise BadLayer(f"type '{request.type[:60]}' is not a display of the map; name another")
    values = {key: _read_value(text[:_MOST_VALUE]) for key, text in request.properties.items()}
    display, odd = read_display(type_, request.name, values)
    if not display["source"]:
        raise BadLayer(f"a display of type '{type_}' has no topic; add the property topic")
    frame = FRAME if type_ == "tf_frame" else ""
    layer = wire.OutsideLayer(
        name=request.name,
        type=type_,
        topic=f"{network}:{frame}{display['source']}",
        style=display["options"],
        draw_order=_convert_order(request.draw_order) if request.draw_order else order,
        visible=request.visible,
    )
    return layer, f", without {', '.join(odd)}, which do not fit here" if odd else ""


def _convert_order(order: int) -> int:
    """Convert an order in which 1 is the lowest and -1 the topmost: here -1 and 0 are."""
    return -order - 1 if order < 0 else -order


def _read_value(text: str) -> str | bool | float:
    """Read a property as YAML does; colours and names stay texts."""
    word = text.strip().lower()
    if word in _WORDS:
        return _WORDS[word]
    try:
        return float(word)
    except ValueError:
        return text
