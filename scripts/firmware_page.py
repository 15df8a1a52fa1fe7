"""Print docs/firmware.md, with the table of the boards' messages as the code has it."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

from agribot.drivers.board import board_protocol as table
from agribot.drivers.board.board_codec import FORMATS

PAGE = Path(__file__).parents[1] / "docs" / "firmware.md"
BEGIN, END = "<!-- the messages: make pages -->\n", "<!-- end of the messages -->"


HEAD = """
| message | what | fields: type, scale, unit |
|---|---|---|
"""


def page() -> str:
    """Make the page anew: its own words, and between the marks the table of the messages."""
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    messages = "".join(map(_write_message, table.MESSAGES))
    numbers = "\n".join(map(_write_numbers, table.NAMED_NUMBERS))
    made = f"Layout {table.LAYOUT:#06x}.\n{HEAD}{messages}\n### Bits and numbers\n\n{numbers}"
    return f"{before}{BEGIN}\n{made}\n{END}{after}"


def _write_message(message: type[table.BoardMessage]) -> str:
    size = FORMATS[message.number].struct.size
    arrow = "to the board" if message.sender == "host" else "from the board"
    name = f"`{message.__name__}`: `{message.number:#04x}`, {arrow}, {size} bytes"
    fields = "; ".join(_write_field(field, wire) for field, wire, _ in table.list_fields(message))
    return f"| {name} | {_read_docstring(message)} | {fields} |\n"


def _write_field(name: str, wire: table.Wire) -> str:
    kind = wire.kind + (f"×{wire.length}" if wire.length > 1 else "")
    scale = "" if wire.scale == 1.0 else f"{wire.scale:.6g}"
    return " ".join(part for part in (f"`{name}`", kind, scale, wire.unit) if part)


def _write_numbers(kind: type) -> str:
    """Write the members of an enumeration, with what stands beside them in the source."""
    found = re.findall(r"^ +(\w+) = ([\d< ]+?)(?:  # (.*))?$", inspect.getsource(kind), re.M)
    members = (
        f"`{name}` {number.replace(' ', '')}" + (f" ({about})" if about else "")
        for name, number, about in found
    )
    return f"**{kind.__name__}**: {_read_docstring(kind)} {', '.join(members)}.\n"


def _read_docstring(kind: type) -> str:
    return " ".join(inspect.cleandoc(kind.__doc__ or "").split())


if __name__ == "__main__":
    sys.stdout.write(page())
