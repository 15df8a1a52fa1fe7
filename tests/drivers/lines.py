"""Serial lines and ports with a made-up device at the far end."""

from __future__ import annotations

import contextlib
import datetime as dt
import os
import pty
import select
import socket
import tty
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from agribot.core.platform import SensorSource, SourceOfMore
from agribot.description.loader import load_robot
from agribot.drivers.line import schemes
from tests.drivers import receiver_bytes as written
from tests.waiting import wait_for


class Line:
    """A serial line with a device at the far end; `path` is the same whenever there is one."""

    def __init__(self, folder: Path, name: str = "ttyDEVICE") -> None:
        self.path = folder / name
        self._far = -1
        self.plug_in()

    def plug_in(self) -> None:
        self._far, near = pty.openpty()
        tty.setraw(self._far)
        tty.setraw(near)
        os.set_blocking(self._far, False)
        self.path.unlink(missing_ok=True)
        self.device = os.ttyname(near)
        os.chmod(self.device, 0o666)  # for a daemon that gives up its rights
        self.path.symlink_to(self.device)
        os.close(near)

    def say(self, data: bytes) -> None:
        """Say all of it, however long the line takes."""
        while data:
            select.select([], [self._far], [])
            with contextlib.suppress(BlockingIOError):
                data = data[os.write(self._far, data) :]

    def blurt(self, data: bytes) -> None:
        """Send as a receiver does, without waiting: what is not read is lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._far, data)

    def hear(self) -> bytes:
        """Read what was written to the device; nothing if it is not open or nothing was written."""
        try:
            # Without polling first: a line that no process has open reports that it can be read,
            # and the read would then block until data comes.
            return os.read(self._far, 65536)
        except OSError:
            return b""

    def unplug(self) -> None:
        """Take the device away with its node: the terminal's number is soon another one's."""
        self.path.unlink(missing_ok=True)
        if self._far >= 0:
            os.close(self._far)
        self._far = -1


class Opened:
    """Sources of one context, and what they reported."""

    def __init__(self) -> None:
        self.told: list[str] = []
        network = schemes.RosNetwork(lambda: 0, lambda: "", lambda: "")
        self.context = schemes.SourceContext(load_robot(), network, self.told.append)
        self._sources: list[SensorSource] = []
        self._t_s = 0.0
        self._kept: dict[int, defaultdict[str, list[Any]]] = {}

    def open(self, name: str, uri: str) -> SensorSource:
        source = schemes.open_source(name, schemes.read_uri("--source", uri), self.context)
        self._sources.append(source)
        return source

    def take(self, source: SensorSource, field: str = "") -> list[Any]:
        """Take once; gives what was taken of the sensor, or of another field of the batch."""
        kept = self._kept.setdefault(id(source), defaultdict(list))
        self._t_s += 0.02
        kept[""] += source.take(self._t_s)
        more = source.take_more(self._t_s) if isinstance(source, SourceOfMore) else {}
        for name, samples in more.items():
            kept[name] += samples
        return kept.pop(field, [])

    def wait_for(self, source: SensorSource, count: int = 1, field: str = "") -> list[Any]:
        """Take until `count` samples are there."""
        found: list[Any] = []

        def take() -> bool:
            found.extend(self.take(source, field))
            return len(found) >= count

        wait_for(take, f"{count} samples")
        return found

    def close(self) -> None:
        for source in self._sources:
            source.close()


def is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def speak_ubx(say: Callable[[bytes], None], first: int = 0) -> None:
    """Say 40 fixes, of the tenth of a second numbered `first` and of those after it."""
    for k in range(first, first + 40):
        say(written.make_ubx_pvt(written.EPOCH + k * dt.timedelta(milliseconds=100), carrier=2))
