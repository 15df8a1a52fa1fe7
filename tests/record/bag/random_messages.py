"""Messages of any type with values in every field."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")


class Dice:
    """Values of every field: a message for us, and the same in JSON for the other side."""

    def __init__(self, store: Typestore, seed: int) -> None:
        self._store = store
        self._rng = np.random.default_rng(seed)

    def message(self, ros_type: str) -> tuple[Any, dict[str, Any]]:
        ours: list[Any] = []
        theirs: dict[str, Any] = {}
        for name, kind in self._store.fielddefs[ros_type][1]:
            mine, value = self.value(kind)
            ours.append(mine)
            theirs[name] = value
        return self._store.types[ros_type](*ours), theirs

    def value(self, kind: Any) -> tuple[Any, Any]:
        node, detail = kind
        if node == Nodetype.BASE:
            return self._base(detail[0])
        if node == Nodetype.NAME:
            if detail in TIMES:
                sec, nanosec = (int(n) for n in self._rng.integers(1, 1_000_000, 2))
                return self._store.types[detail](sec, nanosec), [sec, nanosec]
            return self.message(detail)
        inner, count = detail
        pairs = [self.value(inner) for _ in range(count or int(self._rng.integers(1, 4)))]
        ours = [mine for mine, _ in pairs]
        is_plain = inner[0] == Nodetype.BASE and inner[1][0] != "string"
        dtype = {"bool": np.bool_, "char": np.uint8, "byte": np.int8, "octet": np.uint8}
        if is_plain:
            name = inner[1][0]
            return np.array(ours, dtype=dtype.get(name, name)), [value for _, value in pairs]
        return ours, [value for _, value in pairs]

    def _base(self, name: str) -> tuple[Any, Any]:
        if name == "string":
            text = "".join(chr(int(c)) for c in self._rng.integers(0x61, 0x100, 5))
            return text, text
        if name == "bool":
            flag = bool(self._rng.integers(0, 2))
            return flag, flag
        number: float = int(self._rng.integers(0, 100))
        if name.startswith("float"):
            number += 0.25  # exact in both widths
        return number, number
