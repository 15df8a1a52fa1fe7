"""The properties of mapviz's plugins that are options of our displays.

Both know the same plugins. What has no counterpart is named and left out, never guessed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

PREFIX = "mapviz_plugins/"
UNLIMITED = 20_000  # places kept where mapviz keeps all of them

Convert = Callable[[Any], Any]


class Property(NamedTuple):
    """A property of a plugin, our option, and how its value is written here and there."""

    theirs: str
    ours: str
    here: Convert
    there: Convert


def _words(value: Any) -> str:
    return str(value).strip().lower()


def _same(name: str, ours: str, convert: Convert) -> Property:
    return Property(name, ours, convert, convert)


def _choice(theirs: str, ours: str, known: dict[str, str]) -> Property:
    back = {mine: yours for yours, mine in known.items()}
    return Property(theirs, ours, lambda value: known[_words(value)], lambda value: back[value])


_COLOUR = _same("color", "color", str)
_STYLE = _same("draw_style", "style", _words)
_BUFFER = Property("buffer_size", "buffer", lambda value: int(value) or UNLIMITED, int)
_TRACK = (_COLOUR, _STYLE, _BUFFER, _same("position_tolerance", "tolerance_m", float))
_ANCHORS = {
    f"{row} {column}".replace("center center", "center"):
        f"{row} {column}".replace("center", "centre").replace("centre centre", "centre")
    for row in ("top", "center", "bottom") for column in ("left", "center", "right")
}  # fmt: skip
_PLACED = (
    _choice("anchor", "anchor", _ANCHORS),
    _same("offset_x", "offset_x", float),
    _same("offset_y", "offset_y", float),
)
_SIZED = (_same("width", "w", float), _same("height", "h", float))
_PICTURE = (
    *_PLACED, *_SIZED, _choice("units", "units", {"pixels": "px", "percent": "%"}),
    _same("keep_ratio", "keep_ratio", bool),
)  # fmt: skip
_SPOTS = (
    _same("size", "size", float), _BUFFER, _same("use_rainbow", "rainbow", bool),
    _same("min_value", "low", float), _same("max_value", "high", float),
    _same("max_color", "color", str),
)  # fmt: skip
_SCAN_BY = {
    "range": "range", "x axis": "x", "y axis": "y", "intensity": "intensity",
    "flat color": "one colour",
}  # fmt: skip
TABLE: dict[str, tuple[Property, ...]] = {
    "attitude_indicator": (_same("width", "w", float), _same("height", "h", float)),
    "disparity": _PICTURE,
    "float": (*_PLACED, _COLOUR, _same("postfix_text", "postfix", str)),
    "gps": _TRACK,
    "grid": (
        _COLOUR, _same("x", "x", float), _same("y", "y", float), _same("size", "size", float),
        _same("rows", "rows", int), _same("columns", "columns", int),
        _same("frame", "frame", lambda name: "base_link" if "base" in str(name) else "map"),
    ),
    "image": _PICTURE,
    "laserscan": (*_SPOTS, _choice("color_transformer", "by", _SCAN_BY)),
    "marker": (),
    "multires_image": (),
    "navsat": _TRACK,
    "occupancy_grid": (_same("scheme", "scheme", _words),),
    "odometry": (
        *_TRACK, _same("show_covariance", "covariance", bool),
        _same("show_all_covariances", "all_covariances", bool), _same("show_laps", "laps", bool),
        Property("show_timestamps", "timestamps", bool, int),
    ),
    "path": (_COLOUR,),
    "pointcloud2": (*_SPOTS, _same("use_automaxmin", "auto", bool)),
    "pose": _TRACK,
    "robot_image": (
        *_SIZED, _same("offset_x", "offset_x", float), _same("offset_y", "offset_y", float),
    ),
    "route": (_COLOUR, _STYLE),
    "string": (*_PLACED, _COLOUR),
    "textured_marker": (),
    "tf_frame": (_COLOUR, _BUFFER, _same("position_tolerance", "tolerance_m", float)),
    "tile_map": (),
}  # fmt: skip
TOOLS = {
    "coordinate_picker", "draw_polygon", "measuring", "move_base", "plan_route",
    "point_click_publisher",
}  # fmt: skip
# Property that names the shown source; the topic for all others.
SOURCES = {"tf_frame": "frame", "robot_image": "frame", "tile_map": "source",
            "multires_image": "path", "grid": ""}  # fmt: skip


def read_display(type_: str, name: str, config: Any) -> tuple[dict[str, Any], list[str]]:
    """Read a display, and the names of the properties whose values do not fit."""
    config = config if isinstance(config, dict) else {}
    options, odd = {}, []
    for one in TABLE[type_]:
        if one.theirs not in config:
            continue
        try:
            options[one.ours] = one.here(config[one.theirs])
        except (ValueError, TypeError, KeyError, OverflowError):
            odd.append(f"{one.theirs} = {str(config[one.theirs])[:40]!r}")
    alpha = config.get("alpha", 1.0)
    is_ratio = isinstance(alpha, int | float) and 0.0 <= alpha <= 1.0
    source = SOURCES.get(type_, "topic")
    return {
        "type": type_,
        "title": name,
        "source": str(config.get(source, "") if source else "")[:200],
        "options": options,
        "visible": config.get("visible", True) is True,
        "opacity": float(alpha) if is_ratio else 1.0,
    }, odd
