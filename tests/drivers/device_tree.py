"""A made-up /dev and /sys below a folder, as Linux lays them out."""

from __future__ import annotations

import os
from pathlib import Path


def put(root: Path, path: str, text: str = "") -> Path:
    file = root / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


def link(root: Path, path: str, target: str) -> None:
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    os.symlink(target, root / path)


def plug_serial(root: Path, name: str, usb: str, by_id: str = "", product: str = "") -> None:
    """Plug in a serial device; `usb` is its "vendor:product", `by_id` its lasting name."""
    vendor, number = usb.split(":")
    port = f"sys/devices/usb1/{name}"
    put(root, f"{port}/idVendor", vendor + "\n")
    put(root, f"{port}/idProduct", number + "\n")
    if product:
        put(root, f"{port}/product", product + "\n")
    interface = f"{port}/1-1:1.0"
    (root / interface / "tty" / name).mkdir(parents=True)
    link(root, f"sys/class/tty/{name}", f"../../../{interface}/tty/{name}")
    link(root, f"{interface}/tty/{name}/device", "../../../1-1:1.0")
    put(root, f"dev/{name}")
    if by_id:
        link(root, f"dev/serial/by-id/{by_id}", f"../../{name}")


def plug_camera(root: Path, name: str, about: str, index: int = 0) -> None:
    put(root, f"dev/{name}")
    put(root, f"sys/class/video4linux/{name}/name", about + "\n")
    put(root, f"sys/class/video4linux/{name}/index", f"{index}\n")


def plug_gamepad(root: Path, name: str, about: str) -> None:
    put(root, f"dev/input/{name}")
    put(root, f"sys/class/input/{name}/device/name", about + "\n")
