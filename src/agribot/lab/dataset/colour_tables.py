"""Tables of the colours or values of masks, as labelling tools write them beside the masks."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

from agribot.core.errors import ConfigError, add_advice
from agribot.core.messages import PlantClass
from agribot.core.table_text import find_separator, read_text_file
from agribot.lab.dataset.classes import COLOUR, NAMES, UNLABELLED, format_key

# CVAT and VOC; Roboflow; several programs for segmentation; CamVid.
TABLE_NAMES = ("labelmap.txt", "_classes.csv", "class_dict.csv", "label_colors.txt")
MAX_BYTES = 1_000_000
SOIL = ("background", "void", "ground", "_background_", "unlabelled", "unlabeled")
MEANING = {**NAMES, **dict.fromkeys(SOIL, int(PlantClass.SOIL))}


def find_table_ids(root: Path) -> Mapping[int, int] | None:
    """Find what the masks below a folder mean, from the table beside them; None without one.

    Raises: ConfigError: a table that cannot be read, two that differ, or a name that is no class.
    """
    paths = [
        path
        for place in ("", "*/", "*/*/")
        for name in TABLE_NAMES
        for path in sorted(root.glob(place + name))
    ]
    found = {path: _read_table(path) for path in paths}
    tables = list(found.values())
    if not tables:
        return None
    if any(table != tables[0] for table in tables):
        raise ConfigError(
            f"{paths[0]} and {paths[1]} say different things of the masks; say what they mean with "
            "--ids"
        )
    return _explain(paths[0], tables[0])


def _explain(path: Path, table: Mapping[int, str]) -> Mapping[int, int]:
    unknown = {key: name for key, name in table.items() if name.lower() not in MEANING}
    if not unknown:
        ids = {key: MEANING[name.lower()] for key, name in table.items()}
        return {UNLABELLED: UNLABELLED, **ids}
    names = ", ".join(f"{format_key(key)} is '{name[:40]}'" for key, name in unknown.items())
    kinds = {kind: name for name, kind in NAMES.items()}
    meant = {key: kinds.get(MEANING.get(name.lower(), -1), "CLASS") for key, name in table.items()}
    advice = ",".join(f"{format_key(key)}={kind}" for key, kind in meant.items())
    raise ConfigError(
        f"{path}: {names}; say which class of {', '.join(NAMES)} each is: --ids {advice}"
    )


def _read_table(path: Path) -> dict[int, str]:
    """Read the names of colours and values.

    Raises: ConfigError: the file is no such table.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"more than {MAX_BYTES} bytes")
        lines = read_text_file(path).split("\n")
        table = dict(_READERS.get(path.name, _read_rows)(lines))
    except (OSError, ValueError, IndexError) as error:
        fact = f"{path} is no table of colours: {error}"
        raise ConfigError(add_advice(fact, "delete it, or export it again")) from error
    if not table:
        raise ConfigError(f"{path} names no colour; delete it, or export it again")
    return table


def _read_labelmap(lines: list[str]) -> Iterator[tuple[int, str]]:
    """Read `name:red,green,blue:parts:actions`."""
    for line in lines:
        if line.strip() and not line.startswith("#"):
            name, colour = line.split(":")[:2]
            yield _pack(colour.split(",")), name.strip()


def _read_rows(lines: list[str]) -> Iterator[tuple[int, str]]:
    """Read rows of value and name, or of name and red, green and blue."""
    rows = list(csv.reader(lines, delimiter=find_separator(lines[0])))
    for row in rows[1:]:
        cells = [cell.strip() for cell in row]
        if len(cells) == 2:
            yield int(cells[0]), cells[1]
        elif len(cells) >= 4:
            yield _pack(cells[1:4]), cells[0]


def _read_colours(lines: list[str]) -> Iterator[tuple[int, str]]:
    """Read red, green, blue and name, with blanks or tabs between."""
    for line in lines:
        words = line.split(maxsplit=3)
        if len(words) > 3:
            yield _pack(words[:3]), words[3].strip()


_READERS = {"labelmap.txt": _read_labelmap, "label_colors.txt": _read_colours}


def _pack(parts: list[str]) -> int:
    red, green, blue = (int(part) for part in parts)
    if not all(0 <= part <= 255 for part in (red, green, blue)):
        raise ValueError(f"{red},{green},{blue} is no colour")
    return COLOUR | red << 16 | green << 8 | blue
