"""Programs that look on like browsers.

`python -m agribot.lab.bench.ui_clients PORT TOKEN N STALLED S`

Prints how often the slowest of those that do not stall got a state and a picture, as JSON.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time
from collections.abc import Sequence

from websockets.asyncio.client import connect

from agribot.ui import wire


def connect_page(port: int, token: str, path: str, through: int | None = None) -> connect:
    """Connect to a socket of the page's server at `port`; `through` is where to reach it."""
    return connect(
        f"ws://127.0.0.1:{port}{path}",
        additional_headers={"Authorization": f"Bearer {token}"},
        compression=None,
        proxy=None,
        host="127.0.0.1",
        port=through or port,
    )


def is_state(text: str) -> bool:
    return isinstance(wire.read_server_message(text), wire.State)


async def _watch(port: int, token: str, path: str, seconds: float, *, acks: bool) -> float:
    """Count messages of the wanted kind per second."""
    count = 0
    async with connect_page(port, token, path) as line:
        from_s = time.monotonic()
        while time.monotonic() - from_s < seconds:
            with contextlib.suppress(TimeoutError):
                message = await asyncio.wait_for(line.recv(), 1.0)
                is_wanted = is_state(message) if isinstance(message, str) else message[0] == 0
                count += is_wanted
                if acks and is_wanted:
                    await line.send("a")
    return count / seconds


async def _stall(port: int, token: str, seconds: float) -> None:
    """Connect and never read."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(
        f"GET /ws/v1?tab=stalled HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
        f"Authorization: Bearer {token}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
    )
    await writer.drain()
    await reader.readline()
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    await asyncio.sleep(seconds)
    writer.transport.abort()


async def _run_clients(
    port: int, token: str, clients: int, stalled: int, seconds: float
) -> dict[str, float]:
    reading = range(clients - stalled)
    states = [_watch(port, token, f"/ws/v1?tab={n}", seconds, acks=False) for n in reading]
    cameras = [_watch(port, token, "/ws/cam/main?mask=1", seconds, acks=True) for _ in reading]
    stalls = [_stall(port, token, seconds) for _ in range(stalled)]
    state_hz, camera_hz, _ = await asyncio.gather(
        asyncio.gather(*states), asyncio.gather(*cameras), asyncio.gather(*stalls)
    )
    return {"state_hz": round(min(state_hz), 2), "camera_hz": round(min(camera_hz), 2)}


def main(words: Sequence[str]) -> None:
    port, token, clients, stalled, seconds = words
    result = asyncio.run(_run_clients(int(port), token, int(clients), int(stalled), float(seconds)))
    sys.stdout.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
