"""What stands behind the question mark of a URI: each option is taken out by who knows it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from agribot.core.errors import ConfigError, describe_range
from agribot.core.suggestions import suggest_name
from agribot.drivers.line.schemes import SourceUri


class UriOptions:
    """The options of one URI; `settings` count where it does not state one of the same name."""

    def __init__(self, uri: SourceUri, settings: Mapping[str, float] | None = None) -> None:
        self._uri, self._left, self._settings = uri, dict(uri.options), settings or {}
        self._known: list[str] = []

    def pop_text(self, name: str, default: str) -> str:
        self._known.append(name)
        return self._left.pop(name, default)

    def pop_number(self, name: str, default: float, least: float, most: float) -> float:
        """Take a number out.

        Raises: ConfigError: not a number, or out of range.
        """
        text = self.pop_text(name, "")
        try:
            value = float(text) if text else self._settings.get(name, default)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            wanted = describe_range(least, most)
            raise ConfigError(f"{self._uri.scheme}:{self._uri.name}?{name}={text}: {wanted}")
        return value

    def pop_stated(self, name: str, least: float, most: float, how: str) -> float:
        """Take a number out that has no default; `how` says where to find and state it.

        Raises: ConfigError: it is not stated, not a number, or out of range.
        """
        if name not in self._left and name not in self._settings:
            raise ConfigError(
                f"{self._uri.scheme}:{self._uri.name}: {name} is not stated, and no description "
                f"knows the motors of a real robot; {how}"
            )
        return self.pop_number(name, math.nan, least, most)

    def check_empty(self) -> None:
        """Refuse options that the source did not take.

        Raises: ConfigError: an option that the source does not know.
        """
        for name in self._left:
            raise ConfigError(
                f"{self._uri.scheme}:{self._uri.name}: unknown option '{name}'"
                f"{suggest_name(name, self._known)}; known are {', '.join(self._known)}"
            )
