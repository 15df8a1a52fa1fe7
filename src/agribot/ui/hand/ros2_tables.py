"""Parameters of ROS 2's joy_teleop and of teleop_twist_joy, as the original joy_teleop's table.

ROS 2 writes the parameters below `ros__parameters` of a node, and names what an axis moves in the
key, with hyphens. teleop_twist_joy has one axis for each direction, and two speeds.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

PARAMETERS = "ros__parameters"
# Keys of teleop_twist_joy; its own names of directions, and those of a twist.
TWIST_JOY_KEYS = {"axis_linear", "axis_angular", "enable_button", "enable_turbo_button"}
DIRECTIONS = {
    "linear": {"": "linear.x", "x": "linear.x", "y": "linear.y", "z": "linear.z"},
    "angular": {"": "angular.z", "yaw": "angular.z", "pitch": "angular.y", "roll": "angular.x"},
}
# Defaults of teleop_twist_joy 2.
AXES = {"linear": {"x": 5}, "angular": {"yaw": 2}}
ENABLE_BUTTON, SCALE, TURBO_SCALE = 5, 0.5, 1.0
NO_BUTTON = -1


def find_commands(tree: Any) -> dict[str, Any]:
    """Find the commands of a table by their places in the file; empty without any.

    Raises: ValueError: a setting of teleop_twist_joy that is not supported here.
    """
    if not isinstance(tree, dict):
        return {}
    if isinstance(tree.get("teleop"), dict) and PARAMETERS not in tree["teleop"]:
        return {f"teleop.{name}": entry for name, entry in tree["teleop"].items()}
    nodes = list(_find_parameters(tree, "")) or [("", tree)]
    found: dict[str, Any] = {}
    for node, parameters in nodes:
        nested = _nest(parameters)
        if TWIST_JOY_KEYS & nested.keys():
            commands = _convert_twist_joy(nested)
        else:
            commands = {
                name: _convert_entry(entry)
                for name, entry in nested.items()
                if isinstance(entry, dict) and "type" in entry
            }
        found |= {f"{node}.{name}".strip("."): entry for name, entry in commands.items()}
    return found


def _find_parameters(tree: dict[Any, Any], place: str) -> Iterator[tuple[str, dict[Any, Any]]]:
    for key, value in tree.items():
        if key == PARAMETERS and isinstance(value, dict):
            yield place, value
        elif isinstance(value, dict):
            yield from _find_parameters(value, f"{place}/{key}".strip("/"))


def _nest(parameters: dict[Any, Any]) -> dict[str, Any]:
    """Nest parameters whose names have points, `axis_linear.x`."""
    nested: dict[str, Any] = {}
    for key, value in parameters.items():
        *path, last = str(key).split(".")
        inner = nested
        for part in path:
            inner = inner.setdefault(part, {})
            if not isinstance(inner, dict):
                raise ValueError(f"'{key}' is inside of '{part}', which is a value")
        inner[last] = value
    return nested


def _convert_entry(entry: dict[str, Any]) -> dict[str, Any]:
    converted = {str(key): value for key, value in entry.items()}
    for key in ("axis_mappings", "message_value"):
        if isinstance(entry.get(key), dict):
            converted[key] = [
                {"target": _name_target(name), **mapping}
                for name, mapping in entry[key].items()
                if isinstance(mapping, dict) and not str(name).startswith("header")
            ]
    return converted


def _name_target(name: object) -> str:
    return str(name).replace("-", ".").removeprefix("twist.")


def _convert_twist_joy(parameters: dict[str, Any]) -> dict[str, Any]:
    """Convert the two speeds of teleop_twist_joy to velocities with a dead-man button each.

    Raises: ValueError: it would drive without one, or steer the other way backwards.
    """
    if parameters.get("require_enable_button", True) is not True:
        raise ValueError("require_enable_button is off: nothing drives here without a button held")
    if parameters.get("inverted_reverse", False) is not False:
        raise ValueError("inverted_reverse is on: backwards the robot steers as it does forwards")
    found = {}
    for name, button_key, default, suffix, scale in (  # with both held the first one counts
        ("turbo", "enable_turbo_button", NO_BUTTON, "_turbo", TURBO_SCALE),
        ("normal", "enable_button", ENABLE_BUTTON, "", SCALE),
    ):
        button = parameters.get(button_key, default)
        if button != NO_BUTTON:
            found[name] = {
                "type": "topic",
                "deadman_buttons": [button],
                "axis_mappings": list(_convert_axes(parameters, suffix, scale)),
            }
    return found


def _convert_axes(
    parameters: dict[str, Any], suffix: str, default_scale: float
) -> Iterator[dict[str, Any]]:
    for kind, directions in DIRECTIONS.items():
        axes = _spread(parameters.get(f"axis_{kind}", AXES[kind]))
        scales = _spread(parameters.get(f"scale_{kind}{suffix}", {}))
        for direction, axis in axes.items():
            if axis != NO_BUTTON:
                yield {
                    "target": directions.get(direction, f"{kind}.{direction}"),
                    "axis": axis,
                    "scale": scales.get(direction, default_scale),
                }


def _spread(value: Any) -> dict[str, Any]:
    """Spread a value for each direction; ROS 1 writes a bare number for the one that counts."""
    return value if isinstance(value, dict) else {"": value}
