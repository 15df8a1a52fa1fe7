"""Plain trees of TOML: read, checked against a struct, and written without what is unset."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import msgspec

from agribot.core.errors import CHECK_PATH, ConfigError, explain_os_error
from agribot.core.suggestions import suggest_name
from agribot.core.table_text import read_text_file


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file as a plain tree.

    Raises: ConfigError: no such file, no text, or not TOML.
    """
    try:
        with explain_os_error(f"cannot read {path}", CHECK_PATH, ConfigError):
            text = read_text_file(path)
    except ValueError as error:
        raise ConfigError(f"{path} cannot be read: {error}; save it as UTF-8") from error
    return parse_toml(text, str(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse TOML text as a plain tree.

    Raises: ConfigError: not TOML; names the source.
    """
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ConfigError(
            f"{source} is not valid TOML: nested too deeply; write it flat"
        ) from error
    except ValueError as error:  # also a number of thousands of digits
        raise ConfigError(
            f"{source} is not valid TOML: {error}; quote texts, and write name = value"
        ) from error


def drop_none(tree: dict[str, Any]) -> dict[str, Any]:
    """Leave out the keys without a value: TOML has no null, an absent key says the same."""
    return {
        key: drop_none(value) if isinstance(value, dict) else value
        for key, value in tree.items()
        if value is not None
    }


def check_finite(value: object, source: str, at: str) -> None:
    """Refuse numbers that are not finite anywhere in a tree; `at` is where it hangs."""
    if isinstance(value, dict):
        for key, inner in value.items():
            check_finite(inner, source, f"{at}.{key}" if at else key)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            check_finite(inner, source, f"{at}[{index}]")
    elif isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{source}: {at} = {value}: not finite; write a finite number")


def check_keys(tree: Mapping[str, Any], struct: type[msgspec.Struct], source: str, at: str) -> None:
    """Refuse keys that the struct does not have and words that it does not know."""
    known = {field.name: field.type for field in msgspec.structs.fields(struct)}
    for key, value in tree.items():
        where = f"{at}.{key}" if at else key
        if key not in known:
            raise ConfigError(
                f"{source}: unknown setting '{where}'{suggest_name(key, list(known))}; "
                f"known here: {', '.join(known)}"
            )
        kind = known[key]
        words = _find_words(kind)
        for word in value if isinstance(value, list) else [value]:
            if words and word not in words and (get_origin(kind) is Literal or value is not word):
                raise ConfigError(
                    f"{source}: {where} = {value!r}{suggest_name(str(word), words)}; "
                    f"known: {', '.join(words)}"
                )
        if isinstance(value, dict) and isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            check_keys(value, kind, source, where)


def name_setting(message: str, tree: dict[str, Any]) -> str:
    """Put the setting and its value in front of a message of msgspec."""
    found = re.search(r"^(.*) - at `\$\.([\w.]+)(.*)`$", message)
    if found is None:
        return message
    expected, key, rest = found.groups()
    value: Any = tree
    for name in key.split("."):
        value = value[name]
    return f"{key} = {value!r}: {expected[0].lower()}{expected[1:]}" + (rest and f" at {rest}")


def _find_words(kind: Any) -> list[str]:
    """List the words that a setting may be, or that may stand in its list; none of numbers."""
    if get_origin(kind) is Literal:
        return list(get_args(kind))
    return [word for inner in get_args(kind) for word in _find_words(inner)]
