"""A real gpsd of a test's own."""

from __future__ import annotations

import socket
import subprocess
from pathlib import Path

from tests import machine
from tests.drivers.lines import free_port, is_open
from tests.waiting import wait_for


class Daemon:
    """A gpsd that gets its devices over the control socket, as from udev."""

    def __init__(self, folder: Path) -> None:
        self.port, self._control = free_port(), folder / "control"
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Daemon:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, *devices: object) -> None:
        gpsd = machine.require("gpsd")
        words = [gpsd, "-N", "-n", "-b", "-S", str(self.port), "-F", str(self._control)]
        self._process = subprocess.Popen([*words, *map(str, devices)], stderr=subprocess.DEVNULL)
        wait_for(lambda: is_open(self.port), "gpsd")

    def tell(self, sign: str, device: object) -> bool:
        """Add (+) or remove (-) a device; return whether gpsd did."""
        with socket.socket(socket.AF_UNIX) as control:
            control.connect(str(self._control))
            control.sendall(f"{sign}{device}\r\n".encode())
            return control.recv(100).startswith(b"OK")

    def stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
