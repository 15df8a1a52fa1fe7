"""A WebSocket for programs that are not asynchronous."""

from __future__ import annotations

import ssl
from contextlib import ExitStack
from typing import Any, Self

CLOSE_TIMEOUT_S = 2.0


class BlockingSocket:
    """Opened and closed as a context. A thread of its own does all the reading and writing.

    One thread, because OpenSSL allows no write to an encrypted connection during a
    read from it (openssl-threads(7)): `websockets.sync` does both at once, and loses connections.

    Raises: OSError: no answer within the timeout, the other side refuses or is gone.
    """

    def __init__(
        self, url: str, headers: dict[str, str], tls: ssl.SSLContext | None, open_timeout_s: float
    ) -> None:
        self._url = url
        self._options: dict[str, Any] = {
            "additional_headers": headers,
            "ssl": tls,
            "open_timeout": open_timeout_s,
        }
        self._stack = ExitStack()
        self._portal: Any = None
        self._socket: Any = None

    def __enter__(self) -> Self:
        from anyio.from_thread import start_blocking_portal
        from websockets.asyncio.client import connect
        from websockets.exceptions import WebSocketException

        with ExitStack() as stack:
            self._portal = stack.enter_context(start_blocking_portal())
            try:
                opened = connect(
                    self._url,
                    compression=None,
                    proxy=None,
                    close_timeout=CLOSE_TIMEOUT_S,
                    **self._options,
                )
                self._socket = stack.enter_context(self._portal.wrap_async_context_manager(opened))
            except WebSocketException as error:
                raise ConnectionError(str(error)) from error
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def send(self, text: str) -> None:
        self._run(self._socket.send, text)

    def receive(self, timeout_s: float) -> str | bytes | None:
        """Receive the next message; None when none comes in time, 0 takes what is here already."""
        return self._run(self._receive, timeout_s)  # type: ignore[no-any-return]

    async def _receive(self, timeout_s: float) -> Any:
        from anyio import move_on_after

        with move_on_after(timeout_s):
            return await self._socket.recv()
        return None

    def _run(self, work: Any, *values: object) -> Any:
        from websockets.exceptions import WebSocketException

        try:
            return self._portal.call(work, *values)
        except WebSocketException as error:
            raise ConnectionError(str(error)) from error
