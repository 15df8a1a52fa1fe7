"""Configurations of mapviz (.mvc, YAML) as displays of our map, and back."""

from __future__ import annotations

import io
from typing import Any

from agribot.ui.server.answers import Unusable
from agribot.ui.server.mapviz_table import PREFIX, SOURCES, TABLE, TOOLS, read_display
from agribot.ui.small_yaml import UnusableYaml, read_yaml

MAX_DISPLAYS = 200
ROBOT_FRAMES = {"base_link", "base_footprint"}
# Quarter turns of the view that mapviz calls unturned: its target's x axis points right.
_AHEAD_TO_THE_RIGHT = 270


def displays_of(data: bytes) -> dict[str, Any]:
    """List `displays` from the lowest to the topmost, and `left_out` with the reason for each.

    Raises: Unusable: no configuration of mapviz.
    """
    try:
        tree = read_yaml(data)
    except UnusableYaml as error:
        raise Unusable(
            422, f"not the YAML of a mapviz configuration: {error}; save it anew"
        ) from error
    listed = tree.get("displays") if isinstance(tree, dict) else None
    if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
        raise Unusable(422, "no list 'displays'; give a configuration of mapviz")
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


def _write_view(view: dict[str, Any]) -> dict[str, Any]:
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
        display, odd = read_display(type_, name, entry.get("config"))
        found["displays"].append(display)
        why = f"without {', '.join(odd)}, which do not fit here" if odd else ""
    if why:
        found["left_out"].append({"name": name, "why": why})


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
            if source := SOURCES.get(type_, "topic"):
                config[source] = str(display["source"])
            config |= {
                one.theirs: one.there(options[one.ours])
                for one in TABLE[type_]
                if one.ours in options
            }
            entry = {"type": PREFIX + type_, "name": str(display["title"]), "config": config}
            listed.append(entry)
    except (KeyError, TypeError, ValueError) as error:
        raise Unusable(
            400, f"these are no displays of a view: {error}; load the page again"
        ) from error
    tree = {
        "fixed_frame": "map", **_write_view(view or {}), "use_latest_transforms": True,
        "show_displays": True, "displays": listed,
    }  # fmt: skip
    text = io.BytesIO()
    writer = YAML(typ="safe", pure=True)
    writer.default_flow_style = False
    writer.dump(tree, text)
    return text.getvalue()
