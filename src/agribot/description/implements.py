"""The implement of a URDF tree: the one block of <agribot> that is named after a kind of it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import msgspec

from agribot.core.implement.kind import spec_types
from agribot.core.implement.spec import ImplementSpec
from agribot.description.elements import Source
from agribot.description.tags import TagBlock, extra_groups, find_extra

OTHER_GROUPS = ("drive", "tyre")


def read_implement(root: ET.Element, source: Source) -> ImplementSpec | None:
    """Raises: DescriptionError: more than one implement, or a number is missing or out of range."""
    kinds = spec_types()
    for name in extra_groups(root):
        if name not in kinds and name not in OTHER_GROUPS:
            source.warn(
                f"<agribot>: <{name}> is unknown and left out; "
                f"implements: {', '.join(sorted(kinds))}"
            )
    blocks = {name: find_extra(root, name, source) for name in kinds}
    found = [(name, block) for name, block in blocks.items() if block is not None]
    if len(found) > 1:
        names = ", ".join(f"<{name}>" for name, _ in found)
        raise source.fail("<agribot>", f"{names} are {len(found)} implements; leave one of them")
    return _read(kinds[found[0][0]], found[0][1], source) if found else None


def _read(kind: type[ImplementSpec], block: TagBlock, source: Source) -> ImplementSpec:
    """A field without a tag keeps its default, if it has one."""
    values: dict[str, Any] = {}
    for field in msgspec.structs.fields(kind):
        name = field.encode_name
        if not field.required and name.lower() not in block.tags:
            continue
        value = block.number(name)
        values[name] = int(value) if value.is_integer() else value
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        what, _, path = str(error).partition(" - at `$.")
        told = f"<{path.rstrip('`')}> is {values.get(path.rstrip('`'))!r}: " if path else ""
        raise source.fail(block.what, f"{told}{what}") from error
