"""A page behind a slow link: `python -m agribot.lab.bench.ui_link PORT TOKEN MBIT_PER_S SECONDS`.

Reads the states and draws the camera through a line of limited bit rate and with a delay each
way, and prints how old both are when they arrive, as JSON. The first part of the time, in which
the size of the pictures adapts, does not count.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket as socket_library
import sys
import time
from collections.abc import AsyncIterator, Sequence

from agribot.lab.bench.ui_clients import connect_page
from agribot.ui import wire

DELAY_S = 0.02  # each way
PIECE_BYTES = 1460  # payload of a TCP segment over Ethernet
LINE_BYTES = 16_384  # bytes that wait in the radio before it takes no more
SETTLE_S = 8.0


class SlowConnection:
    """A slow connection, shared by both sockets of a page; only what comes down is held back."""

    def __init__(self, bytes_per_s: float, port: int) -> None:
        self._bytes_per_s, self._port = bytes_per_s, port
        self._free_s = 0.0
        self._tasks: set[asyncio.Task[None]] = set()

    @contextlib.asynccontextmanager
    async def open(self) -> AsyncIterator[int]:
        """Open the connection and give the port at which a page finds the robot behind it."""
        server = await asyncio.start_server(self._carry, "127.0.0.1", 0, limit=LINE_BYTES)
        async with server:
            yield server.sockets[0].getsockname()[1]
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _carry(self, near: asyncio.StreamReader, near_out: asyncio.StreamWriter) -> None:
        # A loopback of megabytes would hide that the line is slow.
        socket = socket_library.socket()
        socket.setsockopt(socket_library.SOL_SOCKET, socket_library.SO_RCVBUF, LINE_BYTES)
        socket.setblocking(False)
        await asyncio.get_running_loop().sock_connect(socket, ("127.0.0.1", self._port))
        far, far_out = await asyncio.open_connection(sock=socket, limit=LINE_BYTES)
        ways = (self._delay(near, far_out, rate=False), self._delay(far, near_out, rate=True))
        self._tasks |= {asyncio.create_task(way) for way in ways}

    async def _delay(
        self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, *, rate: bool
    ) -> None:
        """Send piece after piece at the connection's rate, each after its delay."""
        under_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()
        arriving = asyncio.create_task(_deliver(under_way, sink))
        try:
            while piece := await source.read(PIECE_BYTES):
                now_s = time.monotonic()
                if rate:
                    self._free_s = max(self._free_s, now_s) + len(piece) / self._bytes_per_s
                    await asyncio.sleep(self._free_s - now_s)
                under_way.put_nowait((time.monotonic() + DELAY_S, piece))
            under_way.put_nowait((0.0, b""))
            await arriving
        finally:
            arriving.cancel()
            sink.close()
            with contextlib.suppress(OSError):
                await sink.wait_closed()


async def _deliver(
    under_way: asyncio.Queue[tuple[float, bytes]], sink: asyncio.StreamWriter
) -> None:
    """Deliver up to the empty piece that ends it."""
    while True:
        due_s, piece = await under_way.get()
        if not piece:
            return
        await asyncio.sleep(due_s - time.monotonic())
        sink.write(piece)


async def _watch(address: tuple[int, int], token: str, path: str, seconds: float) -> list[float]:
    """List the ages in ms of pictures or states, once the connection has settled."""
    port, through = address
    ages_ms: list[float] = []
    async with connect_page(port, token, path, through) as line:
        from_s = time.monotonic()
        while (passed_s := time.monotonic() - from_s) < seconds + SETTLE_S:
            message = await asyncio.wait_for(line.recv(), 10.0)
            age_ms = _read_age_ms(message)
            if isinstance(message, bytes) and message[0] == 0:
                await line.send("a")
            if age_ms is not None and passed_s > SETTLE_S:
                ages_ms.append(age_ms)
    return ages_ms


def _read_age_ms(message: str | bytes) -> float | None:
    """Compute the age of a picture or a state from the clock that robot and page share."""
    if isinstance(message, bytes):
        kind, _, _, _, wall_ms = wire.CAMERA_HEAD.unpack_from(message)
        return time.time() * 1e3 - float(wall_ms) if kind == 0 else None
    state = wire.read_server_message(message)
    return time.monotonic() * 1e3 - state.mono_ms if isinstance(state, wire.State) else None


async def _run_watchers(
    port: int, token: str, mbit_per_s: float, seconds: float
) -> dict[str, float]:
    async with SlowConnection(mbit_per_s * 1e6 / 8.0, port).open() as through:
        states, pictures = await asyncio.gather(
            _watch((port, through), token, "/ws/v1?tab=far", seconds),
            _watch((port, through), token, "/ws/cam/main?mask=1", seconds),
        )
    return {
        "state_hz": round(len(states) / seconds, 2),
        "state_age_p95_s": _compute_p95_s(states),
        "camera_hz": round(len(pictures) / seconds, 2),
        "camera_age_p95_s": _compute_p95_s(pictures),
    }


def _compute_p95_s(ages_ms: list[float]) -> float:
    return round(sorted(ages_ms)[int(0.95 * (len(ages_ms) - 1))] / 1e3, 4)


def main(words: Sequence[str]) -> None:
    port, token, mbit_per_s, seconds = words
    result = asyncio.run(_run_watchers(int(port), token, float(mbit_per_s), float(seconds)))
    sys.stdout.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
