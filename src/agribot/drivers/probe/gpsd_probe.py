"""Whether a gpsd answers on this machine, and which receivers it has in its hands."""

from __future__ import annotations

import socket
import time

import msgspec

from agribot.drivers.gnss.gpsd import PORT, JsonLineDecoder

ASK = b"?DEVICES;\n"
MOST_BYTES = 65536


class GpsdState(msgspec.Struct, frozen=True, kw_only=True):
    """`release` is empty where something else answers; `paths` are the lines that gpsd reads."""

    release: str
    paths: tuple[str, ...]


def ask_gpsd(host: str = "127.0.0.1", port: int = PORT, wait_s: float = 0.5) -> GpsdState | None:
    """Ask a gpsd for its release and its devices; None where nothing listens."""
    release, decoder, deadline_s = "", JsonLineDecoder(), time.monotonic() + wait_s
    try:
        with socket.create_connection((host, port), timeout=wait_s) as line:
            line.sendall(ASK)
            line.settimeout(0.1)
            while time.monotonic() < deadline_s:
                for tree in _receive(line, decoder):
                    if tree.get("class") == "VERSION":
                        release = str(tree.get("release", "?"))
                    elif tree.get("class") == "DEVICES":
                        return GpsdState(release=release, paths=_read_paths(tree))
    except OSError:
        return None if not release else GpsdState(release=release, paths=())
    return GpsdState(release=release, paths=())


def _receive(line: socket.socket, decoder: JsonLineDecoder) -> list[dict[str, object]]:
    """Receive what has come.

    Raises: OSError: the other end has closed.
    """
    try:
        data = line.recv(MOST_BYTES)
    except TimeoutError:
        return []
    if not data:
        raise ConnectionError("closed")
    return decoder.feed(data)


def _read_paths(tree: dict[str, object]) -> tuple[str, ...]:
    devices = tree.get("devices")
    found = devices if isinstance(devices, list) else []
    return tuple(str(one["path"]) for one in found if isinstance(one, dict) and "path" in one)
