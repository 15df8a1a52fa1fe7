"""Conditions under which photographs were taken: shadow, sun, small crop, weeds."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path

from agribot.core.errors import ConfigError

TABLE = "conditions.csv"
COLUMNS = ("picture", "condition")
NUMBER = re.compile(r"[\W_]*\d+$")


def read_conditions(folder: Path) -> Mapping[str, str]:
    """Read the condition of each picture, by its name without suffix; empty without a table.

    Raises: ConfigError: the table cannot be read, or has other columns.
    """
    path = folder / TABLE
    if not path.is_file():
        return {}
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
            found = [(row["picture"], row["condition"]) for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: cannot be read: {error}; check the path") from error
    except KeyError as error:
        raise ConfigError(
            f"{path}: has no column {error}; its first line is {','.join(COLUMNS)}"
        ) from error
    return {Path(picture or "").stem: condition or "" for picture, condition in found}


def find_condition(picture: Path, table: Mapping[str, str]) -> str:
    """Find the condition of a picture in the table or in its name, as `shadow_12.jpg` has it.

    Empty: nothing states one.
    """
    return table.get(picture.stem, "") or _read_name(picture.stem)


def _read_name(stem: str) -> str:
    """Return what stands before the number of a name, if it has both."""
    match = NUMBER.search(stem)
    return stem[: match.start()] if match else ""
