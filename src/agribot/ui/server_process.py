"""The page's server as a process of its own, with two lines to it: states and pictures."""

from __future__ import annotations

import contextlib
import importlib.util
import multiprocessing
import threading
from collections.abc import Callable

from agribot.errors import ConfigError
from agribot.ui.address import Address, bound
from agribot.ui.hub import About

READY_TIMEOUT_S = 30.0
END = b'{"k":"end"}'
PACKAGES = ("starlette", "uvicorn", "websockets", "segno")


class ServerProcess:
    """`about` is asked with the port that was found.

    Raises: ConfigError: the address cannot be used, or the packages of the page are missing.
    """

    def __init__(self, address: Address, about: Callable[[int], About]) -> None:
        check_packages()
        address.check_tls()
        from agribot.ui.server import main

        self.address = address
        self._listener = bound(address)
        self.port: int = self._listener.getsockname()[1]
        self.url = address.url(self.port)
        context = multiprocessing.get_context("spawn")
        self.has_ended = threading.Event()
        self._reader: threading.Thread | None = None
        self.link, self._far = context.Pipe()
        self.camera_link, self._camera_far = context.Pipe()
        self.process = context.Process(
            target=main,
            args=(about(self.port), self._far, self._camera_far, self._listener),
            name="agribot-ui",
            daemon=True,
        )

    def start(self) -> None:
        self.process.start()
        self._listener.close()
        self._far.close()  # so that the death of one side is the end of the other's line
        self._camera_far.close()
        self.address.write_door(self.port)

    def listen(
        self, hear: Callable[[bytes], None], look: Callable[[], None], every_s: float
    ) -> None:
        """Call `hear` with every message and `look` at least every so often, in a thread.

        The thread ends with the server, after a last `look`.
        """

        def run() -> None:
            with contextlib.suppress(OSError, EOFError):
                while True:
                    if self.link.poll(every_s):
                        hear(self.link.recv_bytes())
                    look()
            self.has_ended.set()
            look()

        self._reader = threading.Thread(target=run, name="ui-orders", daemon=True)
        self._reader.start()

    def close(self) -> None:
        """End the server, which says goodbye to its pages. Safe to call twice."""
        if self.process.pid is not None:
            with contextlib.suppress(OSError):
                self.link.send_bytes(END)
            self.process.join(timeout=5.0)
            if self.process.is_alive():
                self.process.kill()
                self.process.join()
        if self._reader is not None:  # a line is not closed under the feet of who reads it
            self._reader.join()
        self.link.close()
        self.camera_link.close()
        self.address.remove_door(self.port)


def check_packages() -> None:
    """Raises: ConfigError: the extra `ui` is not installed."""
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise ConfigError(
            f"the operator's page needs {', '.join(missing)}; install them with "
            "pip install 'agribot[ui]', or run without --ui"
        )
