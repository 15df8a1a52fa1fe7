"""Print docs/firmware.md, with the table of the boards' messages as the code has it."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

from agribot.drivers import board_protocol as table
from agribot.drivers.board_codec import FORMATS

PAGE = Path(__file__).parents[1] / "docs" / "firmware.md"
BEGIN, END = "<!-- the messages: make pages -->\n", "<!-- end of the messages -->"


def page() -> str:
    """Make the page anew: its own words, and between the marks the table of the messages."""
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    parts = [f"Layout {table.LAYOUT:#06x}.\n", *map(_write_message, table.MESSAGES)]
    numbers = map(_write_numbers, table.NAMED_NUMBERS)
    made = "\n".join([*parts, "### Bits and numbers\n", *numbers])
    return f"{before}{BEGIN}\n{made}\n{END}{after}"


def _write_message(message: type[table.BoardMessage]) -> str:
    size = FORMATS[message.number].struct.size
    arrow = "to the board" if message.sender == "host" else "from the board"
    lines = [
        f"### {message.__name__}\n",
        f"`{message.number:#04x}`, {arrow}, {size} bytes. {_read_docstring(message)}\n",
    ]
    fields = table.list_fields(message)
    if fields:
        lines += ["| field | type | scale | unit |", "|---|---|---|---|"]
    for name, wire, _ in fields:
        kind = wire.kind + (f" × {wire.length}" if wire.length > 1 else "")
        scale = "" if wire.scale == 1.0 else f"{wire.scale:.6g}"
        lines.append(f"| `{name}` | {kind} | {scale} | {wire.unit} |")
    return "\n".join([*lines, ""])


def _write_numbers(kind: type) -> str:
    """Write the members of an enumeration, with what stands beside them in the source."""
    found = re.findall(r"^ +(\w+) = ([\d< ]+?)(?:  # (.*))?$", inspect.getsource(kind), re.M)
    rows = [f"| `{name}` | {number} | {about} |" for name, number, about in found]
    head = f"**{kind.__name__}**: {_read_docstring(kind)}\n"
    return "\n".join([head, "| name | number | |", "|---|---|---|", *rows, ""])


def _read_docstring(kind: type) -> str:
    return " ".join(inspect.cleandoc(kind.__doc__ or "").split())


if __name__ == "__main__":
    sys.stdout.write(page())
