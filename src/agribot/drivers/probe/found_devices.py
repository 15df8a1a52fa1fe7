"""Which boards, receivers, cameras and gamepads this machine has, from /dev and /sys."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import msgspec

Kind = Literal["serial", "camera", "gamepad"]
Access = Callable[[Path, int], bool]  # os.access, or what a test says

# USB vendors and products; an empty product stands for all of the vendor.
SERIAL_MAKERS = {
    ("1546", ""): "u-blox receiver",
    ("152a", ""): "Septentrio receiver",
    ("2341", "0010"): "Arduino Mega 2560",
    ("2341", "0042"): "Arduino Mega 2560",
    ("2a03", "0042"): "Arduino Mega 2560",
    ("2341", ""): "Arduino",
    ("2a03", ""): "Arduino",
    ("1a86", ""): "USB to serial chip CH340, often an Arduino, or a relay",
    ("0403", ""): "USB to serial chip of FTDI",
    ("10c4", ""): "USB to serial chip CP210x, often a receiver",
    ("0483", "5740"): "STM32 board, such as a VESC",
    ("1209", "0d32"): "ODrive",
}
RELAY_CHIP = "1a86:7523"  # CH340, of an LCUS relay and of many an Arduino alike
RECEIVERS = ("u-blox receiver", "Septentrio receiver")
# UARTs on the pins of small computers; those of a PC (ttyS) are left out, for most have no plug.
BOARD_UARTS = ("ttyAMA", "ttyTHS", "serial0", "serial1")
# Links of /etc/udev/rules.d/71-agribot-boards.rules, one for each board that was probed.
BOARD_NAMES = ("agribot-motor", "agribot-imu", "agribot-receiver")
LEVELS_TO_USB = 8  # folders of /sys between an interface and its USB device, at the most


class FoundDevice(msgspec.Struct, frozen=True, kw_only=True):
    """`path` is the name that stays when it is plugged in elsewhere, `node` today's.

    `what` is a guess from the USB vendor; `usb` is "vendor:product", empty for others. `group` is
    the one that may use the device.
    """

    kind: Kind
    path: str
    node: str
    what: str
    usb: str = ""
    is_usable: bool
    group: str

    @property
    def may_be_relay(self) -> bool:
        return self.usb == RELAY_CHIP

    @property
    def is_receiver(self) -> bool:
        return self.what in RECEIVERS


def find_devices(root: Path = Path("/"), access: Access = os.access) -> list[FoundDevice]:
    """Find all devices below `root`, which holds `dev` and `sys`: "/", or a copy for a test."""
    return [
        *find_serial_lines(root, access),
        *find_cameras(root, access),
        *find_gamepads(root, access),
    ]


def find_serial_lines(root: Path, access: Access = os.access) -> Iterator[FoundDevice]:
    """Find the serial lines over USB, and those on the pins of a small computer."""
    lines = _list(root / "dev", r"tty(USB|ACM)\d+")
    names = _name_serial_lines(root, lines)
    for name in lines:
        vendor, product = _read_usb_ids(root / "sys/class/tty" / name / "device")
        known = SERIAL_MAKERS.get((vendor, product)) or SERIAL_MAKERS.get((vendor, ""))
        what = known or _read_usb_text(root / "sys/class/tty" / name / "device") or "serial line"
        yield _make(root, "serial", name, names, what, f"{vendor}:{product}".strip(":"), access)
    for name in _list(root / "dev", rf"({'|'.join(BOARD_UARTS)})\d*"):
        yield _make(root, "serial", name, names, "serial pins of the board", "", access)


def find_cameras(root: Path, access: Access = os.access) -> Iterator[FoundDevice]:
    """Find the video devices that give pictures; a camera's second one gives data about them."""
    names = _read_stable_names(root, "dev/v4l/by-id")
    for name in _list(root / "dev", r"video\d+"):
        about = root / "sys/class/video4linux" / name
        if (_read(about / "index") or "0") != "0":
            continue
        yield _make(root, "camera", name, names, _read(about / "name") or "camera", "", access)


def find_gamepads(root: Path, access: Access = os.access) -> Iterator[FoundDevice]:
    for name in _list(root / "dev/input", r"js\d+"):
        what = _read(root / "sys/class/input" / name / "device/name") or "gamepad"
        yield _make(root, "gamepad", f"input/{name}", {}, what, "", access)


def explain_access(device: FoundDevice, groups: frozenset[str] | None = None) -> str:
    """Say what lets the user use a device; `groups` are those of the user in /etc/group."""
    if groups is None:
        groups = frozenset(_list_groups())
    if device.group in groups:
        return f"you are in the group {device.group} since you logged in: log out and in again"
    return f"sudo usermod -aG {device.group} $USER, then log out and in again"


def _make(
    root: Path, kind: Kind, name: str, names: dict[str, str], what: str, usb: str, access: Access
) -> FoundDevice:
    path = root / "dev" / name
    needed = os.R_OK if kind == "gamepad" else os.R_OK | os.W_OK
    return FoundDevice(
        kind=kind,
        path=names.get(name, f"/dev/{name}"),
        node=f"/dev/{name}",
        what=what,
        usb=usb,
        is_usable=access(path, needed),
        group=_read_group(path),
    )


def _list(folder: Path, pattern: str) -> list[str]:
    """List the names in a folder that match as a whole, ttyUSB2 before ttyUSB10."""
    try:
        names = [name for name in os.listdir(folder) if re.fullmatch(pattern, name)]
    except OSError:
        return []
    return sorted(names, key=lambda name: (len(name), name))


def _read_stable_names(root: Path, folder: str, pattern: str = ".+") -> dict[str, str]:
    """Return for each node's name the link that keeps pointing to the same device."""
    return {
        os.path.basename(os.readlink(root / folder / link)): f"/{folder}/{link}"
        for link in reversed(_list(root / folder, pattern))
        if os.path.islink(root / folder / link)
    }


def _name_serial_lines(root: Path, lines: list[str]) -> dict[str, str]:
    """Return the lasting name of each line: one of a rule for boards, by its number, or its socket.

    Two devices of one kind without serial numbers have the same name by-id, which links to the
    one plugged in last; their sockets distinguish them.
    """
    by_id = _read_stable_names(root, "dev/serial/by-id")
    by_path = _read_stable_names(root, "dev/serial/by-path")
    by_rule = _read_stable_names(root, "dev", "|".join(BOARD_NAMES))
    about = {name: root / "sys/class/tty" / name / "device" for name in lines}
    ids = {name: (*_read_usb_ids(at), _read_usb_serial(at)) for name, at in about.items()}
    twins = {name for name in lines if list(ids.values()).count(ids[name]) > 1}
    single = {name: link for name, link in by_id.items() if name not in twins}
    return {**by_id, **by_path, **single, **by_rule}


def _read_usb_serial(interface: Path) -> str:
    for folder in _climb(interface):
        if (folder / "idVendor").exists():
            return _read(folder / "serial")
    return ""


def _read_usb_ids(interface: Path) -> tuple[str, str]:
    for folder in _climb(interface):
        vendor, product = _read(folder / "idVendor"), _read(folder / "idProduct")
        if vendor and product:
            return vendor, product
    return "", ""


def _read_usb_text(interface: Path) -> str:
    for folder in _climb(interface):
        if (folder / "idVendor").exists():
            return " ".join(filter(None, (_read(folder / n) for n in ("manufacturer", "product"))))
    return ""


def _climb(interface: Path) -> Iterator[Path]:
    folder = Path(os.path.realpath(interface))
    for _ in range(LEVELS_TO_USB):
        yield folder
        folder = folder.parent


def _read(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace").strip()
    except OSError:
        return ""


def _read_group(path: Path) -> str:
    try:
        return path.group()
    except (OSError, KeyError, NotImplementedError):
        return "dialout"


def _list_groups() -> Iterator[str]:
    """List the groups of the user as the system's files have them, which a login takes over."""
    with contextlib.suppress(ImportError, KeyError):  # another system; a user without a name
        import grp
        import pwd

        name = pwd.getpwuid(os.getuid()).pw_name
        yield from (group.gr_name for group in grp.getgrall() if name in group.gr_mem)
