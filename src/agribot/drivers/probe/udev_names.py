"""Lasting names for devices of one USB name: rules of udev by serial number or by socket.

Sources: udev(7); systemd's 60-serial.rules, which set ID_SERIAL_SHORT and ID_PATH before; the
database of udev, /run/udev/data/cMAJOR:MINOR, whose lines `E:KEY=VALUE` are a device's properties.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

RULES_FILE = "/etc/udev/rules.d/71-agribot-boards.rules"  # file that is read after 60-serial.rules
# Numbers that chips have from the factory, all the same.
LEAST_DIGITS, LEAST_DIFFERENT = 6, 3
FACTORY_NUMBERS = ("0123456789ABCDEF", "123456789ABCDEF", "0123456789")
_SAFE = re.compile(r"[A-Za-z0-9#+\-.:=@_]+")  # letters that udev lets through, without its patterns

Properties = Mapping[str, str]


def read_properties(node: str, root: Path = Path("/")) -> dict[str, str]:
    """Read what udev knows of the device at `node`; empty where there is no udev."""
    try:
        about = root / "sys/class/tty" / node.rpartition("/")[2] / "dev"
        number = about.read_text("ascii").strip()
        text = (root / f"run/udev/data/c{number}").read_text("utf-8", errors="replace")
    except (OSError, UnicodeDecodeError):
        return {}
    found = (line[2:].partition("=") for line in text.splitlines() if line.startswith("E:"))
    return {key: value for key, _, value in found}


def write_rule(name: str, properties: Properties, others: Sequence[Properties] = ()) -> str:
    """Write the rule that gives a device the name /dev/NAME; empty where nothing identifies it.

    It goes by the serial number, if that is one and none of `others` has it, else by the socket.
    """
    by_number = ("ID_VENDOR_ID", "ID_MODEL_ID", "ID_SERIAL_SHORT", "ID_USB_INTERFACE_NUM")
    keys = by_number if _is_real(properties, others) else ("ID_PATH",)
    matched = {key: properties[key] for key in keys if properties.get(key)}
    if not {"ID_SERIAL_SHORT", "ID_PATH"} & set(matched):
        return ""
    if not all(map(_SAFE.fullmatch, (name, *matched.values()))):
        return ""
    matches = ", ".join(f'ENV{{{key}}}=="{value}"' for key, value in matched.items())
    return f'ACTION!="remove", SUBSYSTEM=="tty", {matches}, SYMLINK+="{name}"'


def _is_real(properties: Properties, others: Sequence[Properties]) -> bool:
    number = properties.get("ID_SERIAL_SHORT", "")
    is_one = len(number) >= LEAST_DIGITS and len(set(number)) >= LEAST_DIFFERENT
    is_safe = _SAFE.fullmatch(number) is not None
    is_shared = any(
        other.get("ID_SERIAL_SHORT") == number
        and other.get("ID_USB_INTERFACE_NUM") == properties.get("ID_USB_INTERFACE_NUM")
        for other in others
    )
    return is_one and is_safe and not is_shared and number.upper() not in FACTORY_NUMBERS
