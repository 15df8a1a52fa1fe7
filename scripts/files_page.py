"""Print docs/files.md: the keys of the files that a run and a log leave, from their structs.

`make pages` writes all such pages.
"""

from __future__ import annotations

import inspect
import sys
import typing
from collections.abc import Iterator
from typing import Any

import msgspec

from agribot.record.localization.result import LocalizationResult
from agribot.record.report import Report

HEAD = """# Files of a run and their keys

Written by `make pages` from the code. `report.json` of [a run](../README.md#two-commands) and the
last line of [`agribot localize --json`](localize.md) have these keys. What could not be measured is
null; what needs the truth of a simulator is null on a real robot.

"""
COLUMNS = "| place | keys | what |\n|---|---|---|\n"
Kind = type[msgspec.Struct]


def page() -> str:
    tables = (("The report of a run", Report), ("The result of a log", LocalizationResult))
    return HEAD + "\n".join(f"## {title}\n\n{_write(kind)}" for title, kind in tables)


def _write(struct: Kind) -> str:
    """Describe a struct and those that it holds, each once with all its places."""
    places: dict[Kind, list[str]] = {}
    for place, kind in [("", struct), *_list_inner(struct, "")]:
        places.setdefault(kind, []).append(f"`{place}`" if place else "")
    return COLUMNS + "".join(_write_row(kind, ", ".join(where)) for kind, where in places.items())


def _write_row(struct: Kind, places: str) -> str:
    words = " ".join(inspect.cleandoc(struct.__doc__ or "").split())
    keys = ", ".join(f"`{field.encode_name}`" for field in msgspec.structs.fields(struct))
    return f"| {places} | {keys} | {words} |\n"


def _list_inner(struct: Kind, place: str) -> Iterator[tuple[str, Kind]]:
    for field in msgspec.structs.fields(struct):
        for kind in _find_structs(field.type):
            inner = f"{place}.{field.encode_name}".lstrip(".")
            yield inner, kind
            yield from _list_inner(kind, inner)


def _find_structs(hint: Any) -> Iterator[Kind]:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        yield hint
    for inner in typing.get_args(hint):
        yield from _find_structs(inner)


if __name__ == "__main__":
    sys.stdout.write(page())
