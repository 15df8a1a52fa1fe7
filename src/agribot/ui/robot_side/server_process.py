"""The page's server as a process of its own, with two lines to it: states and pictures.

After a crash it is started again. The robot's side keeps the listening socket: no other program
gets the port meanwhile, and pages that connect wait in its queue; tokens and the key of the
sessions stay the same, so that pages come back logged in, and so does the number of the run, by
which pages know that it is not another one.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

import msgspec

from agribot.core import extras
from agribot.ui import wire
from agribot.ui.about import About, make_epoch
from agribot.ui.address import Address, bound

READY_TIMEOUT_S = 30.0
# Silence of a server that hangs, s. A server reports four times a second that its loop goes round,
# while it loads a recording, too. Pages have given up their lines by then; a slow machine needs far
# less for the longest step.
HANG_S = 10.0
PAUSES_S = (0.0, 1.0, 2.0, 5.0, 10.0, 30.0)  # pauses before each new start
STEADY_S = 60.0  # uptime after which the pauses begin anew
END = wire.encode(wire.End())
# Report of a server that serves; one about its loop may come before.
READY = wire.encode(wire.Ready())


def report(text: str) -> None:
    """Write to the terminal."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


class ServerProcess:
    """`about` is asked with the port that was found, and again for each new process.

    `lost` is called with the reason when the process has died, before it is started again.
    `silent_s` is for how long nothing was heard of it; 0 before its first message.
    `link` and `camera_link` are those of the process of the moment.
    Raises: ConfigError: the address cannot be used, or the packages of the page are missing.
    """

    link: Connection
    camera_link: Connection
    process: BaseProcess

    def __init__(
        self,
        address: Address,
        about: Callable[[int], About],
        lost: Callable[[str], None] = lambda _: None,
    ) -> None:
        check_packages()
        address.check_tls()
        self.address = address
        self._about, self._lost = about, lost
        self._run_id = make_epoch()
        self._listener = bound(address)
        self.port: int = self._listener.getsockname()[1]
        self.url = address.url(self.port)
        self.has_ended = threading.Event()
        self._is_closed = threading.Event()
        self._starting = threading.Lock()  # lock of starting a process, never taken after `close`
        self._reader: threading.Thread | None = None
        self._heard_s = 0.0
        self._has_served = False
        self._pauses = 0

    @property
    def silent_s(self) -> float:
        return time.monotonic() - self._heard_s if self._heard_s else 0.0

    def start(self) -> None:
        self._start_process()
        self.address.write_door(self.port)

    def _start_process(self) -> None:
        from agribot.ui.server.serve import main

        about = msgspec.structs.replace(self._about(self.port), run_id=self._run_id)
        context = multiprocessing.get_context("spawn")
        self.link, far = context.Pipe()
        self.camera_link, camera_far = context.Pipe()
        self.process = context.Process(
            target=main,
            args=(about, far, camera_far, self._listener),
            name="agribot-ui",
            daemon=True,
        )
        self._heard_s = 0.0
        try:
            self.process.start()
        finally:
            far.close()  # the end of either side must end the other's line
            camera_far.close()

    def listen(
        self, hear: Callable[[bytes], None], look: Callable[[], None], every_s: float
    ) -> None:
        """Call `hear` with every message and `look` at least every so often, in a thread.

        The thread ends with `close`, or with a first server that ends before it serves.
        """

        def run() -> None:
            while True:
                begin_s = time.monotonic()
                self._follow(hear, look, every_s)
                if self._is_closed.is_set() or not self._has_served:
                    break
                self._pauses = 0 if time.monotonic() - begin_s > STEADY_S else self._pauses
                self._restart(look, every_s)
            self.has_ended.set()

        self._reader = threading.Thread(target=run, name="ui-orders", daemon=True)
        self._reader.start()

    def _follow(
        self, hear: Callable[[bytes], None], look: Callable[[], None], every_s: float
    ) -> None:
        """Follow the process to its end; one that hangs is ended, and one that does not begin."""
        begin_s = time.monotonic()
        with contextlib.suppress(OSError, EOFError):
            while True:
                if self.link.poll(every_s):
                    data = self.link.recv_bytes()
                    hear(data)
                    self._heard_s = time.monotonic()
                    self._has_served = self._has_served or data == READY
                elif self.silent_s > HANG_S or (
                    not self._heard_s and time.monotonic() - begin_s > READY_TIMEOUT_S
                ):
                    self.process.kill()
                look()

    def _restart(self, look: Callable[[], None], every_s: float) -> None:
        """Report, and try until there is a process again or `close` is called."""
        self.process.join(timeout=1.0)
        if self.process.is_alive():  # it closed its line and went on
            self.process.kill()
            self.process.join()
        reason = how_it_ended(self.process.exitcode)
        report(f"page: its server {reason}; it is started again, the robot goes on")
        self._lost(reason)
        self._heard_s = 0.0
        while not self._is_closed.is_set():
            end_s = time.monotonic() + PAUSES_S[min(self._pauses, len(PAUSES_S) - 1)]
            self._pauses += 1
            while time.monotonic() < end_s and not self._is_closed.wait(every_s):
                look()
            with self._starting:
                if self._is_closed.is_set():
                    return
                try:
                    self._start_process()
                except OSError as error:
                    report(f"page: its server cannot be started: {error.strerror}; trying again")
                    continue
            return

    def close(self, *, at_once: bool = False) -> None:
        """End the server, which says goodbye to its pages unless `at_once`. Safe to call twice."""
        self._is_closed.set()
        with self._starting:
            process = getattr(self, "process", None)
        if process is not None and process.pid is not None:
            if at_once:
                process.kill()
            with contextlib.suppress(OSError):
                self.link.send_bytes(END)
            process.join(timeout=5.0)
            if process.is_alive():
                process.kill()
                process.join()
        if self._reader is not None:  # a line is not closed under the feet of who reads it
            self._reader.join()
        if process is not None:
            self.link.close()
            self.camera_link.close()
        self._listener.close()
        self.address.remove_door(self.port)


def how_it_ended(status: int | None) -> str:
    """In words, from the exit status of a process."""
    if status is None or status >= 0:
        return f"ended with status {status or 0}"
    try:
        return f"was killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"was killed by signal {-status}"


def check_packages() -> None:
    """Require the packages of the page.

    Raises: ConfigError: the extra `ui` is not installed.
    """
    extras.require("ui", "the operator's page")
