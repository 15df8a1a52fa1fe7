"""Print docs/board-messages.md, the messages of the boards as the code has them.

`make pages` writes all such pages.
"""

from __future__ import annotations

import inspect
import re
import sys

from agribot.drivers.board import board_protocol as table
from agribot.drivers.board.board_codec import FORMATS

HEAD = """# Messages of the boards

Written by `make pages` from the code. The robot and its [boards](firmware.md) exchange frames of
`type u8`, `seq u8`, the fields, little-endian, and the CRC-16/XMODEM of all that, stuffed by COBS
and ended by a zero byte. Each side counts its own frames in `seq`. A number times the scale is the
unit ([`board_protocol.py`](../src/agribot/drivers/board/board_protocol.py)).

Layout {layout:#06x}.

| message | what | fields: type, scale, unit |
|---|---|---|
{messages}
## Bits and numbers

{numbers}"""


def page() -> str:
    messages = "".join(map(_write_message, table.MESSAGES))
    numbers = "\n".join(map(_write_numbers, table.NAMED_NUMBERS))
    return HEAD.format(layout=table.LAYOUT, messages=messages, numbers=numbers)


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
