"""Settings as the plain tree that TOML gives: assign, check and clean it before it gets types."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import msgspec

from agribot.core.errors import ConfigError


def assign(tree: dict[str, Any], setting: str) -> None:
    key, separator, text = setting.partition("=")
    if not separator or not key:
        raise ConfigError(f"--set {setting}: write it as key.subkey=value")
    *parents, leaf = key.strip().split(".")
    node = tree
    for name in parents:
        child = node.setdefault(name, {})
        if not isinstance(child, dict):
            raise ConfigError(f"--set {setting}: '{name}' is a value, not a group of settings")
        node = child
    node[leaf] = _value(text.strip())


def _value(text: str) -> object:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def read_toml(path: Path) -> dict[str, Any]:
    """Raises: ConfigError: no such file, or not TOML in UTF-8."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not text in UTF-8 ({error}); save it as UTF-8") from error
    return parse_toml(text, str(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Raises: ConfigError: not TOML; names the source."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ConfigError(f"{source} is not valid TOML: nested too deeply") from error
    except ValueError as error:  # also a number of thousands of digits
        raise ConfigError(f"{source} is not valid TOML: {error}") from error


def with_value(message: str, tree: dict[str, Any]) -> str:
    """The library's message with the offending setting and its value in front."""
    found = re.search(r"^(.*) - at `\$\.([\w.]+)(.*)`$", message)
    if found is None:
        return message
    expected, key, rest = found.groups()
    value: Any = tree
    for name in key.split("."):
        value = value[name]
    return f"{key} = {value!r}: {expected[0].lower()}{expected[1:]}" + (rest and f" at {rest}")


def check_finite(value: object, source: str, at: str) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            check_finite(inner, source, f"{at}.{key}" if at else key)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            check_finite(inner, source, f"{at}[{index}]")
    elif isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{source}: {at} = {value}: write a finite number")


def check_keys(tree: Mapping[str, Any], struct: type[msgspec.Struct], source: str, at: str) -> None:
    known = {field.name: field.type for field in msgspec.structs.fields(struct)}
    for key, value in tree.items():
        where = f"{at}.{key}" if at else key
        if key not in known:
            raise ConfigError(
                f"{source}: unknown setting '{where}'{did_you_mean(key, list(known))}; "
                f"known here: {', '.join(known)}"
            )
        kind = known[key]
        if get_origin(kind) is Literal and value not in get_args(kind):
            raise ConfigError(
                f"{source}: {where} = {value!r}{did_you_mean(str(value), list(get_args(kind)))}; "
                f"known: {', '.join(get_args(kind))}"
            )
        if isinstance(value, dict) and isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            check_keys(value, kind, source, where)


def did_you_mean(word: str, known: list[str]) -> str:
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f"; did you mean '{close[0]}'?" if close else ""


def without_none(tree: dict[str, Any]) -> dict[str, Any]:
    """TOML has no null: an absent key says the same."""
    return {
        key: without_none(value) if isinstance(value, dict) else value
        for key, value in tree.items()
        if value is not None
    }
