"""ROS 1's own serialiser, run by the system's Python: no AGRIBOT code.

Reads a JSON list of [type, definition with all it needs, values by field name], answers with the
bytes of each as JSON, in hexadecimal.
"""

from __future__ import annotations

import io
import json
import sys
from typing import Any

import genpy
import genpy.dynamic


def fill(message: Any, values: dict[str, Any]) -> Any:
    for name, kind in zip(message.__slots__, message._slot_types, strict=True):
        setattr(message, name, filled(kind, values[name]))
    return message


def filled(kind: str, value: Any) -> Any:
    if kind in ("time", "duration"):
        return getattr(genpy, kind.title())(value[0], value[1])
    if kind.startswith(("uint8[", "char[")):
        return bytes(value)
    if kind.endswith("]"):
        return [filled(kind[: kind.index("[")], each) for each in value]
    if isinstance(value, dict):
        return fill(TYPES[kind if "/" in kind else f"std_msgs/{kind}"](), value)
    return value


TYPES: dict[str, Any] = {}
answers = []
for ros_type, text, values in json.load(sys.stdin):
    TYPES.clear()
    TYPES.update(genpy.dynamic.generate_dynamic(ros_type, text))
    buffer = io.BytesIO()
    fill(TYPES[ros_type](), values).serialize(buffer)
    answers.append(buffer.getvalue().hex())
json.dump(answers, sys.stdout)
