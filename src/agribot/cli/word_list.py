"""Lists of names on the command line, such as --lights sun,overcast."""

from __future__ import annotations

from collections.abc import Iterable

from agribot.core.errors import ConfigError


def parse_names(option: str, text: str | None, known: Iterable[str]) -> tuple[str, ...]:
    """Parse the names in `text`, each once; without text all that are known.

    Raises: ConfigError: a name is not known.
    """
    names = tuple(known)
    if not text:
        return names
    words = tuple(dict.fromkeys(word.strip() for word in text.split(",")))
    for word in words:
        if word not in names:
            raise ConfigError(f"{option} {word}: not known; there are {', '.join(names)}")
    return words
