"""Parts that installed packages add to the program: one entry-point group for each kind of part.

A package names an object in its `pyproject.toml`, and the program finds it by its name:

    [project.entry-points."agribot.corrections"]
    beacon = "my_beacon:BeaconRange"

An object with an attribute `settings`, a msgspec struct, has settings of its own. Their values
stand below its name, `[plugins.beacon]` in a profile or `--set plugins.beacon.std_m=0.1`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, partial
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

import msgspec

from agribot.core.errors import ConfigError, add_advice

PLATFORMS = "agribot.platforms"
SOURCES = "agribot.sources"
BOARDS = "agribot.boards"
CORRECTIONS = "agribot.corrections"
WITNESSES = "agribot.witnesses"
FACTS = "agribot.facts"
IMPLEMENTS = "agribot.implements"
FAULTS = "agribot.faults"
PANELS = "agribot.panels"
COMMANDS = "agribot.commands"
# Each group, and what its objects are.
GROUPS: dict[str, str] = {
    PLATFORMS: "a function of settings and robot that opens a platform",
    SOURCES: "a function of sensor, URI and context that opens a source",
    BOARDS: "a function of robot and options that makes a motor board",
    CORRECTIONS: "a class of corrections of the pose",
    WITNESSES: "a class of witnesses against sensors",
    FACTS: "texts of facts by language and code",
    IMPLEMENTS: "an `ImplementKind`",
    FAULTS: "a `FaultPlugin`",
    PANELS: "a function that adds panels to the operator's page",
    COMMANDS: "a module with HELP, EXAMPLE, add_arguments and run",
}

Settings = TypeVar("Settings", bound=msgspec.Struct)


class Plugin(msgspec.Struct, frozen=True, kw_only=True):
    """One entry point: where it comes from, and why it cannot be used (empty where it can)."""

    group: str
    name: str
    value: str  # module:object
    package: str
    version: str
    has_settings: bool = False
    error: str = ""


def list_plugins() -> list[Plugin]:
    """List what is installed, by group and name; each is imported to see whether it can be."""
    return [_describe(point) for group in GROUPS for point in _find_points(group)]


def find_plugin(group: str, name: str) -> Any | None:
    """Import the object of a name; None where no installed package has it.

    Raises: ConfigError: it cannot be imported, or two packages have one of this name.
    """
    points = [point for point in _find_points(group) if point.name == name]
    if len(points) > 1:
        packages = " and ".join(_name_package(point) for point in points)
        raise ConfigError(f"plugin {name!r} ({group}): {packages} both have it; uninstall one")
    return _load(points[0]) if points else None


def list_names(group: str) -> list[str]:
    """List the names of a group, without importing anything."""
    return sorted({point.name for point in _find_points(group)})


def iterate_plugins(group: str) -> Iterator[tuple[str, Any]]:
    """Import all objects of a group, by their names in order.

    Raises: ConfigError: as `find_plugin` does.
    """
    for name in list_names(group):
        yield name, find_plugin(group, name)


def find_settings(name: str) -> type[msgspec.Struct] | None:
    """Find the settings of the plugins of a name; None where none of them has any.

    Raises: ConfigError: no plugin has this name, or it cannot be imported.
    """
    found = [find_plugin(group, name) for group in GROUPS if name in list_names(group)]
    if not found:
        known = sorted({name for group in GROUPS for name in list_names(group)})
        raise ConfigError(
            f"no plugin {name!r} is installed; installed: {', '.join(known) or 'none'} "
            "(agribot plugins)"
        )
    kinds = (getattr(plugin, "settings", None) for plugin in found)
    return next((kind for kind in kinds if kind is not None), None)


def resolve_plugins(stated: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Check the settings of plugins, and add all installed corrections and witnesses.

    Returns: name -> all settings with their defaults, for `RunConfig.plugins`. A part without
        settings is there as well: the recording of a run names what had a say in its pose.

    Raises: ConfigError: a plugin is not installed or cannot be imported, or a setting is unknown,
        of the wrong type or out of range.
    """
    installed = (*list_names(CORRECTIONS), *list_names(WITNESSES))
    names = dict.fromkeys((*stated, *installed))
    return {name: _resolve(name, stated.get(name, {})) for name in names}


def require_plugins(names: Iterable[str]) -> None:
    """Refuse a run, such as a replay, whose plugins are not installed here.

    Raises: ConfigError: one is missing, or cannot be imported.
    """
    for name in names:
        find_settings(name)


def _resolve(name: str, stated: dict[str, Any]) -> dict[str, Any]:
    kind = find_settings(name)
    if kind is None and stated:
        raise ConfigError(f"plugins.{name}: the plugin has no settings; leave them out")
    if kind is None:
        return {}
    settings: dict[str, Any] = msgspec.to_builtins(read_settings({name: stated}, name, kind))
    return settings


def read_settings(plugins: Mapping[str, Any], name: str, kind: type[Settings]) -> Settings:
    """Read the settings of a plugin from `RunConfig.plugins`; its defaults where none are stated.

    Raises: ConfigError: they do not fit.
    """
    try:
        return msgspec.convert(plugins.get(name, {}), kind)
    except msgspec.ValidationError as error:
        raise ConfigError(add_advice(f"plugins.{name}: {error}", "give such a value")) from error


def bind_settings(plugin: Any, plugins: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the keyword argument `settings` of a plugin that has some, else no argument."""
    kind = getattr(plugin, "settings", None)
    return {} if kind is None else {"settings": read_settings(plugins, name, kind)}


def find_used(group: str, plugins: Mapping[str, Any]) -> dict[str, Any]:
    """Import the objects of a group that `RunConfig.plugins` names, by their names.

    Raises: ConfigError: as `find_plugin` does.
    """
    found = ((name, find_plugin(group, name)) for name in plugins)
    return {name: plugin for name, plugin in found if plugin is not None}


def bind_all(parts: Mapping[str, Any], plugins: Mapping[str, Any]) -> dict[str, Any]:
    """Bind each part to its settings, which are those of `RunConfig.plugins`.

    Raises: ConfigError: they do not fit.
    """
    return {
        name: partial(part, **bind_settings(part, plugins, name)) for name, part in parts.items()
    }


def _find_points(group: str) -> tuple[EntryPoint, ...]:
    return _read_points(group, tuple(sys.path))


@cache
def _read_points(group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Read what is installed on `path`, once: it takes some tens of milliseconds."""
    return tuple(sorted(entry_points(group=group), key=lambda point: point.name))


def _load(point: EntryPoint) -> Any:
    try:
        return point.load()
    except Exception as error:  # whatever a module of others does while it is imported
        raise ConfigError(
            f"plugin {point.name!r} of {_name_package(point)} ({point.group}): "
            f"{type(error).__name__}: {error}; update or uninstall that package"
        ) from error


def _describe(point: EntryPoint) -> Plugin:
    error, has_settings = "", False
    try:
        plugin = find_plugin(point.group, point.name)
        has_settings = getattr(plugin, "settings", None) is not None
    except ConfigError as fault:
        error = str(fault)
    package = point.dist
    return Plugin(
        group=point.group,
        name=point.name,
        value=point.value,
        package=package.name if package else "",
        version=package.version if package else "",
        has_settings=has_settings,
        error=error,
    )


def _name_package(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else point.value
