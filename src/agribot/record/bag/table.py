"""Any ROS topic as a table: one row for each message, one column for each number or text."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from agribot.core.errors import CHECK_DISK, RecordingError, explain_os_error
from agribot.core.whole_file import make_at_once
from agribot.record.bag.opening import check_target, open_bag
from agribot.record.bag.source import Bag, BagTopic

_WIDEST = 64  # largest width; longer arrays stay in one column, as JSON


def write_table(source: Path, topic_name: str, target: Path) -> int:
    """Write one row for each message to `target` as CSV and return the number of rows.

    The first column is the recorder's time in seconds. Arrays of a length that changes, and long
    ones, are JSON in one column. An earlier table stays until the new one is whole.
    Raises: RecordingError: no such topic, no ROS messages, or the target is the recording itself.
    """
    check_target(source, target, "table")
    with open_bag(source) as bag:
        topic = bag.find(topic_name)
        if not bag.knows(topic):
            raise RecordingError(
                f"{topic_name} holds {topic.ros_type or topic.encoding} messages, which cannot be "
                "read here; a table needs ROS messages with a known definition"
            )

        def make(path: Path) -> int:
            with path.open("w", newline="", encoding="utf-8") as file:
                return _write_rows(csv.writer(file, lineterminator="\n"), _list_rows(bag, topic))

        with explain_os_error(f"cannot write {target}", CHECK_DISK):
            target.parent.mkdir(parents=True, exist_ok=True)
            return make_at_once(target, make)


def _write_rows(writer: Any, rows: Iterator[tuple[object, ...]]) -> int:
    """Write a line of names and all rows; return how many rows there were."""
    count = -1
    for row in rows:
        writer.writerow(row)
        count += 1
    return max(count, 0)


def _list_rows(bag: Bag, topic: BagTopic) -> Iterator[tuple[object, ...]]:
    """List the names of the columns, then the values of each message; nothing without one."""
    is_first = True
    for message, value in bag.values(frozenset({topic.name})):
        cells: dict[str, Any] = {}
        _flatten(bag.store(), topic.ros_type, value, "", cells)
        if is_first:
            yield ("log_time_s", *cells)
        is_first = False
        seconds, nanoseconds = divmod(message.log_ns, 1_000_000_000)
        yield (f"{seconds}.{nanoseconds:09d}", *cells.values())


def _flatten(store: Any, ros_type: str, value: Any, prefix: str, cells: dict[str, Any]) -> None:
    for name, description in store.fielddefs[ros_type][1]:
        inner = getattr(value, name if hasattr(value, name) else f"{name}_")
        label = f"{prefix}{name}"
        kind = description[0].name
        if kind == "NAME":
            _flatten(store, description[1], inner, f"{label}.", cells)
        elif kind == "ARRAY" and isinstance(inner, np.ndarray) and len(inner) <= _WIDEST:
            cells |= {f"{label}[{i}]": item for i, item in enumerate(inner.tolist())}
        elif kind in ("ARRAY", "SEQUENCE"):
            cells[label] = json.dumps(_simplify(inner))
        else:
            cells[label] = inner


def _simplify(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [_simplify(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {
            name: _simplify(getattr(value, name))
            for name in value.__dataclass_fields__
            if not name.startswith("__")
        }
    return value
