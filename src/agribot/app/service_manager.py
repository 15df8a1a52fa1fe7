"""What a run reports to systemd: that it drives, that its loop still turns, and that it ends.

Source: sd_notify(3) and systemd.service(5). Nothing is sent unless the process was started as a
service of `Type=notify`.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Self

from agribot.core.messages import MissionStatus, TickRecord

if TYPE_CHECKING:
    from agribot.app.run import Run

SIGNS_OF_LIFE = 4  # signs in the time after which systemd ends a silent service
STATUS_PERIOD_S = 1.0
QUIET_LIMIT_S = 300.0  # time for figures and files of a long run, on a slow card


class ServiceManager:
    """A tap of the control loop: the first tick says ready, those after it are signs of life.

    A loop that hangs is silent, and systemd ends and restarts it after `WatchdogSec`. Use it as a
    context; its end says that the service stops.
    """

    def __init__(
        self,
        environment: Mapping[str, str] = os.environ,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock_s = clock_s
        self._address = _read_address(environment)
        self._limit_s = _read_limit_s(environment)
        self._line = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if self._address else None
        if self._line is not None:
            self._line.setblocking(False)  # the control loop must not block
        self._is_ready = False
        self._life_s = self._status_s = -float("inf")
        self._status = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._line is not None:
            self._say("STOPPING=1", f"WATCHDOG_USEC={QUIET_LIMIT_S * 1e6:.0f}")
            self._line.close()
            self._line = None

    def __call__(self, record: TickRecord) -> None:
        if self._line is None:
            return
        now_s = self._clock_s()
        if not self._is_ready:
            self._is_ready = self._say("READY=1")
        if self._limit_s and now_s - self._life_s >= self._limit_s / SIGNS_OF_LIFE:
            self._life_s = now_s
            self._say("WATCHDOG=1")
        if now_s - self._status_s >= STATUS_PERIOD_S:
            self._status_s = now_s
            self._send_status(record.status)

    @contextlib.contextmanager
    def allow_quiet(self) -> Iterator[None]:
        """Let the loop stand still for a while, such as for the files at the end of a run."""
        if self._limit_s:
            self._say("WATCHDOG=1", f"WATCHDOG_USEC={QUIET_LIMIT_S * 1e6:.0f}")
        yield
        if self._limit_s:
            self._say("WATCHDOG=1", f"WATCHDOG_USEC={self._limit_s * 1e6:.0f}")

    def _send_status(self, status: MissionStatus) -> None:
        text = f"{status.state}, {status.leg}" if status.leg else str(status.state)
        why = status.stopped or status.held
        text = " ".join((f"{text}: {why}" if why else text).split())
        if text != self._status:
            self._status = text
            self._say(f"STATUS={text}")

    def _say(self, *lines: str) -> bool:
        """Send lines; a manager that does not take them is tried again with the next ones."""
        if self._line is None:
            return False
        try:
            self._line.sendto("\n".join(lines).encode(), self._address)
        except OSError:
            return False
        return True


def open_service(run: Run) -> ServiceManager:
    """Open the line to systemd, which hears of every tick of the run."""
    service = ServiceManager()
    run.add_tap(service)
    return service


def _read_address(environment: Mapping[str, str]) -> str:
    """Read where to speak to; a name that begins with @ stands in no folder."""
    address = environment.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")) or not hasattr(socket, "AF_UNIX"):
        return ""
    return "\0" + address[1:] if address.startswith("@") else address


def _read_limit_s(environment: Mapping[str, str]) -> float:
    """Read how long the loop may be silent; 0 without a watchdog on this process."""
    mine = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    microseconds = environment.get("WATCHDOG_USEC", "")
    return int(microseconds) / 1e6 if mine and microseconds.isdecimal() else 0.0
