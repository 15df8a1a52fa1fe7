"""Names of files that a command writes: a name that says another format is refused."""

from __future__ import annotations

from pathlib import Path

from agribot.core.errors import ConfigError


def check_ending(option: str, path: Path, content: str, *endings: str) -> None:
    """Refuse a name with an ending of another format; one without an ending is taken as it is.

    Raises: ConfigError: the name says another format than `content`.
    """
    if path.suffix and path.suffix.lower() not in endings:
        raise ConfigError(
            f"{option} {path}: what is written is {content}; give a name that ends with "
            f"{' or '.join(endings)}"
        )
