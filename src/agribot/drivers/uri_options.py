"""What stands behind the question mark of a URI: each option is taken out by who knows it."""

from __future__ import annotations

import math

from agribot.core.errors import ConfigError
from agribot.core.suggestions import suggest_name
from agribot.drivers.schemes import SourceUri


class UriOptions:
    """The options of one URI."""

    def __init__(self, uri: SourceUri) -> None:
        self._uri, self._left = uri, dict(uri.options)
        self._known: list[str] = []

    def pop_text(self, name: str, default: str) -> str:
        self._known.append(name)
        return self._left.pop(name, default)

    def pop_number(self, name: str, default: float, least: float, most: float) -> float:
        """Take a number out.

        Raises: ConfigError: it is none, or out of range.
        """
        text = self.pop_text(name, "")
        try:
            value = float(text) if text else default
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise ConfigError(
                f"{self._uri.scheme}:{self._uri.name}?{name}={text}: write a number from "
                f"{least:g} to {most:g}"
            )
        return value

    def check_empty(self) -> None:
        """Refuse what nobody took out.

        Raises: ConfigError: an option that the source does not know.
        """
        for name in self._left:
            raise ConfigError(
                f"{self._uri.scheme}:{self._uri.name}: unknown option '{name}'"
                f"{suggest_name(name, self._known)}; known are {', '.join(self._known)}"
            )
