"""Write the boards' side of their messages: `python scripts/generate_board_wire.py`.

`firmware/wire.h` has the table of `src/agribot/drivers/board/board_protocol.py` in C.
"""

from __future__ import annotations

import re
from pathlib import Path

from agribot.drivers.board import board_protocol as table
from agribot.drivers.board.board_codec import FORMATS

PATH = Path(__file__).parents[1] / "firmware" / "wire.h"
HEAD = """/* Written by scripts/generate_board_wire.py from
 * src/agribot/drivers/board/board_protocol.py: change that one. Little-endian, as the AVR is.
 */
#ifndef WIRE_H
#define WIRE_H

#include <stdint.h>

#ifdef __cplusplus
#define SIZE_IS(type, size) static_assert(sizeof(type) == size, #type)
#else
#define SIZE_IS(type, size) _Static_assert(sizeof(type) == size, #type)
#endif
"""
C_TYPES = {
    "u8": "uint8_t", "i8": "int8_t", "u16": "uint16_t", "i16": "int16_t", "u32": "uint32_t",
    "i32": "int32_t",
}  # fmt: skip


def write_header() -> str:
    """Make the text of `firmware/wire.h`."""
    return "\n".join([HEAD, *_write_numbers(), *_write_structs(), "#endif", ""])


def _write_numbers() -> list[str]:
    numbers = {
        "PROTOCOL": f"{table.PROTOCOL}",
        "LAYOUT": f"0x{table.LAYOUT:04X}u",
        "BAUD": f"{table.BAUD}ul",
        "TELEMETRY_HZ": f"{table.TELEMETRY_HZ}",
        "COMMAND_TIMEOUT_MS": f"{round(1000 * table.COMMAND_TIMEOUT_S)}",
        "CLEAR_KEY": f"0x{table.CLEAR_KEY:04X}u",
    }
    lines = [f"#define {name} {value}" for name, value in numbers.items()]
    for kind in table.NAMED_NUMBERS:
        prefix = _to_words(kind.__name__).upper()
        lines += ["", f"/* {kind.__name__}: {_first_line(kind)} */"]
        lines += [f"#define {prefix}_{one.name} {int(one)}u" for one in kind]
    return [*lines, ""]


def _write_structs() -> list[str]:
    lines = []
    for message in table.MESSAGES:
        words = _to_words(message.__name__)
        lines += [f"/* {_first_line(message)} */"]
        lines += [f"#define TYPE_{words.upper()} 0x{message.number:02X}"]
        lines += ["typedef struct __attribute__((packed)) {", "  uint8_t type;", "  uint8_t seq;"]
        for name, wire, _ in table.list_fields(message):
            size = f"[{wire.length}]" if wire.length > 1 else ""
            scale = f" / {wire.scale:g}" if wire.scale != 1.0 else ""
            unit = f" /* {wire.unit}{scale} */" if wire.unit else ""
            lines += [f"  {C_TYPES[wire.kind]} {name}{size};{unit}"]
        lines += [f"}} {words}_t;"]
        lines += [f"SIZE_IS({words}_t, {FORMATS[message.number].struct.size});", ""]
    return lines


def _to_words(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


def _first_line(kind: type) -> str:
    return (kind.__doc__ or "").strip().splitlines()[0].rstrip(".")


if __name__ == "__main__":
    PATH.write_text(write_header(), encoding="utf-8")
