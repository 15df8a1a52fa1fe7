"""Configurations of mapviz (.mvc, YAML) as displays of our map, and back.

Both know the same plugins; THE table says which of their properties are options of ours. What has
no counterpart is named and left out, never guessed.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any, NamedTuple

from agribot.ui.server.answers import Unusable
from agribot.ui.small_yaml import UnusableYaml, read_yaml

PREFIX = "mapviz_plugins/"
MAX_DISPLAYS = 200
ROBOT_FRAMES = {"base_link", "base_footprint"}
# Quarter turns of the view that mapviz calls unturned: its target's x axis points right.
_AHEAD_TO_THE_RIGHT = 270
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
_SOURCES = {"tf_frame": "frame", "robot_image": "frame", "tile_map": "source",
            "multires_image": "path", "grid": ""}  # fmt: skip


def displays_of(data: bytes) -> dict[str, Any]:
    """List `displays` from the lowest to the topmost, and `left_out` with the reason for each.

    Raises: Unusable: no configuration of mapviz.
    """
    try:
        tree = read_yaml(data)
    except UnusableYaml as error:
        raise Unusable(422, f"not the YAML of a mapviz configuration: {error}") from error
    listed = tree.get("displays") if isinstance(tree, dict) else None
    if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
        raise Unusable(422, "no configuration of mapviz: it has no list 'displays'")
    if len(listed) > MAX_DISPLAYS:
        raise Unusable(422, f"{len(listed)} displays; at most {MAX_DISPLAYS} are taken")
    found: dict[str, Any] = {"displays": [], "left_out": [], "view": _view_of(tree)}
    for entry in listed:
        _take(entry, found)
    return found


def _view_of(tree: dict[str, Any]) -> dict[str, Any]:
    """Find what our map stays on, and how it is turned, degrees clockwise."""
    frame = str(tree.get("target_frame", "<none>")).rpartition("/")[2]
    is_turned = tree.get("rotate_90") is True
    if frame not in ROBOT_FRAMES:
        return {"target": "map", "turn": 90 if is_turned and frame != "<none>" else 0}
    if tree.get("fix_orientation") is True:
        return {"target": "position", "turn": 90 if is_turned else 0}
    return {"target": "heading", "turn": 0 if is_turned else _AHEAD_TO_THE_RIGHT}


def _told_of(view: dict[str, Any]) -> dict[str, Any]:
    """Say the same in mapviz's words, which have no other turns."""
    target, turn = view.get("target", "map"), view.get("turn", 0)
    with_heading = target == "heading"
    is_turned = turn != _AHEAD_TO_THE_RIGHT if with_heading else turn == 90
    return {
        "target_frame": "base_link" if target != "map" else "map" if is_turned else "<none>",
        "fix_orientation": not with_heading,
        "rotate_90": is_turned,
    }


def _take(entry: dict[str, Any], found: dict[str, Any]) -> None:
    type_ = str(entry.get("type", "")).removeprefix(PREFIX)
    name = str(entry.get("name") or type_)[:40]
    if type_ in TOOLS:
        why = "a tool: it is always there, at the left of the map"
    elif type_ not in TABLE:
        why = f"there is no display '{type_[:60]}' here"
    else:
        display, odd = _display(type_, name, entry.get("config"))
        found["displays"].append(display)
        why = f"without {', '.join(odd)}, which do not fit here" if odd else ""
    if why:
        found["left_out"].append({"name": name, "why": why})


def _display(type_: str, name: str, config: Any) -> tuple[dict[str, Any], list[str]]:
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
    source = _SOURCES.get(type_, "topic")
    return {
        "type": type_,
        "title": name,
        "source": str(config.get(source, "") if source else "")[:200],
        "options": options,
        "visible": config.get("visible", True) is True,
        "opacity": float(alpha) if is_ratio else 1.0,
    }, odd


def config_of(displays: list[dict[str, Any]], view: dict[str, Any] | None = None) -> bytes:
    """Write the displays, lowest first, as mapviz opens them; ours alone are left out.

    `view` is the target and the turn of the map, as `displays_of` gives them.

    Raises: Unusable: they are no displays.
    """
    from ruamel.yaml import YAML

    listed = []
    try:
        for display in displays:
            type_, options = str(display["type"]), dict(display["options"])
            if type_ not in TABLE:
                continue
            config: dict[str, Any] = {"visible": bool(display["visible"]), "collapsed": True}
            if source := _SOURCES.get(type_, "topic"):
                config[source] = str(display["source"])
            config |= {
                one.theirs: one.there(options[one.ours])
                for one in TABLE[type_]
                if one.ours in options
            }
            entry = {"type": PREFIX + type_, "name": str(display["title"]), "config": config}
            listed.append(entry)
    except (KeyError, TypeError, ValueError) as error:
        raise Unusable(400, f"these are no displays of a view: {error}") from error
    tree = {
        "fixed_frame": "map", **_told_of(view or {}), "use_latest_transforms": True,
        "show_displays": True, "displays": listed,
    }  # fmt: skip
    text = io.BytesIO()
    writer = YAML(typ="safe", pure=True)
    writer.default_flow_style = False
    writer.dump(tree, text)
    return text.getvalue()
