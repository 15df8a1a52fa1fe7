"""The implement of a URDF tree: the one block of <agribot> that is named after a kind of it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import msgspec

from agribot.core.errors import add_advice
from agribot.core.implement.kind import find_spec_type, list_kinds
from agribot.core.implement.spec import ImplementSpec
from agribot.description.elements import SourceFile
from agribot.description.tags import TagBlock, find_extra, list_extras

OTHER_GROUPS = ("drive", "tyre")


def read_implement(root: ET.Element, source: SourceFile) -> ImplementSpec | None:
    """Read the block of <agribot> that is named after a kind of implement; None without one.

    Raises: DescriptionError: more than one, or a number is missing or out of range.
    """
    found: list[ImplementSpec] = []
    for name in list_extras(root):
        kind, block = find_spec_type(name), find_extra(root, name, source)
        if kind is not None and block is not None:
            found.append(_read(kind, block, source))
        elif name not in OTHER_GROUPS:
            source.warn(
                f"<agribot>: <{name}> is unknown and left out; "
                f"implements: {', '.join(list_kinds())}"
            )
    if len(found) > 1:
        names = ", ".join(f"<{spec.kind}>" for spec in found)
        raise source.fail("<agribot>", f"{names} are {len(found)} implements; leave one of them")
    return found[0] if found else None


def _read(kind: type[ImplementSpec], block: TagBlock, source: SourceFile) -> ImplementSpec:
    """Read an implement; a field without a tag keeps its default, if it has one."""
    values: dict[str, Any] = {}
    for field in msgspec.structs.fields(kind):
        name = field.encode_name
        if not field.required and name.lower() not in block.tags:
            continue
        value = block.read_number(name)
        values[name] = int(value) if value.is_integer() else value
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        what, _, path = str(error).partition(" - at `$.")
        where = f"<{path.rstrip('`')}> is {values.get(path.rstrip('`'))!r}: " if path else ""
        raise source.fail(block.what, add_advice(f"{where}{what}", "correct it")) from error
