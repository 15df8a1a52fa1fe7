"""ROS 2 counts the old type `char` as uint8, in hashes and on the wire; rosbags 0.11 does not."""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore


def replace_char(store: Typestore) -> None:
    """Replace `char` by uint8 in all types of a store."""
    for name, (constants, fields) in list(store.fielddefs.items()):
        replaced: list[Any] = [(field, _replace_in_field(kind)) for field, kind in fields]
        if replaced != list(fields):
            store.fielddefs[name] = (constants, replaced)


def _replace_in_field(kind: Any) -> Any:
    node, detail = kind
    if node == Nodetype.BASE:
        return (node, ("uint8", detail[1])) if detail[0] == "char" else kind
    if node == Nodetype.NAME:
        return kind
    inner, count = detail
    return (node, (_replace_in_field(inner), count))
